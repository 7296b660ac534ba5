"""Paired test of each axis: does one step of a study predict it significantly worse than the step before?"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import VELOCITY, Array
from hydro.core.diagnosis.settings import AXIS_LEVEL, NEGLIGIBLE, RESAMPLES
from hydro.core.evaluation.block_resampling import block_sums, weights
from hydro.core.evaluation.velocity_errors import Squares
from hydro.core.prediction.normal_equations import block_length


def worse_axes(before: Squares, after: Squares) -> tuple[str, ...]:
    """Return the names (u to r) of the axes that the later step predicts significantly and materially worse.

    The errors of both steps are paired by stretch.  Blocks of successive stretches are resampled by the
    Bayesian bootstrap.  A rise of the error by less than NEGLIGIBLE is not material.
    """
    seen = np.flatnonzero(before.counts.sum(axis=0))
    if len(before.sums) < 2 or not seen.size:
        return ()
    rise = (after.sums - (1.0 + NEGLIGIBLE) ** 2 * before.sums)[:, seen]
    blocks = block_sums(rise, block_length(rise - rise.mean(axis=0)))
    drawn = weights(len(blocks), RESAMPLES, 0) @ blocks
    return tuple(VELOCITY[seen[i]] for i in _rejected((drawn <= 0.0).mean(axis=0)))


def _rejected(p_values: Array) -> list[int]:
    """Return the indices of the p-values that Holm's procedure rejects at AXIS_LEVEL, in ascending order."""
    order, found = np.argsort(p_values, kind="stable"), []
    for number, index in enumerate(order):
        if p_values[index] > AXIS_LEVEL / (len(order) - number):
            break
        found.append(int(index))
    return sorted(found)
