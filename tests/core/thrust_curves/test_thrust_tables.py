"""Thrust as a table of command and voltage: against scipy's interpolation and the maker's figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from hydro.core.errors import DataError
from hydro.core.thrust_curves.curve import Curve, curve_table
from hydro.core.thrust_curves.t200 import KGF, VOLTAGES, t200
from hydro.core.thrust_curves.table import ThrustTable, thrust_table
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST, thruster_table
from hydro.io import vehicle
from hydro.io.files import bundled

PUBLISHED = Path(__file__).resolve().parents[4] / "shared" / "data" / "t200"
TOLERANCE = 0.003
"""Of full thrust at that voltage, by which the shipped table may be off the maker's."""


@st.composite
def tables(draw: st.DrawFn) -> ThrustTable:
    """Tables whose thrust rises with the command."""
    count, volts = draw(st.integers(2, 7)), draw(st.integers(2, 4))
    steps = st.lists(st.floats(0.05, 1.0), min_size=count, max_size=count)
    command = np.cumsum([0.0, *draw(steps)])
    command = 2.0 * command / command[-1] - 1.0
    rows = [np.cumsum([0.0, *draw(steps)]) for _ in range(volts)]
    voltage = np.cumsum(draw(st.lists(st.floats(0.5, 4.0), min_size=volts, max_size=volts)))
    return thrust_table(
        list(command), [list(row - 0.4 * row[-1]) for row in rows], [float(v) for v in voltage]
    )


@given(tables(), st.floats(-1.0, 1.0), st.floats(0.0, 1.0))
def test_thrust_is_bilinear_and_within_its_neighbours(table: ThrustTable, u: float, share: float) -> None:
    volts = table.voltage[0] + share * np.ptp(table.voltage)
    oracle = RegularGridInterpolator((table.voltage, table.command), table.thrust)
    found = float(table.at(u, volts))
    assert found == pytest.approx(float(oracle([min(volts, table.voltage[-1]), u])[0]), abs=1e-9)
    i = np.clip(np.searchsorted(table.voltage, volts) - 1, 0, None)
    k = np.clip(np.searchsorted(table.command, u) - 1, 0, None)
    corners = table.thrust[i : i + 2, k : k + 2]
    assert corners.min() - 1e-9 <= found <= corners.max() + 1e-9


@given(tables(), st.floats(0.5, 20.0))
def test_thrust_never_falls_and_the_ends_hold(table: ThrustTable, volts: float) -> None:
    curve = table.at(np.linspace(-1.2, 1.2, 49), volts)
    assert (np.diff(curve) >= -1e-12).all()
    assert curve[0] == table.at(-1.0, volts)
    assert curve[-1] == table.at(1.0, volts)
    assert table.at(0.3, -5.0) == table.at(0.3, table.voltage[0])
    assert table.at(0.3, 500.0) == table.at(0.3, table.voltage[-1])


@given(tables())
def test_points_are_exact(table: ThrustTable) -> None:
    volts, command = np.meshgrid(table.voltage, table.command, indexing="ij")
    np.testing.assert_array_equal(table.at(command, volts), table.thrust)


@given(tables(), st.floats(-1.0, 1.0), st.floats(0.5, 20.0))
def test_the_command_for_a_thrust_gives_it(table: ThrustTable, u: float, volts: float) -> None:
    thrust = table.at(u, volts)
    assert float(table.at(table.command_for(thrust, volts), volts)) == pytest.approx(float(thrust), abs=1e-9)


def test_no_thrust_is_no_command_and_a_little_is_beyond_the_dead_band() -> None:
    table = t200()
    assert table.command_for(0.0, 16.0) == 0.0
    assert 0.06 < table.command_for(0.01, 16.0) < 0.09
    assert -0.09 < table.command_for(-0.01, 16.0) < -0.06
    assert table.command_for([900.0, -900.0], 16.0).tolist() == [1.0, -1.0]


def test_a_curve_without_voltage_knows_none() -> None:
    table = curve_table(Curve(thrust=(-10.0, 0.0, 20.0), pwm=(1100.0, 1500.0, 1900.0)))
    assert table is not None
    assert not table.several
    assert table.at([-1.0, -0.5, 0.0, 0.25], [3.0, 12.0, 16.0, 99.0]).tolist() == [-10.0, -5.0, 0.0, 5.0]


@pytest.mark.parametrize(
    ("curve", "words"),
    [
        (Curve(thrust=(0.0, 1.0)), "either pwm or command"),
        (Curve(thrust=(-1.0, 1.0), pwm=(1100.0, 1900.0), command=(-1.0, 1.0)), "either pwm or command"),
        (Curve(thrust=(-1.0, 0.0, 1.0), command=(-1.0, 1.0)), "expected 2 numbers"),
        (Curve(thrust=(-1.0, 1.0), command=(1.0, -1.0)), "each above the one before"),
        (Curve(thrust=(1.0, -1.0), command=(-1.0, 1.0)), "above 0 at full command ahead"),
        (Curve(thrust=(-9.0, 5.0, -4.0, 9.0), command=(-1.0, -0.5, 0.5, 1.0)), "falls from 5 to -4"),
        (Curve(thrust=(-1.0, 1.0), command=(-1.0, 1.0), voltage=(12.0, 16.0)), "one for each command, got 1"),
        (Curve(thrust=((-1.0, 1.0),), command=(-1.0, 1.0), voltage=(12.0, 16.0)), "expected 2 rows"),
        (Curve(thrust=((-1.0, 1.0),) * 2, command=(-1.0, 1.0), voltage=(16.0, 12.0)), "curve.voltage"),
        (Curve(thrust=((-1.0, 1.0),) * 2, command=(-1.0, 1.0)), "need the key voltage"),
    ],
)
def test_what_is_no_table_is_told(curve: Curve, words: str) -> None:
    with pytest.raises(DataError, match=words):
        curve_table(curve)


def published(volts: float) -> tuple[np.ndarray, np.ndarray]:
    """Pulse widths [us] and thrust [N] of the maker's table."""
    if not PUBLISHED.is_dir():
        pytest.skip("the maker's tables are not beside this checkout (../shared/data/t200)")
    table = pl.read_csv(PUBLISHED / f"{volts:.0f}V.csv")
    table = table.rename({name: name.strip() for name in table.columns})
    return table["PWM"].to_numpy().astype(float), KGF * table["Force"].to_numpy().astype(float)


@pytest.mark.parametrize("volts", VOLTAGES)
def test_the_t200_is_the_makers(volts: float) -> None:
    pwm, thrust = published(volts)
    found = t200().at((pwm - 1500.0) / 400.0, volts)
    off = np.abs(found - thrust)
    assert off.max() <= TOLERANCE * thrust.max()
    assert np.count_nonzero(off > 1e-9) <= 4  # pairs of rows whose thrust falls where the pulse width rises
    assert (np.diff(found) >= 0.0).all()


def test_the_bluerov2_has_the_makers_thrust_at_16_volts() -> None:
    pwm, thrust = published(16.0)
    known = vehicle.read(bundled("vehicles/bluerov2_heavy.toml"))[0]
    for row in thruster_table(known):
        assert row[MAX_THRUST] == pytest.approx(thrust.max(), rel=TOLERANCE)
        assert row[MAX_REVERSE] == pytest.approx(-thrust.min(), rel=TOLERANCE)
    from hydro.core.recording.supply import effective_commands

    commands = np.repeat((pwm[:, None] - 1500.0) / 400.0, len(known.thruster), axis=1)
    share = effective_commands(known, commands)
    row = thruster_table(known)[0]
    given = np.where(share > 0.0, row[MAX_THRUST], row[MAX_REVERSE]) * share
    assert np.abs(given - thrust[:, None]).max() <= TOLERANCE * thrust.max()
    assert np.interp(1545.0, pwm, given[:, 0]) == pytest.approx(1.05, abs=0.1)
