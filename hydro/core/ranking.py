"""Do two measures of error rank models alike? Kendall's tau, with an interval over models and seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import kendalltau

from hydro.core.errors import DataError

Array = NDArray[np.float64]

SAMPLES = 2000
INTERVAL = (2.5, 97.5)  # percentiles


class Agreement(NamedTuple):
    """Kendall's tau-b of two rankings: 1 the same, -1 the reverse, 0 unrelated.

    `low` and `high` are the 95 % interval.  `p_value` is that of no relation, for so few models.
    """

    tau: float
    low: float
    high: float
    p_value: float


def agreement(first: Sequence[ArrayLike], second: Sequence[ArrayLike], *, seed: int = 0) -> Agreement:
    """How far two errors of the same models agree on which is better.

    Models are ranked by their means over seeds.  The interval draws models anew, for others could have been
    compared, and within every model seeds, the same for both errors, for they are of one trained network.

    Args:
        first: An error of every model, one number per seed, shapes (S_k,).
        second: The other error of the same networks.
        seed: Seed of the bootstrap.

    Raises:
        DataError: There are fewer than three models, or the two do not match.
    """
    one, other = ([np.asarray(values, dtype=np.float64) for values in table] for table in (first, second))
    if len(one) < 3 or [len(values) for values in one] != [len(values) for values in other]:
        raise DataError("a ranking needs three models or more, and both errors of every network")
    tau, p_value = _tau(one, other)
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(SAMPLES):
        seeds = [rng.integers(0, len(values), len(values)) for values in one]
        models = rng.integers(0, len(one), len(one))
        again = ([table[k][seeds[k]] for k in models] for table in (one, other))
        drawn.append(_tau(*again)[0])
    low, high = np.nanpercentile(drawn, INTERVAL)
    return Agreement(tau, float(low), float(high), p_value)


def _tau(first: list[Array], second: list[Array]) -> tuple[float, float]:
    found = kendalltau([values.mean() for values in first], [values.mean() for values in second])
    return float(found.statistic), float(found.pvalue)
