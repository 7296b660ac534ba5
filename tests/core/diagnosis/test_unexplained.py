"""Steady wrenches tell a missing force from noise of any size, and what is left grows as it does."""

from __future__ import annotations

from types import SimpleNamespace

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis import unexplained
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.model import fit_model
from hydro.core.effects import inertia_matrix
from hydro.core.evaluation import remaining_force
from hydro.core.prediction.candidate import accelerations, candidate
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation
from hydro.io import vehicle as files

SIGMA = np.repeat([0.02, 0.001, 0.01, 0.002], 3)


def test_the_velocity_with_the_largest_growth_is_named_first():
    left = remaining_force.Leftover(axis=0, powers=(1.2, None, 2.1, 0.0, 1.6, None))
    assert left.growing() == (
        "; by velocities, it grows with w to the power 2.1, q to the power 1.6, u to the power 1.2"
    )
    assert "heave first" in left.experiment()


@pytest.fixture(scope="module")
def known(datasets) -> Vehicle:
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


def moving(flown: Vehicle, *, noise: float) -> pl.DataFrame:
    """60 s with `noise` SIGMA of white noise."""
    t = np.arange(3000) * 0.02
    commands = {f"cmd_{i}": 0.4 * np.sin((0.3 + 0.07 * i) * t + i) for i in range(1, 9)}
    still = dict.fromkeys((*POSE, *VELOCITY), 0.0) | {"z": 5.0}
    plan = pl.DataFrame({"session": ["a"] * len(t), "t": t, **commands}).with_columns(
        pl.lit(value).alias(name) for name, value in still.items()
    )
    motion = simulate(flown, plan)
    logged = motion.select(*POSE, *VELOCITY).to_numpy()
    logged = logged + noise * SIGMA * np.random.default_rng(1).standard_normal(logged.shape)
    return motion.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


def left(believed: Vehicle, flown: Vehicle, *, noise: float, trusted: float) -> float:
    """Share that steady wrenches explain of 60 s with `noise` SIGMA, `trusted` SIGMA of it believed."""
    record = recording(believed, moving(flown, noise=noise))
    problem = OutputError.of(make_shots(record, sigma=trusted * SIGMA), believed)
    return unexplained.steady_disturbance(unexplained.with_steady_wrenches(problem, believed))


def fitted_to_noise(believed: Vehicle, trusted: float):
    """60 s of the vehicle as it is believed, with SIGMA of noise, `trusted` SIGMA of it believed."""
    motion = moving(believed, noise=1.0)
    log = preprocess(believed, motion)
    problem = OutputError.of(make_shots(log.record, sigma=trusted * SIGMA), believed)
    return log, fit_model(believed, [], problem, log.track, 0)


def as_searched(log, model):
    """Baseline and outcome of a search that found nothing significant."""
    last = SimpleNamespace(significant=False, p_value=1.0)
    baseline = SimpleNamespace(refitted=model, log=log, problem=model.problem, calmed=0.0)
    return baseline, SimpleNamespace(model=model, last=last, found=())


@pytest.mark.parametrize("trusted", [1.0, 0.5, 3.0])
def test_noise_is_not_reported_as_a_force(known, trusted):
    assert abs(left(known, known, noise=1.0, trusted=trusted)) < 0.01


def test_a_missing_current_is_reported_as_a_force(known):
    current = {"name": "ocean_current", "v_N": 0.2, "v_E": -0.1}
    flown = msgspec.structs.replace(known, effect=(*known.effect, current))
    assert left(known, flown, noise=1.0, trusted=1.0) > 0.3
    assert left(flown, flown, noise=1.0, trusted=1.0) < 0.01


def test_a_residual_of_nine_times_the_noise_is_far_from_it(known):
    """White noise of three times its declared size: no test shows structure, and yet it is no fit."""
    log, model = fitted_to_noise(known, trusted=1.0 / 3.0)
    (one,) = unexplained.unexplained(*as_searched(log, model))
    assert one.verdict == "far_from_noise"
    assert f"mean squared residual {model.normal.chi2:.3g}" in one.advice
    assert 8.0 < model.normal.chi2 < 10.0
    assert unexplained.unexplained(*as_searched(*fitted_to_noise(known, trusted=1.0))) == []


def test_the_unexplained_error_names_the_velocities_it_grows_with():
    left = remaining_force.Leftover(1, 0.8, "Y", "above 0.4 m/s", 1.9, (None, 1.2, 0.1, None, None, 2.0))
    assert left.growing() == "; by velocities, it grows with r to the power 2.0, v to the power 1.2"
    assert "yaw first" in left.experiment()
    assert "without thrust" in remaining_force.Leftover(1, 0.8, "Y").experiment()


def test_pulls_span_all_wrenches_at_every_attitude(known):
    """Six independent ones at each of many attitudes, a heading of 90 degrees among them."""
    count, rng = 60, np.random.default_rng(3)
    t = np.arange(count) * 0.02
    columns = {name: np.zeros(count) for name in (*POSE, *VELOCITY)} | {
        f"cmd_{i}": 0.0 * t for i in range(1, 9)
    }
    attitude = rng.uniform([-np.pi, -1.4, -np.pi], [np.pi, 1.4, np.pi], (count, 3))
    attitude[:3] = [0.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2], [0.0, 0.0, 1.4]
    columns |= dict(zip(("phi", "theta", "psi"), attitude.T, strict=True))
    record = recording(known, pl.DataFrame({"session": ["a"] * count, "t": t} | columns))
    inertia = inertia_matrix(known)
    at_rest = accelerations(candidate(known), record, record.eta, record.nu)
    pushed = [
        (accelerations(candidate(one), record, record.eta, record.nu) - at_rest) @ inertia.T
        for one in unexplained.steadily_disturbed(known)
    ]
    mix = unexplained.wrenches_of_pulls(rotation(*record.eta[:, 3:].T))
    wrenches = np.einsum("pka,kpw->kaw", np.array(pushed), mix)
    unit = wrenches / np.linalg.norm(wrenches, axis=1, keepdims=True)
    assert np.linalg.svd(unit, compute_uv=False).min() > 0.3


@pytest.mark.parametrize("power", [0.0, 1.0, 2.0])
def test_growth_returns_the_power_of_a_force(power):
    speed = np.random.default_rng(0).uniform(0.1, 1.5, 400)
    assert remaining_force.growth(speed, (3.0 * speed**power) ** 2) == pytest.approx(power, abs=0.1)
    assert remaining_force.growth(np.full(400, 0.5), np.ones(400)) is None
