"""Test for feedback: whether the commands of a recording depend on its motion, as with a pilot or controller.

Under feedback the input is correlated with disturbances, and an estimate mistakes part of a disturbance for a
coefficient (U. Forssell and L. Ljung, Closed-loop identification revisited, Automatica 35, 1215-1241, 1999).
A measurement of a row precedes the effect of that row's command.  So, given the past of both, a planned
command holds no information on the motion of its own row, but a controller's command follows from it
(instantaneous causality: C. W. J. Granger, Econometrica 37, 424-438, 1969).  The demanded wrench is predicted
axis by axis, from the past alone, and from the past with the row's pose and velocity.  Each prediction is
fitted to one part of the log and judged on the others.  Jumps of set points are outliers with a small weight
(Huber 1964).

A weak hold of depth or attitude in addition to an excitation is feedback too, but causes little bias.  So a
significant prediction is not sufficient: the gains on pose and velocity, applied to the motion, must also
explain a large share of the change of the demand over a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from hydro.core.columns import DOF, POSE, VELOCITY, Array, Mask, Rows
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST, POWER, configuration_matrix, thruster_table

PAST = 3
"""Number of past rows in both models."""
SECOND = 1.0
"""Time over which changes of the demand are compared with the motion [s]."""
FOLDS, LEAST_ROWS, MOST_ROWS = 6, 600, 60_000
BLOCK = 250
"""Rows of one observation in the test; blocks are kept whole if there are more than MOST_ROWS."""
ALPHA = 1e-3
"""Probability of a false alarm over all axes."""
MATERIAL = 0.3
"""Minimum share of the demand's changes over SECOND that the motion explains."""
HUBER, ROUNDS = 2.0, 5  # limit of outliers in robust standard deviations; rounds of weights
RIDGE = 1e-10


@dataclass(frozen=True)
class Feedback:
    """Result of the feedback test.  The demand is the wrench of the commanded thrusts.

    Attributes:
        share: Fraction of the demand's squared changes over one second that follow from pose and velocity,
            over all axes.
        by_axis: The same fraction for each axis, (6,); 0 for axes without thrust.
        p_values: p-value of that dependence for each axis, (6,); 1 where the fraction is below MATERIAL.
        opposing: Whether the demand of each axis opposes its motion, (6,).
    """

    share: float
    by_axis: Array
    p_values: Array
    opposing: Mask

    @property
    def significant(self) -> Mask:
        """Whether the commands depend significantly on pose or velocity on each axis, (6,)."""
        return (self.p_values <= ALPHA / len(DOF)) & (self.by_axis >= MATERIAL)

    @property
    def axes(self) -> tuple[int, ...]:
        """Axes, 0 (surge) to 5 (yaw), on which the commands depend significantly on pose or velocity."""
        return tuple(int(i) for i in np.flatnonzero(self.significant))

    @property
    def held(self) -> Mask:
        """Whether the demand depends on the motion of each axis and opposes it, (6,)."""
        return self.significant & self.opposing

    @property
    def closed(self) -> bool:
        """Whether the commands depend significantly on the motion on at least one axis."""
        return bool(self.axes)

    def words(self) -> str:
        """Return text on the axes with feedback, such as `heave to z and w (40%)`; empty without feedback.

        The percentage is the fraction of the demand's changes that the motion predicts.
        """
        return "; ".join(
            f"{DOF[i]} to {POSE[i]} and {VELOCITY[i]} ({self.by_axis[i]:.0%})" for i in self.axes
        )


@dataclass(frozen=True)
class _Problem:
    """Prediction of one axis' demand from the past and from the row's own motion.

    Attributes:
        demand: (K,).
        past: Past demand, pose and velocity, with a constant, (K, 3 PAST + 1).
        now: Pose and velocity of the row minus those of the row before, (K, 2).
        rows: Rows of the recording, (K,).
    """

    demand: Array
    past: Array
    now: Array
    rows: Rows


def feedback(vehicle: Vehicle, record: Recording) -> Feedback:
    """Test whether the commands of a recording depend on its motion.

    Args:
        vehicle: The vehicle, for the wrench that its thrusters give.
        record: The recording.

    Returns:
        The result, with a share of 0 if the recording is too short.
    """
    demand, state = _demand(vehicle, record), _state(record)
    span = max(round(SECOND / record.dt), 1)
    begin = np.concatenate([np.arange(a, max(b - span, a)) for a, b in record.segments])
    shares, p_values, opposing, total, left = np.zeros(6), np.ones(6), np.zeros(6, bool), 0.0, 0.0
    for axis in range(6):
        motion = state[:, [axis, 6 + axis]]
        problem = _problem(record, demand[:, axis], motion)
        if problem is None or not np.ptp(problem.demand) > 0.0:
            continue
        laws = _laws(problem)
        gains = np.median(laws[:, -2:], axis=0)
        changes = demand[begin + span, axis] - demand[begin, axis]
        moved = motion[begin + span] - motion[begin]
        made, opposing[axis] = moved @ gains, np.std(moved, axis=0) @ gains < 0.0
        whole, rest = float((changes**2).sum()), float(((changes - made) ** 2).sum())
        shares[axis] = max(1.0 - rest / max(whole, 1e-300), 0.0)
        if shares[axis] >= MATERIAL:
            p_values[axis] = _chance(problem, laws)
        total, left = total + whole, left + min(rest, whole)
    return Feedback(1.0 - left / total if total > 0.0 else 0.0, shares, p_values, opposing)


def _demand(vehicle: Vehicle, record: Recording) -> Array:
    """Return the wrench demanded by the commands, (N, 6), as a share of the maximum of all thrusters."""
    table, B = thruster_table(vehicle), configuration_matrix(vehicle)
    size = np.abs(record.commands) ** table[:, POWER]
    thrust = np.where(record.commands > 0.0, table[:, MAX_THRUST], -table[:, MAX_REVERSE]) * size
    most = np.abs(B) @ table[:, MAX_THRUST]
    wrench: Array = thrust @ B.T / np.where(most > 1e-9 * max(most.max(), 1e-9), most, np.inf)
    return wrench


def _state(record: Recording) -> Array:
    """Return pose and velocity as seen by a controller, (N, 12): displacements along body axes."""
    eta, turned = record.eta.copy(), rotation(*record.eta[:, 3:].T)
    for first, last in record.segments:
        eta[first:last, 3:] = np.unwrap(eta[first:last, 3:], axis=0)
        moved = np.diff(eta[first:last, :3], axis=0, prepend=eta[first : first + 1, :3])
        eta[first:last, :3] = np.einsum("kji,kj->ki", turned[first:last], moved).cumsum(axis=0)
    return np.hstack([eta, record.nu])


def _problem(record: Recording, demand: Array, motion: Array) -> _Problem | None:
    """Return the prediction of one axis' demand (N,) from its motion (N, 2); None for too few rows."""
    rows = np.concatenate([np.arange(a + PAST, max(b, a + PAST)) for a, b in record.segments])
    rows = rows[rows // BLOCK % (1 + len(rows) // MOST_ROWS) == 0]
    if len(rows) < LEAST_ROWS:
        return None
    past = [demand[rows - i] for i in range(1, PAST + 1)]
    past += [motion[rows - i, k] - motion[rows - 1, k] for i in range(2, PAST + 1) for k in (0, 1)]
    past += [motion[rows - 1, k] for k in (0, 1)] + [np.ones(len(rows))]
    return _Problem(demand[rows], np.column_stack(past), motion[rows] - motion[rows - 1], rows)


def _folds(problem: _Problem) -> Iterator[tuple[Mask, Mask]]:
    """Yield the held-out rows of each fold, and all others, (K,) each."""
    fold = np.arange(len(problem.demand)) * FOLDS // len(problem.demand)
    return ((fold == number, fold != number) for number in range(FOLDS))


def _laws(problem: _Problem) -> Array:
    """Return the laws with past and motion, fitted without each fold, (FOLDS, 3 PAST + 3); gains are last."""
    both = np.hstack([problem.past, problem.now])
    return np.array([_robust(both[rest], problem.demand[rest])[0] for _, rest in _folds(problem)])


def _chance(problem: _Problem, laws: Array) -> float:
    """Return the p-value of the gain in prediction by the row's motion over the past alone."""
    both, gain = np.hstack([problem.past, problem.now]), np.zeros(len(problem.demand))
    for law, (out, rest) in zip(laws, _folds(problem), strict=True):
        alone, limit = _robust(problem.past[rest], problem.demand[rest])
        before = _loss(problem.demand[out] - problem.past[out] @ alone, limit)
        gain[out] = before - _loss(problem.demand[out] - both[out] @ law, limit)
    starts = np.flatnonzero(np.diff(problem.rows // BLOCK, prepend=-1))
    blocks = np.add.reduceat(gain, starts)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = blocks.mean() / (blocks.std(ddof=1) / np.sqrt(len(blocks)))
    p = float(scipy.special.stdtr(len(blocks) - 1, -size))
    return p if np.isfinite(p) else 1.0


def _robust(X: Array, y: Array) -> tuple[Array, float]:
    """Return Huber's estimate of a linear law, and the limit above which an error is an outlier."""
    weight, least = np.ones(len(y)), 1e-3 * float(np.sqrt((y**2).mean())) + 1e-300
    size = np.sqrt((X**2).mean(axis=0)) + 1e-300
    unit, ridge = X / size, RIDGE * len(y) * np.eye(X.shape[1])
    for _ in range(ROUNDS):
        root = np.sqrt(weight)
        scaled = unit * root[:, None]
        law = np.linalg.solve(scaled.T @ scaled + ridge, scaled.T @ (root * y)) / size
        error = np.abs(y - X @ law)
        limit = HUBER * max(1.4826 * float(np.median(error)), least)
        weight = np.minimum(1.0, limit / np.maximum(error, 1e-300))
    return np.asarray(law), limit


def _loss(error: Array, limit: float) -> Array:
    """Return Huber's loss."""
    size = np.abs(error)
    return np.asarray(np.where(size <= limit, size**2, 2.0 * limit * size - limit**2))
