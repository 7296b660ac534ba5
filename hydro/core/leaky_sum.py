"""Leaky sum, the recursion of first-order filters."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel


def leaky_sum(values: Array, keep: float) -> Array:
    """Return the leaky sum of the rows of `values`: y_k = values_k + keep y_(k-1), with y_(-1) = 0.

    Args:
        values: Summands of K independent sums in N rows, (N, K); unchanged.
        keep: Fraction of the last sum that the next row keeps, 0 to 1.

    Returns:
        The sums y, (N, K).
    """
    out = np.array(values, np.float64, order="C")
    _add_previous(keep, out)
    return out


@kernel
def _add_previous(keep: float, out: Array) -> None:
    for k in range(1, out.shape[0]):
        for i in range(out.shape[1]):
            out[k, i] += keep * out[k - 1, i]
