"""Regression of the residual hull force on a library of terms, from short predictions.

Every term of `residual.library` on every axis is a column of responses of the shots, computed by
`residual.response`.  Only the smoothed motion in the terms is differentiated.  The prior standard deviation
of a coefficient is the hull's size times a factor, which the held-out error selects.  The recording is
reduced to the normal equations of each stretch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.errors import DataError
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import ENDLESS, SHOTS_TOGETHER, costs, prepare, residuals
from hydro.core.prediction.normal_equations import eliminate
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.residual.library import AXES, Flow, sizes, terms
from hydro.core.residual.response import Transitions, rows_of
from hydro.core.vehicle.description import Vehicle

FACTORS = 10.0 ** np.arange(-5.0, 0.01, 0.5)
"""Candidate factors on the prior standard deviations of the coefficients."""
EVERY = 0.06
"""Time between compared samples [s]: the response to a force is smooth."""
MARGIN = 0.1
"""Extrapolation beyond the range of the training motion, relative to that range."""
TAIL = 3.0
"""Squared residual at which a shot has half weight, in units of the median."""


@dataclass(frozen=True)
class Regression:
    """Fitted coefficients of the library.

    Attributes:
        coefficients: (F, 6).
        left_out: Coefficients of the fits without each fold, (folds, F, 6).
        factor: Selected factor on the prior standard deviations.
        errors: Squared held-out residual for each of FACTORS.
        low: Lower bound of each column of the motion (`Flow.columns`), with a margin, (15,).
        high: Upper bound of each column, with a margin, (15,).
    """

    coefficients: Array
    left_out: Array
    factor: float
    errors: Array
    low: Array
    high: Array

    def without_folds(self) -> list[Regression]:
        """Return the fits without each fold."""
        return [replace(self, coefficients=each) for each in self.left_out]

    def moved(self, step: Regression) -> Regression:
        """Return the fit with the coefficients of another one of the same folds added."""
        coefficients, left_out = self.coefficients + step.coefficients, self.left_out + step.left_out
        return replace(self, coefficients=coefficients, left_out=left_out)

    def wrench(self, vehicle: Vehicle, shots: Shots) -> Array:
        """Return the residual wrench at every row of a recording, (N, 6) [N, N m].

        The motion is clipped to the range of the training data, since products of velocities extrapolate
        without bound.

        Args:
            vehicle: The vehicle; its current and DVL errors determine the motion through the water.
            shots: Of the recording.
        """
        flow = Flow.of(candidate(vehicle), shots).within(self.low, self.high)
        found: Array = terms(flow) @ self.coefficients
        return found


def learn(vehicle: Vehicle, transitions: Transitions, fold: Rows) -> Regression:
    """Fit the coefficients to shots of an unchanged vehicle.

    Args:
        vehicle: The file.
        transitions: Its shots.
        fold: Stretch of each shot, (S,), from 0 on without a gap.

    Raises:
        DataError: There are fewer than two stretches.
    """
    count = int(fold.max()) + 1
    if count < 2:
        raise DataError("cross-validation needs at least two stretches; record a longer log")
    prior = sizes(vehicle).ravel()
    grams = _normal_equations(vehicle, transitions, fold, prior)
    whole = grams.sum(axis=0)
    errors, fitted = [], []
    for factor in FACTORS:
        each = np.stack([_solve(whole - gram, factor) for gram in grams])
        fitted.append(each)
        errors.append(sum(_error(gram, found) for gram, found in zip(grams, each, strict=True)))
    best = int(np.argmin(errors))
    shape = (-1, AXES)
    return Regression(
        (prior * _solve(whole, FACTORS[best])).reshape(shape),
        (prior * fitted[best]).reshape(count, *shape),
        float(FACTORS[best]),
        np.array(errors),
        *_bounds(Flow.of(candidate(vehicle), transitions.shots).columns),
    )


def _bounds(columns: Array) -> tuple[Array, Array]:
    """Return lower and upper bounds of each column (N, C), widened by MARGIN of its range, (C,) each."""
    low, high = columns.min(axis=0), columns.max(axis=0)
    margin = MARGIN * (high - low)
    return low - margin, high + margin


def _normal_equations(vehicle: Vehicle, transitions: Transitions, fold: Rows, prior: Array) -> Array:
    """Return [X, e]^T [X, e] of each fold with the initial states eliminated, (folds, P + 1, P + 1).

    Columns are in units of their prior standard deviations.
    """
    shots, library = transitions.shots, terms(Flow.of(transitions.model, transitions.shots))
    prepared = prepare(candidate(vehicle), shots)
    thin = thinning(shots)
    known = np.broadcast_to(shots.trust**-2, (len(shots.starts), CHANNELS))
    size, weight = prior.size, robust(costs(prepared, shots))
    out = np.zeros((int(fold.max()) + 1, size + 1, size + 1))
    for part, columns in answers(transitions, library, prior):
        error = residuals(prepared, shots, None, part)[:, ::thin]
        flat = np.concatenate([columns, error[..., None]], axis=-1).reshape(
            len(columns), -1, CHANNELS + size + 1
        )
        tame = (np.abs(flat) < ENDLESS).all(axis=(1, 2))
        gram = np.stack([one.T @ one for one in flat[tame]]) * thin
        left, _ = eliminate(gram, CHANNELS, known[part][tame])
        np.add.at(out, fold[part][tame], weight[part][tame, None, None] * left)
    return out


def answers(transitions: Transitions, library: Array, prior: Array) -> Iterator[tuple[slice, Array]]:
    """Yield the responses of batches of shots to initial states and library terms on every axis.

    Args:
        transitions: The shots.
        library: The terms at every row of the recording, (N, F).
        prior: Units of their coefficients, F of six axes each, (6 F,).

    Yields:
        The slice of shots, and the responses of the compared rows in units of the noise, (s, rows, 12, 12 + 6
        F).
    """
    shots, thin = transitions.shots, thinning(transitions.shots)
    begun = np.hstack([np.eye(CHANNELS), np.zeros((CHANNELS, prior.size))])
    for begin in range(0, len(shots.starts), SHOTS_TOGETHER):
        part = slice(begin, begin + SHOTS_TOGETHER)
        force = library[rows_of(shots, part)]
        wrenches = np.zeros((*force.shape[:2], AXES, CHANNELS + prior.size))
        for axis in range(AXES):
            wrenches[:, :, axis, CHANNELS + axis :: AXES] = force * prior[axis::AXES]
        columns = transitions.answers(part, wrenches, begun)[:, shots.lead :: thin]
        columns /= shots.sigma[:, None]
        if (counted := shots.weights(part)) is not None:
            columns[~counted[:, ::thin]] = 0.0
        yield part, columns


def thinning(shots: Shots) -> int:
    """Return the row step between compared rows; 1 where samples are rarer than rows."""
    return 1 if shots.seen is not None else max(round(EVERY / shots.record.dt), 1)


def robust(squares: Array) -> Array:
    """Return robust weights of shots from their squared residuals, (S,): Student's t about the median.

    Model errors grow with the motion; without weights, a few violent shots would dominate.
    """
    weight: Array = 1.0 / (1.0 + squares / (TAIL * max(float(np.median(squares)), 1e-300)))
    return weight


def _solve(gram: Array, factor: float) -> Array:
    """Return coefficients in units of their prior standard deviations, (P,)."""
    known = gram[:-1, :-1] + factor**-2 * np.eye(len(gram) - 1)
    return np.asarray(np.linalg.solve(known, gram[:-1, -1]))


def _error(gram: Array, found: Array) -> float:
    """Return the squared residual of a stretch with coefficients (P,)."""
    return float(gram[-1, -1] - 2.0 * gram[-1, :-1] @ found + found @ gram[:-1, :-1] @ found)
