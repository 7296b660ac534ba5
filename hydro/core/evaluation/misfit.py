"""Squared errors of a model on a recording, piece by piece, beside those that noise alone makes.

Noise floor.  The recording is disturbed by noise of the size that it has already, and the beginning of each
prediction by the uncertainty of the smoothed motion, often enough that chance does not show: the change is
what noise does to the errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array, Mask, Rows


@dataclass(frozen=True)
class Misfit:
    """Squared errors of one kind, piece by piece.

    Attributes:
        level: `force` or `replay`.
        horizon: Of the replay [s]; None for forces and for the whole run.
        axes: Names of the A axes, and of all of them together.
        units: Their units.
        weight: What a square on each axis counts for beside the others, (A,): see `evaluation.weights`.
        rows: Rows compared in each piece, (P,).
        counts: Samples compared in each piece, (P, A); None where every row has one of every axis.
        squares: Sums of squared errors, (P, A).
        noise: The same of what noise alone does, (P, A).
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
        """Samples of each piece and axis, (P, A)."""
        if self.counts is not None:
            return self.counts
        return np.repeat(self.rows[:, None], len(self.units), axis=1)


def counted(values: Array, seen: Mask | None) -> Array:
    """Values (N, C) where there is a sample, 0 elsewhere."""
    return values if seen is None else values * seen
