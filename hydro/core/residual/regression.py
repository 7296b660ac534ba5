"""Regression of the residual hull force on a library of terms, from short predictions.

Every term of `residual.library` on every axis is a column of responses of the shots, computed by
`residual.response`.  Only the smoothed motion in the terms is differentiated.  The prior standard deviation
of a coefficient is the hull's size times a factor, which the held-out error selects.  The recording is
reduced to the normal equations of each stretch, the part of a recording that is held out at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array, Mask, Rows
from hydro.core.errors import DataError
from hydro.core.prediction.candidate import Candidate, candidate
from hydro.core.prediction.multiple_shooting import ENDLESS, SHOTS_TOGETHER, costs, prepare, residuals
from hydro.core.prediction.normal_equations import eliminate
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.residual.library import AXES, Flow, force, precision, sizes, terms
from hydro.core.residual.limits import FIT
from hydro.core.residual.response import Transitions, rows_of
from hydro.core.vehicle.description import Vehicle

FACTORS = 10.0 ** np.arange(-5.0, 0.01, 0.5)
"""Candidate factors on the prior standard deviations of the coefficients."""
EVERY = 0.06
"""Time between compared samples [s]: the response to a force is smooth, so not every row is needed."""
MARGIN = 0.1
"""Allowed extrapolation beyond the range of the training motion, relative to that range."""


@dataclass(frozen=True)
class Regression:
    """Fitted model of the residual hull force: coefficients of the F library terms.

    Attributes:
        coefficients: Coefficients of each term on each axis, (F, 6).
        left_out: Coefficients fitted without each stretch, (stretches, F, 6).
        factor: Selected factor on the prior standard deviations.
        errors: Squared held-out residual for each of FACTORS.
        low: Lower bound of velocity, acceleration and down vector (`Flow.columns`), (15,).
        high: Upper bound of the same columns, (15,).
        information: Information on the coefficients, of the recording and of their prior, in units of the
            noise and of the prior standard deviations, (6 F, 6 F).
    """

    coefficients: Array
    left_out: Array
    factor: float
    errors: Array
    low: Array
    high: Array
    information: Array

    def moved(self, step: Regression) -> Regression:
        """Return a copy with the coefficients of `step`, a fit with the same stretches, added."""
        coefficients, left_out = self.coefficients + step.coefficients, self.left_out + step.left_out
        return replace(self, coefficients=coefficients, left_out=left_out)

    def wrench(self, vehicle: Vehicle, shots: Shots, rows: Mask | None = None) -> Array:
        """Return the residual wrench on the vehicle about CO along a recording, (N, 6) [N, N m].

        The motion is clipped to the range of the training data, since products of velocities extrapolate
        without bound.

        Args:
            vehicle: The vehicle; its current and DVL errors determine the motion through the water.
            shots: Shots of the recording, with its smoothed motion.
            rows: Rows at which the wrench is computed, (N,), zero at all others; None for every row.
        """
        (found,) = self._wrenches(vehicle, shots, rows, [self.coefficients])
        return found

    def left_out_wrenches(self, vehicle: Vehicle, shots: Shots, rows: Mask | None = None) -> Iterator[Array]:
        """Yield the wrench by the coefficients without each stretch, as by `wrench`, (N, 6) [N, N m]."""
        return self._wrenches(vehicle, shots, rows, self.left_out)

    def terms(self, model: Candidate, shots: Shots) -> Array:
        """Return the F library terms at the rows of S shots, (S, length, F).

        The motion is clipped to the range of the training data.

        Args:
            model: The vehicle, whose current and DVL errors determine the motion through the water.
            shots: Shots of the recording, with its smoothed motion.
        """
        return terms_of(Flow.of(model, shots).within(self.low, self.high), shots)

    def _wrenches(
        self, vehicle: Vehicle, shots: Shots, rows: Mask | None, coefficients: Iterable[Array]
    ) -> Iterator[Array]:
        """Yield the wrench by each of several sets of coefficients (F, 6), see `wrench`, (N, 6) [N, N m]."""
        where = slice(None) if rows is None else rows
        flow = Flow.of(candidate(vehicle), shots).rows(where).within(self.low, self.high)
        for one in coefficients:
            found = np.zeros((shots.record.rows, AXES))
            found[where] = force(flow, one)
            yield found


def learn(vehicle: Vehicle, transitions: Transitions, fold: Rows) -> Regression:
    """Return the hull-force model whose library coefficients fit shots of an unchanged vehicle.

    Args:
        vehicle: Vehicle file.
        transitions: Shots of the recording, with their responses to forces.
        fold: Number of the stretch of each of S shots for cross-validation, (S,), from 0 on without a gap.

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
        information(whole, FACTORS[best]),
    )


def _bounds(columns: Array) -> tuple[Array, Array]:
    """Return lower and upper bounds of columns (N, C), each widened by MARGIN of its range, (C,) each."""
    low, high = columns.min(axis=0), columns.max(axis=0)
    margin = MARGIN * (high - low)
    return low - margin, high + margin


def _normal_equations(vehicle: Vehicle, transitions: Transitions, fold: Rows, prior: Array) -> Array:
    """Return [X, e]^T [X, e] of each stretch with initial states eliminated, (stretches, P + 1, P + 1).

    X are the responses to the P coefficients in units of their prior standard deviations, e the residuals.
    """
    shots = transitions.shots
    library = terms_of(Flow.of(transitions.model, shots), shots)
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


def answers(
    transitions: Transitions, library: Array, prior: Array, every: int | None = None
) -> Iterator[tuple[slice, Array]]:
    """Yield the responses of batches of shots to their initial states and to library terms on every axis.

    Args:
        transitions: Shots of the recording, with their responses to forces.
        library: The F terms at the rows of S shots, (S, length, F), as of `terms_of`.
        prior: Units of the coefficients, six axes for each term, (6 F,).
        every: Number of rows from one compared row to the next; by default that of `thinning`.

    Yields:
        Slice of s shots, and the responses of the compared rows in units of the noise, (s, rows, 12, 12 + 6
        F).
    """
    shots = transitions.shots
    thin = every or thinning(shots)
    begun = np.hstack([np.eye(CHANNELS), np.zeros((CHANNELS, prior.size))])
    for begin in range(0, len(shots.starts), SHOTS_TOGETHER):
        part = slice(begin, begin + SHOTS_TOGETHER)
        force = library[part]
        wrenches = np.zeros((*force.shape[:2], AXES, CHANNELS + prior.size))
        for axis in range(AXES):
            wrenches[:, :, axis, CHANNELS + axis :: AXES] = force * prior[axis::AXES]
        columns = transitions.answers(part, wrenches, begun)[:, shots.lead :: thin]
        columns /= shots.sigma[:, None]
        if (counted := shots.weights(part)) is not None:
            columns[~counted[:, ::thin]] = 0.0
        yield part, columns


def terms_of(flow: Flow, shots: Shots) -> Array:
    """Return the F library terms of the motion along a recording at the rows of S shots, (S, length, F)."""
    rows = rows_of(shots)
    return terms(flow.rows(rows.ravel())).reshape(*rows.shape, -1)


def thinning(shots: Shots) -> int:
    """Return how many rows lie from one compared row to the next, because not every row is compared.

    It is 1 where samples are rarer than rows.
    """
    return 1 if shots.seen is not None else max(round(EVERY / shots.record.dt), 1)


def robust(squares: Array) -> Array:
    """Return robust weights of S shots from their squared residuals (S,), 0 to 1, (S,).

    The weights are those of Student's t, relative to the median: a shot with FIT times the median has half
    the full weight.  Model errors grow with the motion; without weights, a few violent shots would dominate.
    """
    weight: Array = 1.0 / (1.0 + squares / (FIT * max(float(np.median(squares)), 1e-300)))
    return weight


def _solve(gram: Array, factor: float) -> Array:
    """Return the coefficients of a fit in units of their prior standard deviations, (P,).

    Args:
        gram: Normal equations with the residual, (P + 1, P + 1).
        factor: Factor on the prior standard deviations.
    """
    return np.asarray(np.linalg.solve(information(gram, factor), gram[:-1, -1]))


def information(gram: Array, factor: float) -> Array:
    """Return the information (inverse covariance) on P coefficients from data and prior, (P, P).

    Args:
        gram: Normal equations of the coefficients and the residual, (P + 1, P + 1), in units of the noise and
            of the prior standard deviations.
        factor: Factor on the prior standard deviations.
    """
    return np.asarray(gram[:-1, :-1] + factor**-2 * precision(len(gram) - 1))


def _error(gram: Array, found: Array) -> float:
    """Return the squared residual of a stretch with normal equations `gram` for coefficients (P,)."""
    return float(gram[-1, -1] - 2.0 * gram[-1, :-1] @ found + found @ gram[:-1, :-1] @ found)
