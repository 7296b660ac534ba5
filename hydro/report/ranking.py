"""Agreement of two rankings of models: Kendall's tau, with an interval over models and seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.evaluation.block_resampling import INTERVAL

RANKINGS_DRAWN = 2000
"""Number of bootstrap resamples."""


class Agreement(NamedTuple):
    """Agreement of two rankings, as Kendall's tau-b.

    Attributes:
        tau: Tau-b: 1 for equal rankings, -1 for reversed, 0 for unrelated rankings.
        low: Lower end of the 95 % interval.
        high: Upper end of the 95 % interval.
        p_value: p-value of the hypothesis of no relation.
    """

    tau: float
    low: float
    high: float
    p_value: float


def agreement(first: Sequence[ArrayLike], second: Sequence[ArrayLike], *, seed: int = 0) -> Agreement:
    """Return the agreement of two rankings of the same models, each by another error.

    Models are ranked by their means over seeds.  The interval resamples models, and seeds within each model.
    Both errors use the same resampled seeds, because they belong to the same trained networks.

    Args:
        first: First error of every model, one number for each of its S seeds, shapes (S,).
        second: Second error of the same networks, in the same order.
        seed: Seed of the bootstrap.

    Raises:
        DataError: There are fewer than three models, or the two do not match.
    """
    one, other = ([np.asarray(values, dtype=np.float64) for values in table] for table in (first, second))
    if len(one) < 3 or [len(values) for values in one] != [len(values) for values in other]:
        raise DataError("a ranking needs three models or more, and both errors of every network")
    means = [np.array([[values.mean() for values in table]]) for table in (one, other)]
    rng = np.random.default_rng(seed)
    seeds = [rng.integers(0, len(values), (RANKINGS_DRAWN, len(values))) for values in one]
    models = rng.integers(0, len(one), (RANKINGS_DRAWN, len(one)))
    again = (
        np.stack([values[chosen].mean(axis=1) for values, chosen in zip(table, seeds, strict=True)], axis=1)
        for table in (one, other)
    )
    drawn = _tau(*(np.take_along_axis(values, models, axis=1) for values in again))
    low, high = np.nanpercentile(drawn, INTERVAL)
    p_value = float(scipy.stats.kendalltau(*(values[0] for values in means)).pvalue)
    return Agreement(float(_tau(*means)[0]), float(low), float(high), p_value)


def no_better(errors: ArrayLike, best: ArrayLike) -> float:
    """Return the exact one-sided rank-sum p-value of the claim that a model has larger errors than the best.

    Args:
        errors: Errors of the model, one number per network, shape (S,).
        best: Errors of the model to compare with, shape (T,).
    """
    return float(scipy.stats.mannwhitneyu(errors, best, alternative="greater", method="exact").pvalue)


def _tau(first: Array, second: Array) -> Array:
    """Return Kendall's tau-b of every row of two tables (B, n), as (B,); NaN for a row of equal numbers."""
    signs = [_signs(table) for table in (first, second)]
    both, *own = ((a * b).sum(axis=(1, 2)) for a, b in (signs, *zip(signs, signs, strict=True)))
    with np.errstate(invalid="ignore"):
        tau: Array = both / np.sqrt(own[0] * own[1])
    return tau


def _signs(values: Array) -> Array:
    """Return the sign of the difference of every two numbers of a row (B, n), shape (B, n, n)."""
    larger = values[:, :, None] > values[:, None, :]
    return larger.astype(np.float64) - larger.transpose(0, 2, 1)
