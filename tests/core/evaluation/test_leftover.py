"""The force left over: closed forms of what was taken from a vehicle, and intervals that keep their level."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects import assemble
from hydro.core.errors import DataError
from hydro.core.evaluation.leftover import BINS, Means, block_mean, leftover, stands_out, steady_force
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import schema
from hydro.io import vehicle as files

TAKEN = 0.3
"""Share of the quadratic sway drag that the file lacks."""


def test_the_share_that_bins_explain_has_no_unit():
    """Half of the variance between bins and half within them, in whatever unit."""
    speed = np.repeat(np.arange(BINS, dtype=float), 100)
    step = np.repeat(np.where(np.arange(BINS) % 2, 1.0, -1.0), 100)
    force = step + np.tile([1.0, -1.0], len(speed) // 2)
    for unit in (1e-3, 1.0, 50.0):
        means = Means(
            np.tile(unit * force, (6, 1)).T, np.tile(speed, (6, 1)).T, np.ones(len(speed)), np.zeros(1)
        )
        assert means.explained(0, 1) == pytest.approx(np.var(step) / np.var(force), rel=0.05)


@pytest.fixture(scope="module")
def known(datasets) -> Vehicle:
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


@pytest.fixture(scope="module")
def raw(known) -> pl.DataFrame:
    """Six minutes of three sessions with sway of many speeds, and sensor noise."""
    rng, t = np.random.default_rng(3), np.arange(round(120 / 0.02)) * 0.02
    flown = []
    for name in "abc":
        tones = rng.uniform(0.15, 1.2, (8, 4)), rng.uniform(0, 2 * np.pi, (8, 4))
        demand = 0.22 * np.sin(tones[0][:, :, None] * t + tones[1][:, :, None]).sum(axis=1)
        columns = {f"cmd_{i + 1}": np.clip(one, -1, 1) for i, one in enumerate(demand)}
        flown.append(simulate(known, pl.DataFrame({"session": [name] * len(t), "t": t, **columns})))
    moved = pl.concat(flown)
    logged = disturb(moved.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    return moved.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


def with_sway_drag(vehicle: Vehicle, share: float) -> tuple[Vehicle, float]:
    """The vehicle with its quadratic sway drag times `share`, and what was taken [N s^2/m^2]."""
    (drag,) = vehicle.effects("quadratic_damping")
    diagonal = list(drag["diagonal"])
    taken = (1.0 - share) * diagonal[1]
    diagonal[1] *= share
    others = [one for one in vehicle.effect if one["name"] != "quadratic_damping"]
    return msgspec.structs.replace(vehicle, effect=(*others, {**drag, "diagonal": diagonal})), taken


@pytest.fixture(scope="module")
def found(known, raw) -> pl.DataFrame:
    lowered, _ = with_sway_drag(known, 1.0 - TAKEN)
    return leftover({0: lowered, 1: known}, raw)


def bins(table: pl.DataFrame, step: int, axis: str) -> pl.DataFrame:
    return table.filter(pl.col("force").is_not_null(), step=step, axis=axis)


def every(table: pl.DataFrame, step: int) -> pl.DataFrame:
    return table.filter(pl.col("force").is_not_null(), step=step)


def test_it_keeps_its_schema(found):
    schema.load("leftover").check(found, "leftover")
    assert bins(found, 0, "Y").filter(against="v").height == BINS


def test_a_drag_that_is_too_low_leaves_its_own_curve(known, found):
    """Over each bin the mean of -d |v| v, of which the force at the mean velocity is nearly the same."""
    _, taken = with_sway_drag(known, 1.0 - TAKEN)
    sway = bins(found, 0, "Y").filter(against="v")
    v = sway["velocity"].to_numpy()
    expected = -taken * np.abs(v) * v
    inside = (sway["low"].to_numpy() <= expected) & (expected <= sway["high"].to_numpy())
    assert inside.sum() >= BINS - 1
    fastest = np.abs(v).argmax()
    assert sway["force"][int(fastest)] == pytest.approx(expected[fastest], rel=0.15)
    assert sway["force"][int(fastest)] * v[fastest] < 0, "it acts on the vehicle, against its motion"


def test_intervals_of_the_true_vehicle_cover_zero(found):
    """Each of 60 bins with probability 0.95: fewer than 51 have one of 1,000."""
    true = bins(found, 1, "X").clear()
    for axis, against in zip("XYZKMN", VELOCITY, strict=True):
        true = true.vstack(bins(found, 1, axis).filter(against=against))
    covered = true.filter(pl.col("low") <= 0.0, pl.col("high") >= 0.0).height
    assert true["low"].null_count() == 0
    assert covered >= 51
    assert (true["high"] - true["low"]).max() < 15.0


def test_only_what_was_taken_stands_out(found):
    plain = {step: bins.filter(stands_out(bins)) for step in (0, 1) for bins in [every(found, step)]}
    assert set(plain[0]["axis"]) == {"Y"}
    assert plain[1].is_empty()


def test_the_own_curve_is_the_drag(known, found):
    (linear,), (quadratic,) = known.effects("linear_damping"), known.effects("quadratic_damping")
    d, dd = np.diag(np.diag(linear["diagonal"])), np.diag(np.diag(quadratic["diagonal"]))
    for i, (axis, against) in enumerate(zip("XYZKMN", VELOCITY, strict=True)):
        curve = found.filter(pl.col("force").is_null(), step=1, axis=axis, against=against)
        v = curve["velocity"].to_numpy()
        np.testing.assert_allclose(curve["model"], -d[i] * v - dd[i] * np.abs(v) * v, atol=1e-9)


def test_a_fluid_memory_exerts_nothing_in_steady_motion(known):
    """Its state is nu_r / a (Cummins 1962), begun as if the motion had always been."""
    memory = {"name": "fluid_memory", "K": [[50.0] * 6], "rates": [0.5]}
    with_it = msgspec.structs.replace(known, effect=(*known.effect, memory))
    speeds = np.array([-0.8, 0.0, 0.3])
    steady = steady_force(assemble(with_it), speeds, 1)
    np.testing.assert_allclose(steady, steady_force(assemble(known), speeds, 1), atol=1e-9)
    assert steady[0, 1] > 0.0 > steady[2, 1]


def test_intervals_keep_their_level_where_neighbours_share_their_errors():
    """Of twelve blocks with an error each, the interval covers zero in 95 % of recordings."""
    rng, blocks = np.random.default_rng(0), np.repeat(np.arange(12), 30)
    covered = 0
    for _ in range(2000):
        rows = rng.integers(1, 4, blocks.size).astype(float)
        mean, half, effective = block_mean(rng.normal(size=12)[blocks], rows, blocks)
        covered += abs(mean) <= half
    assert 0.935 <= covered / 2000 <= 0.97
    assert 10.0 < effective <= 12.0


def test_one_block_has_no_interval():
    assert block_mean(np.ones(3), np.ones(3), np.zeros(3, np.int64)) == (1.0, None, 1.0)


def test_a_slow_sensor_is_told(known, raw):
    row = pl.int_range(pl.len())
    slow = raw.with_columns(pl.when(row % 10 == 0).then(name).alias(name) for name in "uvw")
    with pytest.raises(DataError, match=r"velocity in 90 % of the rows, but samples are of u in 10 %, v in"):
        leftover({0: known}, slow)


def test_rows_without_a_sample_do_not_count(known, raw):
    row = pl.int_range(pl.len())
    gone = raw.with_columns(pl.when(row % 20 != 0).then(name).alias(name) for name in "uvw")
    table = leftover({0: known}, gone)
    assert bins(table, 0, "Y")["rows"].sum() == pytest.approx(0.95 * raw.height, rel=1e-3)
