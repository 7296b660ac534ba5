"""How well does an effect explain sessions that it was not fitted to?

Each rival is fitted anew without one session at a time, by the linear problem about its fit, and predicts the
session left out.  What is gained there is no matter of having many parameters, nor of one session that is
like no other.  A recording of fewer than three sessions is cut into stretches that are left out instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis import naming
from hydro.core.errors import DataError
from hydro.core.identification.levenberg_marquardt import PRIOR
from hydro.core.identification.normal_equations import Normal, block_length

SESSIONS = 3
"""Sessions from which whole sessions are left out."""
STRETCHES = 6
"""Stretches of equal length that are left out in turn where there are fewer."""


@dataclass(frozen=True)
class Fitted:
    """A model at its fit.

    Attributes:
        normal: The problem about its values, in units of the entries' scales.
        amounts: How far each entry has moved from where it is without data, in scales, (P,).
    """

    normal: Normal
    amounts: Array


@dataclass(frozen=True)
class Score:
    """What a rival explains of sessions left out.

    Attributes:
        share: Part of the error beyond the noise that it removes, over all of them, with
        low: the lower and
        high: the upper end of its 95 % interval.
        by_fold: The same of each session or stretch, in order; below 0 where it makes the error larger, and
            NaN where there is no error beyond the noise.
    """

    share: float
    low: float
    high: float
    by_fold: Array


def folds(session: ArrayLike) -> Rows:
    """What to leave out together: the number of a session, or of a stretch, for each shot.

    Args:
        session: Number of each shot's session, (S,), in the order of the recording.

    Raises:
        DataError: There are fewer than two shots.
    """
    numbers = np.asarray(session, np.int64)
    if len(numbers) < 2:
        raise DataError("one shot alone has nothing to be left out; record a longer session")
    names, label = np.unique(numbers, return_inverse=True)
    if len(names) >= SESSIONS:
        return np.asarray(label, np.int64)
    stretches = min(STRETCHES, len(numbers))
    return np.asarray(np.arange(len(numbers)) * stretches // len(numbers), np.int64)


def left_out_costs(fitted: Fitted, fold: Rows) -> Array:
    """Squared residual of each shot, predicted by the fit to all other folds, (S,).

    Entries that only the fold left out tells of go back to where they are without data.

    Args:
        fitted: The model.
        fold: What is left out with each shot, (S,), of `folds`.
    """
    matrix, score, costs = fitted.normal.matrix, fitted.normal.score, fitted.normal.gram[:, -1, -1].copy()
    prior = np.full(len(fitted.amounts), PRIOR**-2)
    seen = np.isfinite(costs)
    total, sums = matrix[seen].sum(axis=0) + np.diag(prior), score[seen].sum(axis=0)
    for number in np.unique(fold):
        out = (fold == number) & seen
        rest, pull = total - matrix[out].sum(axis=0), sums - score[out].sum(axis=0)
        step = np.linalg.solve(rest, pull - prior * fitted.amounts)
        costs[out] += np.einsum("i,sij,j->s", step, matrix[out], step) - 2.0 * score[out] @ step
    return costs


def scores(first: Fitted, rivals: Mapping[str, Fitted], session: ArrayLike) -> dict[str, Score]:
    """Share of the error of sessions left out that each rival removes.

    Args:
        first: The model without any of them, its own effects fitted.
        rivals: The model with each effect, by its name, over the same shots.
        session: Number of each shot's session, (S,).

    Returns:
        One score per rival, the best first.
    """
    fold = folds(session)
    before = left_out_costs(first, fold)
    found: dict[str, Score] = {}
    for name, rival in rivals.items():
        after = left_out_costs(rival, fold)
        both = np.isfinite(before) & np.isfinite(after)
        gain, excess = (before - after)[both], before[both] - first.normal.freedom
        found[name] = Score(
            *naming.share(gain, excess, block_length(rival.normal.score[both])),
            _by_fold(gain, excess, fold[both], int(fold.max()) + 1),
        )
    return dict(sorted(found.items(), key=lambda item: -item[1].share))


def _by_fold(gain: Array, excess: Array, fold: Rows, count: int) -> Array:
    """Share of each fold."""
    gained, left = (np.bincount(fold, weights=part, minlength=count) for part in (gain, excess))
    return np.where(left > 0.0, gained / np.where(left > 0.0, left, 1.0), np.nan)
