"""Trials and searches of a file whose residual is far above the noise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.diagnosis.confidence import folds
from hydro.core.diagnosis.search import Search, most_gain
from hydro.core.diagnosis.settings import FAR_FROM_NOISE
from hydro.core.evaluation.score_test import Evidence
from hydro.core.explanation.screening import promising
from hydro.core.explanation.trials import Quick, Recordings, _fit_together, _pairs
from hydro.core.prediction import multiple_shooting
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.output_error import INTEGRATION_ERROR, OutputError
from hydro.core.recording.arrays import Recording, recording
from hydro.core.recording.shots import make_shots
from hydro.core.vehicle.description import Vehicle

SLOW = 5
"""Rows of the simulation for one of the log, which then has 10 rows a second."""
PAYLOAD = {"name": "payload", "mass": 1.5, "w": 8.0, "x": 0.2, "z": 0.1}


@pytest.fixture(scope="module")
def record() -> Recording:
    """A vehicle with a payload at its bow, logged at 10 Hz."""
    return recording(damped(), moved(damped(PAYLOAD), rows=5000)[::SLOW])


def study(record: Recording, sigma: float) -> Recordings:
    """A recording with so much noise, without a held-out one."""
    noise = np.full(12, sigma)

    def shots(seconds: float) -> Any:
        return make_shots(record, seconds=seconds, sigma=noise)

    track = np.column_stack([record.eta[:, :3], record.t])
    log = SimpleNamespace(record=record, track=track, shots=shots, noise=noise)
    yardstick = SimpleNamespace(weights=SimpleNamespace(velocity=np.ones(6)), vehicle=damped())
    return Recordings(cast(Any, log), None, cast(Any, yardstick), None)


def bare() -> Vehicle:
    """The file without damping."""
    return msgspec.structs.replace(damped(), effect=damped().effect[:-2])


def test_longer_integration_steps_have_an_error_that_is_small_beside_the_residual(record):
    problem = OutputError.of(make_shots(record, sigma=np.full(12, 1e-4)), bare())
    coarse, most = problem.coarsened(bare()), multiple_shooting.most_steps(problem.shots)
    steps = coarse.shots.steps
    assert steps is not None
    assert steps < most == 5
    prepared = multiple_shooting.prepare(candidate(bare()), problem.shots)
    fine, other = (multiple_shooting.residuals(prepared, one.shots) for one in (problem, coarse))
    error, size = (np.sqrt((one**2).mean(axis=(0, 1))) for one in (other - fine, fine))
    assert (error > 0.0).all()
    assert (error < 2.0 * INTEGRATION_ERROR * size).all()


@pytest.mark.parametrize(("sigma", "coarse"), [(1e-6, True), (1.0, False)])
def test_only_fits_far_from_the_noise_have_longer_integration_steps(record, sigma, coarse):
    ahead = study(record, sigma).ahead(damped(), 24)
    assert ahead is not None
    assert (ahead.shots.steps is not None) is coarse


def screening(left: float, chi2: float) -> Any:
    """One column that leaves so much of the residual, of a model so far from the noise."""
    gram = np.array([[[1.0, np.sqrt(1.0 - left)], [np.sqrt(1.0 - left), 1.0]]])
    evidence = Evidence.of(Normal(gram, 1, np.zeros((1, 12)), np.zeros((1, 0, 2))))
    return SimpleNamespace(evidence=evidence, model=SimpleNamespace(normal=SimpleNamespace(chi2=chi2)))


@pytest.mark.parametrize(("left", "far", "in_vain"), [(0.9, 2.0, True), (0.1, 2.0, False), (0.9, 0.5, False)])
def test_a_search_ends_where_all_effects_together_stay_far_from_the_noise(left, far, in_vain):
    assert Search(cast(Any, None)).in_vain(screening(left, far * FAR_FROM_NOISE)) is in_vain


def test_a_curved_effect_may_gain_more_than_its_linear_problem_shows():
    assert most_gain("linear_damping", 2.0) == 2.0
    assert most_gain("tether", 2.0) > 2.0


def test_effects_are_ranked_by_equation_error_where_predictions_leave_the_motion(record):
    """The file has its centre of buoyancy far below that of gravity, so its predictions turn over."""
    unstable = msgspec.structs.replace(
        damped(PAYLOAD), buoyancy=msgspec.structs.replace(damped().buoyancy, center=(0.0, 0.0, 0.3))
    )
    far = study(record, 1e-4)
    problem = OutputError.of(far.problem.shots, unstable)
    fold = folds(problem.shots.session)
    by_predictions, by_equations = (
        [one["name"] for one in ranked].index("buoyancy_offset")
        for ranked in (promising(unstable, [], problem, fold, far.log.track), far.promising(unstable, []))
    )
    assert by_equations < 3 < by_predictions


def quick(effect: str, error: float) -> Quick:
    return Quick({effect: {"name": effect}}, [effect], cast(Any, None), False, error)


def test_pairs_are_of_the_best_candidates():
    tried = [quick(name, error) for name, error in zip("abcda", (0.5, 0.2, 0.9, 0.3, 0.1), strict=True)]
    assert [list(pair) for pair in _pairs(tried)] == [["a", "b"], ["a", "d"], ["b", "d"]]


@pytest.mark.parametrize(("sigma", "begins"), [(1e-4, "quick fit"), (0.1, "file")])
def test_the_joint_fit_far_from_the_noise_continues_the_quick_fit(record, sigma, begins, monkeypatch):
    """Near the noise it begins with a fit from the file, weighted by the noise."""
    begun = list[str]()

    def stop(vehicle: Vehicle, *rest: Any, **more: Any) -> Any:
        begun.append("quick fit" if vehicle is tried else "file")
        raise StopIteration

    tried = msgspec.structs.replace(damped(), name="tried")
    monkeypatch.setattr("hydro.core.explanation.trials.fit_model", stop)
    monkeypatch.setattr("hydro.core.explanation.trials.weighed_fit", stop)
    with pytest.raises(StopIteration):
        _fit_together(damped(), study(record, sigma), ["linear_damping"], damped(), tried)
    assert begun == [begins]
