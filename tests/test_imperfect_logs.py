"""Spoilt logs have the properties that they are named after; flights under feedback do what they are told."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from scipy.stats import kurtosis

from benchmarks.hidden_effects import cases, vehicles
from benchmarks.imperfect_logs import closed_loop, sensors, study
from hydro.core.columns import POSE, VELOCITY
from hydro.core.vehicle.frames import rotation

DT, ROWS = 0.02, 6000
DVL = list(sensors.DVL)


@pytest.fixture(scope="module")
def clean():
    """Two sessions of smooth motion whose pose follows from its velocity; commands of two thrusters."""
    rng, parts = np.random.default_rng(5), []
    for session in ("a", "b"):
        t = np.arange(ROWS) * DT
        waves = np.zeros((8, ROWS))
        for wave in waves:
            for frequency in rng.uniform(0.05, 0.4, 4):
                wave += np.sin(2 * np.pi * (frequency * t + rng.uniform()))
        velocity = 0.2 * waves[:3].T
        angles = 0.1 * waves[3:6].T
        along = np.einsum("kij,kj->ki", rotation(*angles.T), velocity)
        steps = 0.5 * DT * (along[1:] + along[:-1])
        position = np.vstack([np.zeros((1, 3)), steps.cumsum(axis=0)])
        rates = np.gradient(angles, DT, axis=0)
        columns = dict(zip((*POSE, *VELOCITY), np.hstack([position, angles, velocity, rates]).T, strict=True))
        commands = {f"cmd_{i + 1}": wave for i, wave in enumerate(waves[6:])}
        parts.append(pl.DataFrame({"session": [session] * ROWS, "t": t} | columns | commands))
    return pl.concat(parts)


def late(clean, spoilt, name="u"):
    """By how much one column follows another [s]: the peak of their correlation, to parts of a row."""
    a, b = clean[name].to_numpy()[:ROWS], spoilt[name].to_numpy()[:ROWS]
    shifts = np.arange(-10, 40)
    match = [np.corrcoef(a[50 : ROWS - 50], b[50 + s : ROWS - 50 + s])[0, 1] for s in shifts]
    best = int(np.argmax(match))
    curve = np.polyfit(shifts[best - 2 : best + 3], match[best - 2 : best + 3], 2)
    return -0.5 * curve[1] / curve[0] * DT


@pytest.mark.parametrize("name", list(sensors.SPOILT))
def test_a_spoilt_log_keeps_its_rows_its_clock_and_what_it_does_not_spoil(clean, name):
    rng = np.random.default_rng(7)
    before = clean.clone()
    spoilt = sensors.SPOILT[name](clean, rng)
    assert clean.equals(before)
    assert spoilt.columns == clean.columns
    assert spoilt.select("session", "t").equals(clean.select("session", "t"))
    assert not spoilt.equals(clean)
    touched = {"quantised": [*POSE, *VELOCITY], "dead-reckoned": ["x", "y"], "repeated rows": clean.columns}
    kept = [c for c in clean.columns if c not in touched.get(name, DVL)]
    assert spoilt.select(kept).equals(clean.select(kept))
    assert spoilt.equals(sensors.SPOILT[name](clean, np.random.default_rng(7)))


def test_heavy_tails(clean):
    many = pl.concat([clean] * 10)
    noise = (sensors.heavy_tailed(many, np.random.default_rng(1)).select(DVL) - many.select(DVL)).to_numpy()
    middle = np.subtract(*np.percentile(noise, [75, 25])) / (2 * 0.7649)  # quartile of t(3)
    assert middle * np.sqrt(3.0) == pytest.approx(sensors.HEAVY, rel=0.02)
    assert kurtosis(noise, axis=None) > 5.0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["held at 5 Hz, late", "interpolated from 5 Hz, late"])
def test_five_readings_a_second_and_late(clean, name, seed):
    spoilt = sensors.SPOILT[name](clean, np.random.default_rng(seed))
    drawn = float(np.random.default_rng(seed).uniform(*sensors.LATE))  # what the function drew first
    extra = sensors.EVERY / 2 if name.startswith("held") else 0.0  # a held reading is half its age late
    assert late(clean, spoilt) == pytest.approx(drawn + extra, abs=0.012)
    steps = np.diff(spoilt["u"].to_numpy()[:ROWS])
    changes = np.flatnonzero(steps if name.startswith("held") else np.abs(np.diff(steps)) > 1e-9)
    rate = changes.size / (ROWS * DT)
    # a straight line bends at one or, where a reading falls between rows, two rows
    assert rate == pytest.approx(5.0, rel=0.02) if name.startswith("held") else 4.9 < rate < 10.1


@pytest.mark.parametrize("seed", range(4))
def test_a_filter_lags_and_wanders(clean, seed):
    lag = float(np.random.default_rng(seed).uniform(*sensors.LAG))
    spoilt = sensors.filtered(clean, np.random.default_rng(seed))
    assert late(clean, spoilt) == pytest.approx(lag, rel=0.25)
    still = clean.with_columns(pl.lit(0.3).alias(name) for name in DVL)
    error = pl.concat([sensors.filtered(still, np.random.default_rng(seed + 10 * k)) for k in range(5)])
    wander = error["v"].to_numpy().reshape(-1, ROWS) - 0.3
    assert wander.std() == pytest.approx(sensors.WANDER, rel=0.25)
    after = round(sensors.WANDERING / DT)
    likeness = np.mean(wander[:, after:] * wander[:, :-after]) / np.mean(wander**2)
    assert likeness == pytest.approx(np.exp(-1.0), abs=0.2)


def test_coarse_steps(clean):
    spoilt = sensors.quantised(clean, np.random.default_rng(0))
    for name, first in zip((*POSE, *VELOCITY), np.repeat(["x", "phi", "u", "p"], 3), strict=True):
        step = sensors.RESOLUTION[first]
        values = spoilt[name].to_numpy()
        assert np.abs(values / step - np.round(values / step)).max() < 1e-6
        assert np.abs(values - clean[name].to_numpy()).max() <= 0.5 * step * (1 + 1e-9)


def test_readings_without_bottom_lock(clean):
    spoilt = sensors.invalid(clean, np.random.default_rng(0))
    zero = spoilt.select(DVL).to_numpy() == 0.0
    assert (zero.all(axis=1) == zero.any(axis=1)).all()
    share, spread = zero.all(axis=1).mean(), np.sqrt(sensors.INVALID / len(zero))
    assert share == pytest.approx(sensors.INVALID, abs=4 * spread)
    valid = ~zero.all(axis=1)
    assert spoilt.filter(valid).equals(clean.filter(valid))


def test_rows_that_stand_twice(clean):
    spoilt = sensors.repeated(clean, np.random.default_rng(0))
    written = [name for name in clean.columns if name not in ("session", "t")]
    then, now = spoilt.select(written).to_numpy(), clean.select(written).to_numpy()
    same = (then[1:] == then[:-1]).all(axis=1)
    assert same.mean() == pytest.approx(sensors.REPEATED, abs=4 * np.sqrt(sensors.REPEATED / len(same)))
    assert (then[1:][~same] == now[1:][~same]).all()
    assert (then[[0, ROWS]] == now[[0, ROWS]]).all()  # no session begins with the other's end


def test_dead_reckoning_follows_the_velocities_and_drifts_with_their_noise(clean):
    exact = sensors.dead_reckoned(clean, np.random.default_rng(0))
    assert np.abs((exact.select("x", "y") - clean.select("x", "y")).to_numpy()).max() < 1e-9
    biased = sensors.dead_reckoned(clean.with_columns(pl.col("u") + 0.01), np.random.default_rng(0))
    off = np.hypot(*(biased.select("x", "y") - clean.select("x", "y")).to_numpy().T)
    assert off[ROWS - 1] == pytest.approx(0.01 * ROWS * DT, rel=0.05)
    assert off[[0, ROWS]].max() < 1e-12


def flight(task, preset="bluerov2_heavy", hidden=(), noise=1.0, rows=1500):
    given = vehicles.preset(preset)
    flown = closed_loop.sessions(given, given, hidden, task, rows=[rows], depth=10.0, noise=noise, seed=3)
    return next(flown)


def test_a_station_is_kept_against_a_current_that_is_seen_in_the_commands():
    given = vehicles.preset("bluerov2_heavy")
    stream = closed_loop.current(given, 3)
    calm, pushed = flight("station-keeping", rows=4000), flight("station-keeping", hidden=[stream], rows=4000)
    for raw in (calm, pushed):
        assert np.abs(raw.select("x", "y").to_numpy()).max() < 5.0
        assert raw["z"].is_between(7.0, 13.0).all()
    speed = np.hypot(stream["v_N"], stream["v_E"])
    drifted = speed * 4000 * DT
    assert np.hypot(*pushed.select("x", "y").row(-1)) < 0.2 * drifted
    commands = [c for c in calm.columns if c.startswith("cmd_")]

    def effort(raw):
        return np.abs(raw.select(commands).to_numpy()[1000:].mean(axis=0)).max()

    assert effort(pushed) > 2.0 * effort(calm)


def test_way_points_are_reached_in_their_order():
    raw = flight("way-points", noise=0.0, rows=6000)
    points = closed_loop.way_points(10.0, _rng_of_session())
    track = raw.select("x", "y", "z").to_numpy()
    reached, at = [], 0
    for row in range(len(track)):
        if np.linalg.norm(points[at, :3] - track[row]) < closed_loop.REACHED:
            reached.append(row)
            at += 1
    assert len(reached) >= 3
    assert np.abs(track[:, :2]).max() < 1.5 * closed_loop.BOX[0]


def _rng_of_session():
    """The generator of session 0 as it is when way-points are drawn."""
    rng = np.random.default_rng([3, 0, 29])
    rng.uniform(-np.pi, np.pi)
    rng.standard_normal((6000, 12))
    return rng


def test_the_controller_answers_to_the_noise_that_is_logged():
    quiet, noisy = flight("station-keeping", noise=0.0), flight("station-keeping", noise=1.0)
    names = [name for name in quiet.columns if name not in ("session", "t")]
    change = np.diff((noisy.select(names) - quiet.select(names)).to_numpy(), axis=0)
    seen, felt = change[:, :12], change[:, 12]  # from row to row the vehicle hardly moves, the noise does
    answer, *_ = np.linalg.lstsq(seen, felt, rcond=None)
    assert np.var(felt - seen @ answer) < 0.2 * np.var(felt)


def test_every_condition_can_be_logged_from_one_case():
    case = cases.draw("none", 3, "independent")
    logs = {}
    for condition in study.CONDITIONS:
        same, flown = study.logged(case, condition, 24.0)
        assert flown.measured.height == 1200
        logs[condition] = flown
        expected = {"ocean_current"} if condition.endswith("current") else set()
        assert {table["name"] for table in same.hidden} == expected
    for name in sensors.SPOILT:
        assert logs[name].held_out.equals(logs["clean"].held_out)
        assert not logs[name].measured.equals(logs["clean"].measured)
