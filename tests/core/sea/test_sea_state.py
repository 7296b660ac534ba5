"""Waves in a recording: the water's motion from a vehicle's, and the sea that it is of."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.columns import POSE, VELOCITY, Array
from hydro.core.effects import assemble
from hydro.core.effects.waves import WAVES, drawn, harmonics
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import cost, prepare
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.sea.likelihood import coefficients, unlikely
from hydro.core.sea.sea_state import sea_state, shown
from hydro.core.sea.water_motion import water_motion
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.io import vehicle as vehicle_file

G, DT, SECONDS = 9.81, 0.2, 120.0
P = np.array([0.8, 6.0, 0.7, 2.3])
SEA: dict[str, Any] = {"name": "ocean_waves", "height": 0.8, "period": 6.0, "direction": 0.7, "peak": 2.3}


def water(rows: Array, t: Any, z: float) -> Array:
    """Velocity of the water at a depth, (N, 3), added up once more."""
    out = np.zeros((t.size, 3))
    for omega, k, a, b, north, east in rows:
        along = math.exp(-k * z) * (a * np.cos(omega * t) + b * np.sin(omega * t))
        out += np.stack([along * north, along * east, np.zeros(t.size)], axis=1)
        out[:, 2] += math.exp(-k * z) * (a * np.sin(omega * t) - b * np.cos(omega * t))
    return out


def record(segments: int, z: float) -> Any:
    """So much of a recording as a spectrum needs."""
    rows = round(SECONDS / DT)
    eta = np.zeros((segments * rows, 6))
    eta[:, 2] = z
    bounds = np.arange(segments)[:, None] * rows + [0, rows]
    return SimpleNamespace(dt=DT, segments=bounds, eta=eta)


def wandering(rng: np.random.Generator, rows: int) -> Array:
    """What errors of a model look like: more the slower."""
    return np.asarray(np.cumsum(rng.normal(size=(rows, 3)), axis=0) * 2e-3)


@pytest.mark.parametrize("seed", range(4))
def test_a_seas_parameters_are_within_their_standard_errors(seed: int) -> None:
    rng, log = np.random.default_rng(seed), record(3, 4.0)
    t = np.arange(round(SECONDS / DT)) * DT
    seas = [water(drawn(partial(harmonics, P, G), rng), t, 4.0) for _ in range(3)]
    found = sea_state(np.vstack(seas) + wandering(rng, 3 * t.size), log, G)
    assert found is not None
    assert found.telling > 300.0
    assert found.orbital > 100.0
    assert (np.abs(found.values - P) < 3.5 * np.sqrt(np.diag(found.spread))).all()
    assert found.parameters.keys() == found.errors.keys()
    expected = math.sqrt(np.mean([(sea**2).sum(axis=1) for sea in seas]))
    assert found.speed == pytest.approx(expected, rel=0.2)


def test_of_minutes_a_swells_peak_is_narrower_than_any_taper_parts() -> None:
    """Held against the spectrum itself, its enhancement came out too low and its period sure and wrong."""
    swell, minute = np.array([0.6, 8.0, 3.0, 4.0]), round(60.0 / DT)
    t, off = np.arange(minute, dtype=float) * DT, list[Array]()
    for seed in range(8):
        rng, log = np.random.default_rng(100 + seed), record(3, 4.0)
        log.segments, log.eta = np.arange(3)[:, None] * minute + [0, minute], log.eta[: 3 * minute]
        seas = [water(drawn(partial(harmonics, swell, G), rng), t, 4.0) for _ in range(3)]
        found = sea_state(np.vstack(seas) + wandering(rng, 3 * minute), log, G)
        assert found is not None
        off.append((found.values - swell) / np.sqrt(np.diag(found.spread)))
    assert np.abs(off).max() < 3.5
    assert np.sqrt(np.mean(np.square(off), axis=0)).max() < 1.6


def test_no_swell_is_narrower_than_the_catalogue_believes() -> None:
    """A sea of nearly one frequency, which would be the likelier, the greater the enhancement.

    Values are means of lognormals whose logarithm has a deviation of 1 at most.
    """
    peak = WAVES.parameter("peak").plausible
    assert peak is not None
    _, most = peak.at((), cast(Any, None))
    rng, log = np.random.default_rng(0), record(3, 4.0)
    t = np.arange(round(SECONDS / DT)) * DT
    narrow = partial(harmonics, np.array([0.6, 8.0, 3.0, 10.0 * most]), G)
    seas = [water(drawn(narrow, rng), t, 4.0) for _ in range(3)]
    found = sea_state(np.vstack(seas) + wandering(rng, 3 * t.size), log, G)
    assert found is not None
    assert 0.5 * most < found.values[3] < (1.0 + most) * math.exp(0.5) - 1.0


@pytest.mark.parametrize(("period", "told"), [(18.4, True), (19.6, False)])
def test_a_swell_is_told_unless_it_is_as_slow_as_drifts(period: float, told: bool) -> None:
    """In ten minutes waves of up to 20 s are looked for; what comes out next to that may be any slower."""
    rng, log = np.random.default_rng(0), record(1, 4.0)
    t = np.arange(round(600.0 / DT)) * DT
    log.segments, log.eta = np.array([[0, t.size]]), np.tile(log.eta[:1], (t.size, 1))
    swell = water(drawn(partial(harmonics, np.array([2.0, period, 3.0, 20.0]), G), rng), t, 4.0)
    found = sea_state(swell + wandering(rng, t.size), log, G)
    assert (found is not None) is told
    if found is not None:
        assert abs(found.values[1] - period) < 3.5 * math.sqrt(found.spread[1, 1])


@pytest.mark.parametrize("kind", ["alone", "sea", "apart"])
def test_the_likelihoods_gradient_is_its_own(kind: str) -> None:
    rng, log = np.random.default_rng(0), record(2, 4.0)
    t = np.arange(round(SECONDS / DT)) * DT
    seas = [water(drawn(partial(harmonics, P, G), rng), t, 4.0) for _ in range(2)]
    seen = coefficients(np.vstack(seas) + wandering(rng, 2 * t.size), log, G)
    assert seen is not None
    floor = rng.normal(scale=0.3, size=(3, 4))
    floor[:, 0] += np.log(seen.squares.mean(axis=0))
    places = {"sea": [-0.2, 0.0, 1.2, 1.1], "apart": [-1.0, -1.2, -0.8, 0.0, 1.1]}
    at = np.concatenate([floor.ravel(), places.get(kind, [])])

    def at_place(x: Array) -> tuple[float, Array]:
        return unlikely(seen, x[:12], **({} if kind == "alone" else {kind: x[12:]}))

    slopes = [(at_place(at + move)[0] - at_place(at - move)[0]) / 2e-5 for move in 1e-5 * np.eye(at.size)]
    np.testing.assert_allclose(at_place(at)[1], slopes, rtol=1e-4, atol=1e-4 * np.abs(slopes).max())


def test_what_wanders_is_no_sea() -> None:
    for seed in range(5):
        rng, log = np.random.default_rng(seed), record(2, 4.0)
        found = sea_state(wandering(rng, len(log.eta)), log, G)
        assert found is None or found.telling < 30.0


def test_a_swing_that_is_no_orbit_is_no_sea() -> None:
    """A force in heave, or one along a line, of one frequency."""
    for way in ([0.0, 0.0, 0.3], [0.2, 0.1, 0.2]):
        rng, log = np.random.default_rng(0), record(2, 4.0)
        t = np.arange(len(log.eta)) * DT
        found = sea_state(np.outer(np.sin(1.05 * t), way) + wandering(rng, t.size), log, G)
        assert found is None or found.orbital < 10.0


def test_too_short_a_recording_shows_none() -> None:
    log = record(1, 4.0)
    log.segments = np.array([[0, 60]])
    assert sea_state(np.zeros((60, 3)), log, G) is None


@pytest.fixture(scope="module")
def flown(datasets: Any) -> tuple[Any, pl.DataFrame, pl.DataFrame]:
    """A vehicle, its recording in waves, and the motion without noise."""
    vehicle = vehicle_file.read(datasets / "vehicles" / "auv151.toml")[0]
    rng, rows = np.random.default_rng(1), 2400
    t = np.arange(rows) * 0.05
    columns = {name: np.zeros(rows) for name in (*POSE, *VELOCITY)} | {"z": np.full(rows, 5.0)}
    columns |= {
        f"cmd_{i + 1}": 0.2 * np.sin(2 * np.pi * (rng.uniform(0.02, 0.2) * t + rng.uniform()))
        for i in range(len(vehicle.thruster))
    }
    table = pl.DataFrame({"session": ["a"] * rows, "t": t} | columns)
    truth = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, SEA))
    motion = simulate(truth, table, sea=5)
    logged = disturb(motion.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    return vehicle, motion.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY])), motion


def test_the_waters_motion_is_found_from_the_vehicles(flown: Any) -> None:
    vehicle, raw, motion = flown
    log = recording(vehicle, raw)
    found = water_motion(candidate(vehicle), log, Motion.of(log))
    program = assemble(msgspec.structs.replace(vehicle, effect=(*vehicle.effect, SEA)), sea=(5, 1))
    rows = program.flat[int(program.flat[5]) :].reshape(-1, 6)
    z, t = motion["z"].to_numpy(), motion["t"].to_numpy()
    true = np.vstack([water(rows, t[k : k + 1], max(z[k], 0.0)) for k in range(0, t.size, 7)])
    settled = slice(40, None)
    error = (found[::7] - true)[settled]
    assert true[settled].std() > 0.1
    assert np.sqrt((error**2).mean(axis=0)).max() < 0.02


def test_a_recording_shows_its_waves_and_shots_that_allow_for_them_leave_noise(flown: Any) -> None:
    vehicle, raw, _ = flown
    log = recording(vehicle, raw)
    found = shown(vehicle, log)
    assert found is not None
    assert (np.abs(found.values - P) < 3.5 * np.sqrt(np.diag(found.spread))).all()
    shots = make_shots(log)
    calm = OutputError.of(shots, vehicle).linearise(vehicle, [], [])
    waves = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, found.table))
    problem = OutputError.of(shots, waves)
    allowed = problem.linearise(waves, [], [])
    assert calm.chi2 > 50.0
    assert allowed.chi2 < 2.0
    left = allowed.gram[:, -1, -1] / allowed.freedom
    assert np.median(left) == pytest.approx(1.0, abs=0.15)
    assert allowed.freedom == calm.freedom
    moved, _ = problem.cost(waves, np.zeros(0), allowed)
    assert moved == pytest.approx(allowed.cost, rel=0.05)
    assert cost(prepare(candidate(waves), problem.shots), problem.shots) >= allowed.cost


def test_residuals_are_whitened_by_the_root_of_their_covariance(flown: Any) -> None:
    vehicle, raw, _ = flown
    shots = make_shots(recording(vehicle, raw), seconds=0.5, most=3)
    rng = np.random.default_rng(0)
    swell = rng.normal(size=(len(shots.starts), shots.length, 12, 4)) * shots.sigma[:, None] * 3.0
    shots = replace(shots, swell=swell)
    x = (swell / shots.sigma[:, None]).reshape(len(swell), shots.residuals, 4)
    for k in range(len(x)):
        values, vectors = np.linalg.eigh(np.eye(shots.residuals) + x[k] @ x[k].T)
        root = (vectors * values**-0.5) @ vectors.T
        found = shots.calmed(np.eye(shots.residuals)[None], slice(k, k + 1))[0]
        np.testing.assert_allclose(found, root, atol=1e-9)
