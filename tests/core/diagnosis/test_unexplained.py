"""Steady wrenches tell a missing force from noise of any size, and what is left grows as it does."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis import unexplained
from hydro.core.identification.candidate import accelerations, candidate
from hydro.core.identification.fit import OutputError
from hydro.core.identification.multiple_shooting import make_shots
from hydro.core.recording.arrays import recording
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files

SIGMA = np.repeat([0.02, 0.001, 0.01, 0.002], 3)


@pytest.fixture(scope="module")
def known(datasets) -> Vehicle:
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


def left(believed: Vehicle, flown: Vehicle, *, noise: float, trusted: float) -> float:
    """Share that steady wrenches explain of 60 s with `noise` SIGMA, `trusted` SIGMA of it believed."""
    t = np.arange(3000) * 0.02
    commands = {f"cmd_{i}": 0.4 * np.sin((0.3 + 0.07 * i) * t + i) for i in range(1, 9)}
    still = dict.fromkeys((*POSE, *VELOCITY), 0.0) | {"z": 5.0}
    plan = pl.DataFrame({"session": ["a"] * len(t), "t": t, **commands}).with_columns(
        pl.lit(value).alias(name) for name, value in still.items()
    )
    motion = simulate(flown, plan)
    logged = motion.select(*POSE, *VELOCITY).to_numpy()
    logged = logged + noise * SIGMA * np.random.default_rng(1).standard_normal(logged.shape)
    record = recording(believed, motion.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY])))
    problem = OutputError.of(make_shots(record, sigma=trusted * SIGMA), believed)
    disturbed = list(unexplained.steadily_disturbed(believed))
    return unexplained.steady_disturbance(problem.linearise(believed, disturbed, [1.0] * unexplained.WRENCH))


@pytest.mark.parametrize("trusted", [1.0, 0.5, 3.0])
def test_noise_of_any_size_is_no_force(known, trusted):
    assert abs(left(known, known, noise=1.0, trusted=trusted)) < 0.01


def test_a_current_that_the_model_has_not_is_a_force(known):
    current = {"name": "ocean_current", "v_N": 0.2, "v_E": -0.1}
    flown = msgspec.structs.replace(known, effect=(*known.effect, current))
    assert left(known, flown, noise=1.0, trusted=1.0) > 0.3
    assert left(flown, flown, noise=1.0, trusted=1.0) < 0.01


def test_pulls_are_steady_forces_and_moments(known):
    """Six vehicles whose wrenches at one place, less the vehicle's own, span all six axes."""
    t = np.arange(10) * 0.02
    rows = {name: np.zeros(10) for name in (*POSE, *VELOCITY)}
    rest = pl.DataFrame({"session": ["a"] * 10, "t": t, **rows, **{f"cmd_{i}": 0.0 * t for i in range(1, 9)}})
    record = recording(known, rest)
    at_rest = accelerations(candidate(known), record, record.eta, record.nu)[0]
    pushed = [
        accelerations(candidate(one), record, record.eta, record.nu)[0] - at_rest
        for one in unexplained.steadily_disturbed(known)
    ]
    assert np.linalg.matrix_rank(np.array(pushed), tol=1e-9) == 6


@pytest.mark.parametrize("power", [0.0, 1.0, 2.0])
def test_how_a_force_grows(power):
    speed = np.random.default_rng(0).uniform(0.1, 1.5, 400)
    assert unexplained.growth(speed, (3.0 * speed**power) ** 2) == pytest.approx(power, abs=0.1)
    assert unexplained.growth(np.full(400, 0.5), np.ones(400)) is None
