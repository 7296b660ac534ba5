"""Short predictions against a whole simulation, and the algebra that takes their beginnings out."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import damped, moved, noisy
from scipy.spatial.transform import Rotation

from hydro.core.errors import DataError
from hydro.core.prediction import multiple_shooting, sensitivity
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import (
    Normal,
    block_length,
    bounded_step,
    covariance,
    eliminate,
)
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.arrays import noise, recording, smoothed
from hydro.core.recording.segments import segments
from hydro.core.recording.shots import evenly, make_shots
from hydro.core.vehicle.frames import quaternion_from_euler


def exact(shots, record):
    """Shots begun at the logged state itself."""
    logged = np.hstack([record.eta[:, :3], quaternion_from_euler(*record.eta[:, 3:].T), record.nu])
    return replace(shots, first=logged[shots.starts])


@pytest.mark.parametrize(
    ("effect", "tolerance"),
    [
        ({"name": "command_delay", "d": 0.033}, 1e-5),
        ({"name": "thruster_lag", "dT": 0.2}, 1e-5),
        ({"name": "ocean_current", "v_N": 0.3}, 1e-5),
        # Memories are worked out along the smoothed motion, not the true one.
        ({"name": "fluid_memory", "K": [[30.0, 40.0, 50.0, 2.0, 5.0, 6.0]], "rates": [1.5]}, 1e-3),
    ],
)
def test_a_shot_from_within_a_session_follows_the_session(effect, tolerance):
    """Rotors, late commands and memories go on over the beginning of a shot; 500 Hz against 50 Hz steps."""
    vehicle = damped(effect)
    record = recording(vehicle, moved(vehicle, rows=600))
    shots = exact(make_shots(record), record)
    predicted = multiple_shooting.predict(multiple_shooting.prepare(candidate(vehicle), shots), shots)
    np.testing.assert_allclose(predicted[..., :3], shots.measured[..., :3], atol=tolerance)
    np.testing.assert_allclose(predicted[..., 7:], shots.measured[..., 7:], atol=tolerance)


def test_a_late_log_looks_back_on_what_was_before_the_comparison():
    vehicle = damped({"name": "sensor_delay", "d": 0.31}, {"name": "sensor_lever_arm", "r": [0.2, 0.1, 0.0]})
    raw = moved(vehicle, rows=600)
    record = recording(damped(), raw)
    truth = recording(damped(), moved(damped(), rows=600))
    shots = exact(make_shots(record, lead=0.5), truth)
    left = (
        multiple_shooting.residuals(multiple_shooting.prepare(candidate(vehicle), shots), shots) * shots.sigma
    )
    assert left.shape == (len(shots.starts), 100, 12)
    assert np.abs(left).max() < 1e-4


def test_initial_states_are_corrected_once_for_a_reference_point():
    """Correcting them again, or after a fit moved them, gives the same states of CO."""
    vehicle = damped({"name": "reference_point", "r": [-0.2, 0.1, 0.3]})
    record, truth = (recording(damped(), moved(of, rows=400)) for of in (vehicle, damped()))
    once = multiple_shooting.corrected_first(make_shots(record), candidate(vehicle))
    np.testing.assert_allclose(once.first[:, :3], truth.eta[once.starts, :3], atol=1e-3)
    fitted = replace(once, first=multiple_shooting.displaced(once.first, np.full((1, 12), 0.1)))
    for shots in (once, fitted):
        again = multiple_shooting.corrected_first(shots, candidate(vehicle))
        np.testing.assert_array_equal(again.first, once.first)


def test_noise_is_found_through_the_motion():
    raw = noisy(moved(damped(), rows=3000), 0)
    found = noise(recording(damped(), raw))
    np.testing.assert_allclose(found, np.repeat([0.02, 0.001, 0.01, 0.002], 3), rtol=0.06)


@pytest.mark.parametrize("apart", [2, 3, 5])
def test_noise_is_found_between_the_samples_of_a_slower_sensor(apart):
    """Straight lines between every few rows: as noisy as its samples."""
    raw = noisy(moved(damped(), rows=3000), 0)
    slow = {
        name: np.interp(raw["t"], raw["t"].gather_every(apart), raw[name].gather_every(apart))
        for name in ("x", "y", "z", "u", "v", "w")
    }
    found = noise(recording(damped(), raw.with_columns(**slow)))
    np.testing.assert_allclose(found, np.repeat([0.02, 0.001, 0.01, 0.002], 3), rtol=0.12)


def test_a_tumbling_vehicle_is_smoothed_through_the_vertical():
    """Loops about an axis askew: roll and heading jump, the attitude does not."""
    t = np.arange(1500) * 0.02
    turn = Rotation.from_euler("z", 20.0, degrees=True) * Rotation.from_rotvec(
        np.outer(1.1 * t, [0.02, 1.0, 0.01])
    )
    angles = turn.as_euler("ZYX")[:, ::-1]
    assert np.abs(np.diff(angles[:, 0])).max() > 2.0
    raw = moved(damped(), rows=1500).with_columns(
        phi=pl.Series(angles[:, 0]), theta=pl.Series(angles[:, 1]), psi=pl.Series(angles[:, 2])
    )
    eta, _ = smoothed(recording(damped(), raw))
    left = Rotation.from_euler("ZYX", eta[:, :2:-1]).inv() * turn
    assert left.magnitude().max() < 2e-4


def test_shots_never_reach_over_a_gap():
    raw = moved(damped(), rows=500)
    broken = raw[np.r_[0:230, 260:500]]
    record = recording(damped(), broken)
    shots = make_shots(record)
    assert len(segments(broken)) == 2
    for start in shots.starts:
        inside = (record.segments[:, 0] <= start) & (start + shots.length <= record.segments[:, 1])
        assert inside.sum() == 1
    with pytest.raises(DataError, match="record longer sessions"):
        make_shots(record, seconds=8.0)


@pytest.mark.parametrize(("count", "most"), [(10, 10), (10, 3), (15, 10), (8575, 1000), (7, 1)])
def test_shots_kept_are_spread_evenly_and_in_no_rhythm(count, most):
    kept = evenly(count, most)
    assert len(kept) == most == len(set(kept))
    stretch = count / most
    assert (np.abs(kept - (np.arange(most) + 0.5) * stretch) <= stretch / 2 + 1).all()
    if stretch > 4:  # a session of as many shots as a stretch shows its beginning, middle and end alike
        phase = kept % round(stretch)
        assert np.bincount(phase * 4 // round(stretch), minlength=4).min() > 0.15 * most or most < 10


def test_a_thinned_recording_keeps_some_of_the_shots_of_all_its_sessions():
    part = moved(damped(), rows=500)
    raw = pl.concat([part.with_columns(session=pl.lit(name)) for name in "abcde"])
    record = recording(damped(), raw)
    every, some = make_shots(record), make_shots(record, most=10)
    assert set(some.starts) < set(every.starts)
    assert set(some.segment) == set(range(5))
    at = np.searchsorted(every.starts, some.starts)
    np.testing.assert_array_equal(some.measured, every.measured[at])
    np.testing.assert_array_equal(some.first, every.first[at])
    np.testing.assert_array_equal(some.segment, every.segment[at])
    assert len(make_shots(record, most=1000).starts) == len(every.starts)


def test_beginnings_are_taken_out_as_least_squares_would():
    rng = np.random.default_rng(0)
    Z, X, e = rng.standard_normal((40, 3)), rng.standard_normal((40, 2)), rng.standard_normal((40, 1))
    whole = np.hstack([Z, X, e])
    left, follow = eliminate((whole.T @ whole)[None], 3, np.full(3, 1e-12))
    solution = np.linalg.lstsq(np.hstack([Z, X]), e[:, 0], rcond=None)[0]
    step = np.linalg.solve(left[0, :2, :2], left[0, :2, 2])
    np.testing.assert_allclose(step, solution[3:], rtol=1e-9)
    np.testing.assert_allclose(follow[0, :, 2] - follow[0, :, :2] @ step, solution[:3], rtol=1e-9)


def test_a_step_within_bounds_is_the_best_there():
    matrix, score = np.array([[2.0, 0.9], [0.9, 1.0]]), np.array([1.0, 3.0])
    low, high = np.array([-5.0, -5.0]), np.array([5.0, 1.0])
    step = bounded_step(matrix, score, low, high)
    grid = np.stack(np.meshgrid(np.linspace(-5, 5, 401), np.linspace(-5, 1, 241)), -1).reshape(-1, 2)
    costs = np.einsum("ki,ij,kj->k", grid, matrix, grid) - 2 * grid @ score
    assert step @ matrix @ step - 2 * score @ step <= costs.min() + 1e-9


def test_a_piece_that_knows_no_bounds_leaves_errors_finite_and_an_unseen_entry_to_the_prior():
    """One lost piece of a hundred: as if it had not been recorded.  Residuals four times the noise."""
    rng = np.random.default_rng(0)
    X, e = rng.standard_normal((100, 20, 3)), 4.0 * rng.choice([-1.0, 1.0], (100, 20, 1))
    X[..., 2] = 0.0
    both = np.concatenate([X, e], axis=2)
    gram = both.transpose(0, 2, 1) @ both
    gram[7] = 0.0
    gram[7, -1, -1] = np.inf
    normal = Normal(gram, 20, np.zeros((100, 1)), np.zeros((100, 0, 4)))
    assert normal.cost == np.inf
    assert normal.chi2 == pytest.approx(16.0)
    assert np.flatnonzero(normal.lost).tolist() == [7]
    errors = np.sqrt(np.diag(covariance(normal, np.full(3, 0.01))))
    np.testing.assert_allclose(errors[:2], 4.0 / np.sqrt(99 * 20), rtol=0.2)
    assert errors[2] == pytest.approx(10.0)


def test_a_shot_that_leaves_all_bounds_is_lost_and_no_other():
    """Drag too stiff for the steps: the faster shots grow without end, and take no others with them."""
    stiff = {"name": "quadratic_damping", "diagonal": [1e5, *synthetic.QUADRATIC[1:]]}
    record = recording(damped(), moved(damped(), rows=2000))
    shots = make_shots(record)
    known = damped()
    changed = msgspec.structs.replace(known, effect=(*known.effect[:-1], stiff))
    tame, wild = (multiple_shooting.prepare(candidate(vehicle), shots) for vehicle in (known, changed))
    normal = sensitivity.linearise(wild, [tame], [1.0], shots)
    assert 0 < normal.lost.sum() < len(normal.lost)
    assert np.isfinite(normal.matrix).all()
    assert multiple_shooting.cost(wild, shots) == np.inf
    # At the brink: a finite prediction whose derivative is not has no derivative, but counts.
    other = sensitivity.linearise(tame, [wild], [1e-12], shots)
    assert not other.lost.any()
    np.testing.assert_array_equal(other.matrix, 0.0)


def pieces(rng, count, correlated):
    """Linear problems with a known answer of 0, their noise white or alike over ten pieces."""
    X = rng.standard_normal((count, 20, 2)) + 1.0
    drift = np.repeat(rng.standard_normal((count // 10, 1, 1)), 10, axis=0) if correlated else 0.0
    e = rng.standard_normal((count, 20, 1)) + drift
    both = np.concatenate([X, e], axis=2)
    return Normal(both.transpose(0, 2, 1) @ both, 20, np.zeros((count, 1)), np.zeros((count, 0, 3)))


@pytest.mark.parametrize("correlated", [False, True])
def test_covariance_is_the_scatter_of_estimates(correlated):
    """Also where neighbouring pieces share an error, which the usual formula takes for information."""
    rng = np.random.default_rng(5)
    scores = []
    for _ in range(200):
        normal = pieces(rng, 400, correlated)
        estimate = np.linalg.solve(normal.matrix.sum(axis=0), normal.score.sum(axis=0))
        scores.append(estimate / np.sqrt(np.diag(covariance(normal, np.full(2, 1e-9)))))
    assert (block_length(normal.score) > 5) == correlated
    assert 0.6 < np.mean(np.square(scores)) < 1.35


def test_one_shift_moves_all_beginnings():
    rng = np.random.default_rng(0)
    first, shift = rng.standard_normal((400, 13)), rng.standard_normal((1, 12))
    each = np.vstack([multiple_shooting.displaced(one[None], shift) for one in first])
    np.testing.assert_array_equal(multiple_shooting.displaced(first, shift), each)


def test_anchored_initial_states_stay_near_the_log_whatever_the_model():
    """Without drag in the file, channels count as their residuals, but the logged states keep their weight.

    Free initial states take up some of the missing drag.
    """
    record = recording(damped(), noisy(moved(damped(), rows=1500), 0))
    bare = msgspec.structs.replace(damped(), effect=damped().effect[:1])
    free = OutputError.of(make_shots(record, seconds=5.0), bare)
    anchor = free.shots.anchored().anchor

    def away(problem):
        """Return the root mean square distance from the logged states in their standard deviations."""
        problem, changed = problem.reweighted(problem.linearise(bare, [], []))
        assert changed
        for _ in range(6):
            _, problem = problem.cost(bare, np.zeros(0), problem.linearise(bare, [], []))
        shots = replace(problem.shots, anchor=anchor)
        return np.sqrt(np.mean(multiple_shooting.initial_residuals(candidate(bare), shots) ** 2))

    assert away(free.anchored()) < 0.25 * away(free)
