"""Leaky sum, the recursion of first-order filters."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel


def leaky_sum(values: Array, keep: float) -> Array:
    """Return y_k = values_k + keep y_k-1 along the rows, from y_-1 = 0.

    Args:
        values: Summands, (N, K).
        keep: Share of the sum that the next row keeps.

    Returns:
        The sums, (N, K).
    """
    out = np.array(values, np.float64, order="C")
    _add_previous(keep, out)
    return out


@kernel
def _add_previous(keep: float, out: Array) -> None:
    for k in range(1, out.shape[0]):
        for i in range(out.shape[1]):
            out[k, i] += keep * out[k - 1, i]
