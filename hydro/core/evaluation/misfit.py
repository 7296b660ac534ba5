"""Squared errors of a model on a recording, piece by piece, with the errors that noise alone causes.

The noise floor is the error that noise alone causes. To compute the floor, noise of the measured size is
added to the recording, and the uncertainty of the smoothed motion to the start of each prediction. The floor
is the mean change of the errors over enough draws.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array, Mask, Rows


@dataclass(frozen=True)
class Misfit:
    """Squared errors of a force or of a prediction, in each of P pieces of time and on each of A axes.

    Attributes:
        level: `force` or `replay`; `yardstick` for a simple predictor.
        horizon: Horizon of the replay [s]; None for forces and for the whole run.
        axes: Names of the A axes, then the name for all axes together.
        units: Units of the A axes.
        weight: Weight of a square on each axis, (A,): see `evaluation.weights`.
        rows: Number of rows compared in each piece, (P,).
        counts: Number of samples compared in each piece, (P, A); None if every row has a sample on every
            axis.
        squares: Sums of squared errors, (P, A).
        noise: Sums of squared errors due to noise alone, (P, A).
        block: Block of each piece, (P,).
        end: Root mean square error at the end of the predictions, (A,); None for forces.
    """

    level: str
    horizon: float | None
    axes: tuple[str, ...]
    units: tuple[str, ...]
    weight: Array
    rows: Array
    squares: Array
    noise: Array
    block: Rows
    end: Array | None = None
    counts: Array | None = None

    @property
    def numbers(self) -> Array:
        """Number of compared samples in each piece of time on each axis, (P, A)."""
        if self.counts is not None:
            return self.counts
        return np.repeat(self.rows[:, None], len(self.units), axis=1)


def counted(values: Array, seen: Mask | None) -> Array:
    """Return values with 0 where there is no sample, (N, C); the argument is not changed.

    Args:
        values: Values of C channels in N rows, (N, C); returned themselves if every value is a sample.
        seen: Mask of the samples, (N, C); None if every value is a sample.
    """
    return values if seen is None else values * seen
