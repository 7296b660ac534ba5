"""What a hull does beside its file, as a regression of short predictions on a library of forces.

Every term of `residual.library` on every axis is a column of the shots by `residual.response`; nothing is
differentiated but the smoothed motion that the terms are made of.  Coefficients have the hull's size as
standard deviation, times a factor that is chosen by the error of stretches left out.  What is kept of the
recording is the normal equations of each stretch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

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
"""Times the hull's size that coefficients may be."""
EVERY = 0.06
"""Distance of the samples that are compared [s]: the answer to a force is smooth."""
MARGIN = 0.1
"""Part of the range of a motion by which another may go beyond it."""
TAIL = 3.0
"""Median squared residuals at which a shot counts half."""


@dataclass(frozen=True)
class Regression:
    """Coefficients of the library.

    Attributes:
        coefficients: (F, 6).
        left_out: The same of the fits without each stretch, (folds, F, 6).
        factor: Of the hull's size, as chosen.
        errors: Squared residual of stretches left out for every one of FACTORS.
        low: Least and
        high: greatest of each number of its motion (`Flow.columns`), and a little more, (15,).
    """

    coefficients: Array
    left_out: Array
    factor: float
    errors: Array
    low: Array
    high: Array

    def wrench(self, vehicle: Vehicle, shots: Shots) -> Array:
        """The wrench beside the file's at every row of a recording, (N, 6) [N, N m].

        Beyond the motion that it was learnt from it stays what it is at the edge: products of velocities
        know no bounds, and what they say there nothing has shown.

        Args:
            vehicle: Its current and velocity log say how the water passes.
            shots: Of the recording.
        """
        flow = Flow.of(candidate(vehicle), shots).within(self.low, self.high)
        found: Array = terms(flow) @ self.coefficients
        return found


def learn(vehicle: Vehicle, transitions: Transitions, fold: Rows) -> Regression:
    """Find the coefficients from shots in which nothing but the hull itself differs from the file.

    Args:
        vehicle: The file.
        transitions: Its shots.
        fold: Stretch of each shot, (S,), from 0 on without a gap.

    Raises:
        DataError: There are fewer than two stretches.
    """
    count = int(fold.max()) + 1
    if count < 2:
        raise DataError("one stretch alone has nothing to be left out; record a longer one")
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
    """Least and greatest of each column, (N, C), a MARGIN of the distance beyond its own, (C,) each."""
    low, high = columns.min(axis=0), columns.max(axis=0)
    margin = MARGIN * (high - low)
    return low - margin, high + margin


def _normal_equations(vehicle: Vehicle, transitions: Transitions, fold: Rows, prior: Array) -> Array:
    """[X, e]^T [X, e] of each stretch with the beginnings of its shots eliminated, (folds, P + 1, P + 1).

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
    """How a few shots at a time answer to their beginnings, and to every term of a library on every axis.

    Args:
        transitions: The shots.
        library: The terms at every row of the recording, (N, F).
        prior: Units of their coefficients, F of six axes each, (6 F,).

    Yields:
        Which shots, and answers of the rows that are compared, in units of the noise,
        (s, rows, 12, 12 + 6 F).
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
    """Rows from one that is compared to the next: all are where samples are rarer than rows."""
    return 1 if shots.seen is not None else max(round(EVERY / shots.record.dt), 1)


def robust(squares: Array) -> Array:
    """Weights of shots with these squared residuals, (S,): those of a Student's t about their median size.

    What a model errs by grows with the motion; unweighed, a few violent shots would be all that counts.
    """
    weight: Array = 1.0 / (1.0 + squares / (TAIL * max(float(np.median(squares)), 1e-300)))
    return weight


def _solve(gram: Array, factor: float) -> Array:
    """Coefficients in units of their prior standard deviations, (P,)."""
    known = gram[:-1, :-1] + factor**-2 * np.eye(len(gram) - 1)
    return np.asarray(np.linalg.solve(known, gram[:-1, -1]))


def _error(gram: Array, found: Array) -> float:
    """Squared residual of a stretch with coefficients (P,)."""
    return float(gram[-1, -1] - 2.0 * gram[-1, :-1] @ found + found @ gram[:-1, :-1] @ found)
