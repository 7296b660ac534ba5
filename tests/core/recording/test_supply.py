"""Supply voltage of a recording: held, felt row by row, and the nominal one where it is not known."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import polars as pl
import pytest
from bench import DAMPED, neutral

from hydro.core.columns import POSE, VELOCITY
from hydro.core.distillation.labels import labels
from hydro.core.errors import DataError
from hydro.core.recording.arrays import recording
from hydro.core.recording.supply import (
    effective_commands,
    given_commands,
    recorded_commands,
    supply_voltage,
    unknown_voltage,
)
from hydro.core.simulation.simulate import simulate
from hydro.core.thrust_curves.curve import Curve
from hydro.core.thrust_curves.t200 import t200
from hydro.core.vehicle.description import Battery, Thruster, Vehicle
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST, lag_states, state_to_thrust, thruster_table
from hydro.io import table, vehicle

NOMINAL = 16.0
ONE = Thruster("ahead", position=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0), curve="t200")


def boat(**changes: object) -> Vehicle:
    """A vehicle that a single T200 drives ahead and astern."""
    one = msgspec.structs.replace(ONE, **changes)
    return msgspec.structs.replace(neutral(), thruster=(one,), battery=Battery(NOMINAL), effect=DAMPED[:1])


def commands(rows: int = 1500, volts: object = None) -> pl.DataFrame:
    """A slow sweep of commands, with a column of voltages if any."""
    t = np.arange(rows) / 50.0
    frame = pl.DataFrame({"session": ["a"] * rows, "t": t, "cmd_1": 0.8 * np.sin(0.9 * t)})
    return frame if volts is None else frame.with_columns(pl.Series("voltage", volts, pl.Float64))


def thrust(known: Vehicle, effective: np.ndarray) -> np.ndarray:
    """Thrust of settled effective commands by the kernels, (N,)."""
    row = thruster_table(known)[:1]
    t = np.arange(len(effective) + 1.0)
    states = lag_states(row, np.vstack([effective, effective[-1:]]), t, t, settled=True)[1:]
    return np.array([state_to_thrust(row[0], one, 0.0) for one in states[:, 0]])


@pytest.mark.parametrize("lag", ["thrust", "speed"])
def test_the_kernels_give_the_tables_thrust_at_any_voltage(lag: str) -> None:
    known = boat(lag=lag)
    u, volts = np.linspace(-1.0, 1.0, 41), np.linspace(9.0, 21.0, 41)
    found = thrust(known, effective_commands(known, u[:, None], volts))
    np.testing.assert_allclose(found, t200().at(u, volts), atol=1e-9)


def test_commands_to_give_are_the_way_back() -> None:
    known, u = boat(), np.linspace(-1.0, 1.0, 101)[:, None]
    effective = effective_commands(known, u)
    np.testing.assert_allclose(
        effective_commands(known, given_commands(known, effective)), effective, atol=1e-9
    )
    assert np.abs(given_commands(known, 3.0 * effective)).max() == 1.0


def test_plain_curves_are_not_touched() -> None:
    given = np.linspace(-1.0, 1.0, 9)[:, None]
    assert effective_commands(neutral(), given) is given
    assert given_commands(neutral(), given) is given
    assert supply_voltage(neutral(), commands(9, [12.0] * 9)) is None
    assert unknown_voltage(neutral(), commands()) == ""


def test_a_reading_is_held_within_its_session() -> None:
    frame = pl.DataFrame(
        {
            "session": ["a"] * 5 + ["b"] * 2 + ["c"] * 2,
            "t": [0.0, 0.1, 0.2, 0.3, 0.4, 0.0, 0.1, 0.0, 0.1],
            "voltage": [None, 15.0, None, 14.0, None, None, None, None, 12.0],
        }
    )
    volts = supply_voltage(boat(), frame)
    assert volts is not None
    assert volts.tolist() == [15.0, 15.0, 15.0, 14.0, 14.0, NOMINAL, NOMINAL, 12.0, 12.0]
    assert "in 2 of 9 rows: thrust is computed for the file's 16 V" in unknown_voltage(boat(), frame)


def test_a_recording_without_voltage_is_told_in_one_line() -> None:
    line = unknown_voltage(boat(), commands())
    assert line.startswith("no supply voltage: thrust is computed for the file's 16 V; for the thrust")
    assert "\n" not in line
    assert unknown_voltage(boat(), commands(volts=[15.0] * 1500)) == ""


def test_the_nominal_voltage_in_every_row_is_none() -> None:
    raw = simulate(boat(), commands())
    told = raw.with_columns(voltage=pl.lit(NOMINAL))
    assert labels(boat(), told).drop("voltage").equals(labels(boat(), raw))
    np.testing.assert_array_equal(recording(boat(), told).commands, recording(boat(), raw).commands)


def test_labels_vanish_with_a_sagging_battery_where_the_log_knows_it() -> None:
    sag = np.linspace(17.0, 12.0, 1500)
    raw = simulate(boat(), commands(volts=sag))
    assert raw["voltage"].to_numpy() == pytest.approx(sag)
    known = labels(boat(), raw, subtract="effects")["X_res"].to_numpy()[50:-50]
    blind = labels(boat(), raw.drop("voltage"), subtract="effects")["X_res"].to_numpy()[50:-50]
    left, lost = (np.sqrt(np.mean(each**2)) for each in (known, blind))
    assert left < 0.3  # the smoother's share of the corners at the dead band
    assert lost > 10.0 * left
    np.testing.assert_array_equal(recording(boat(), raw).commands, recorded_commands(boat(), raw))


def test_labels_of_samples_follow_the_voltage_too() -> None:
    raw = simulate(boat(), commands(volts=np.linspace(17.0, 12.0, 1500)))
    rng = np.random.default_rng(5)
    raw = raw.with_columns(pl.col(name) + 0.001 * rng.standard_normal(1500) for name in (*POSE, *VELOCITY))
    rare = pl.when(pl.int_range(pl.len()) % 5 == 0).then(pl.col("u"))
    whole, sampled = (labels(boat(), one) for one in (raw, raw.with_columns(u=rare)))
    assert sampled["f_1"].drop_nulls().len() > 1000
    pair = pl.DataFrame({"a": whole["f_1"], "b": sampled["f_1"]}).drop_nulls()
    np.testing.assert_allclose(pair["a"].to_numpy(), pair["b"].to_numpy(), rtol=1e-6)


def test_a_raw_table_keeps_its_voltage_and_others_their_version(tmp_path: Path) -> None:
    raw = simulate(boat(), commands(200, [None, *[15.0] * 199]))
    plain = table.make("raw", raw.drop("voltage"), stage="simulate")
    made = table.make("raw", raw, stage="simulate")
    assert made.provenance.schema != plain.provenance.schema
    for kind, artefact in (("raw", made), ("raw", plain)):
        table.write(artefact, tmp_path / "raw.parquet")
        assert table.read(tmp_path / "raw.parquet", kind).frame.equals(artefact.frame)
    labelled = table.make("labels", labels(boat(), made.frame), stage="labels")
    table.write(labelled, tmp_path / "labels.parquet")
    assert table.read(tmp_path / "labels.parquet", "labels").frame["voltage"].null_count() == 1
    bad = raw.with_columns(voltage=pl.lit(-1.0))
    with pytest.raises(DataError, match=r"voltage \[V\] must be"):
        table.make("raw", bad, stage="simulate")


@pytest.mark.parametrize(
    ("changes", "battery", "words"),
    [
        ({"max_thrust": 50.0}, Battery(16.0), "leave out max_thrust"),
        ({"deadband": 0.1}, Battery(16.0), "leave out max_thrust, max_reverse_thrust and deadband"),
        ({}, None, r"add \[battery\] with voltage"),
        ({"curve": "linear"}, None, "give max_thrust and max_reverse_thrust"),
        ({"curve": Curve(thrust=(0.0,), command=(0.0,))}, None, "thruster ahead: curve.command"),
    ],
)
def test_a_file_that_says_too_much_or_too_little_is_refused(
    changes: dict[str, object], battery: Battery | None, words: str
) -> None:
    with pytest.raises(DataError, match=words):
        vehicle.check(msgspec.structs.replace(boat(**changes), battery=battery))


def test_limits_are_those_of_the_nominal_voltage() -> None:
    full = [thruster_table(msgspec.structs.replace(boat(), battery=Battery(v)))[0] for v in (12.0, 20.0)]
    assert [row[MAX_THRUST] for row in full] == pytest.approx([3.71 * 9.80665, 6.72 * 9.80665])
    assert [row[MAX_REVERSE] for row in full] == pytest.approx([2.91 * 9.80665, 5.04 * 9.80665])
