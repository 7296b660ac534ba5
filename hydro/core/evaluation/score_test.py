"""Score tests, gains and standard errors of groups of columns of a linearised problem.

A column is the derivative of the prediction by one parameter.  A group of columns is tested given the columns
that are in the model already: its gain, the squared residual that it explains in addition, and the p-value of
that gain.  The p-value is found by flipping the signs of whole blocks of the score (Hemerik, Goeman and Finos
2020).  This needs independent blocks, but no noise model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.prediction.normal_equations import Normal, block_length

Columns = Sequence[int]
"""Numbers of columns."""
FLIPS = 1999
"""Number of sign flips: the smallest p-value is 1 / 2000."""
RIDGE = 1e-9
"""Ridge of each column, relative to its own size: columns that are alike share their gain."""
FLOOR = 1e-9
"""Floor of a score's variance, relative to the mean variance of its group."""


@dataclass(frozen=True)
class Evidence:
    """Linearised least-squares problem with P columns X of unit size and residual e, in S pieces of data.

    Attributes:
        matrix: X^T X of each piece, (S, P, P).
        score: X^T e of each piece, (S, P).
        error: e^T e of each piece, (S,).
        size: Norm by which each column was divided, (P,).
    """

    matrix: Array
    score: Array
    error: Array
    size: Array

    @classmethod
    def of(cls, normal: Normal) -> Evidence:
        """Return a linearised problem scaled to columns of unit size.

        Pieces of data whose prediction diverges are left out.

        Args:
            normal: The linearised problem; it is not changed.
        """
        kept = np.isfinite(normal.gram[:, -1, -1])
        matrix, score = normal.matrix[kept], normal.score[kept]
        size = np.sqrt(np.einsum("sii->i", matrix))
        size[size == 0.0] = 1.0
        matrix /= size[:, None]
        matrix /= size
        return cls(matrix, score / size, normal.gram[kept, -1, -1], size)

    @cached_property
    def total(self) -> Array:
        """Sum of X^T X over all pieces, (P, P)."""
        return np.asarray(self.matrix.sum(axis=0))

    def solve(self, columns: Columns) -> Array:
        """Return the coefficients of a least-squares fit of given columns alone, (p,).

        Args:
            columns: Indices of the p columns.

        Returns:
            Coefficients of the columns of unit size, that is, those of the original columns times their
            `size`.
        """
        matrix = self.total[np.ix_(columns, columns)] + RIDGE * np.eye(len(columns))
        return np.linalg.solve(matrix, self.score[:, columns].sum(axis=0))

    def gain(self, given: Columns, group: Columns) -> float:
        """Return how much a group of columns reduces the sum of squared residuals of a fit of given columns.

        Args:
            given: Indices of the columns that are fitted already.
            group: Indices of the columns of the group.
        """
        return self._explained([*given, *group]) - self._explained(given)

    @property
    def left(self) -> float:
        """Fraction of the sum of squared residuals that remains after a joint fit of all columns."""
        return 1.0 - self._explained(range(len(self.size))) / float(self.error.sum())

    def scores(self, columns: Columns) -> Array:
        """Return X^T e of each of S pieces for given columns X, after a joint fit of these columns, (S, p).

        Args:
            columns: Indices of the p columns.
        """
        found, matrix = self.solve(columns), self.matrix[:, columns][:, :, columns]
        left: Array = self.score[:, columns] - matrix @ found
        return left

    def _explained(self, columns: Columns) -> float:
        """Return the squared residual that the least-squares fit of the given columns explains."""
        found = self.solve(columns)
        matrix = self.total[np.ix_(columns, columns)]
        return float(2.0 * self.score[:, columns].sum(axis=0) @ found - found @ matrix @ found)

    def covariance(self, given: Columns, group: Columns, scale: float) -> Array:
        """Return the covariance of the coefficients of a group of columns, (p, p), in the parameters' units.

        Args:
            given: Indices of the columns that are fitted together with the group.
            group: Indices of the p columns.
            scale: Mean square of the residual; below 1 it counts as 1.
        """
        both, size = [*given, *group], self.size[list(group)]
        matrix = self.total[np.ix_(both, both)] + RIDGE * np.eye(len(both))
        part = np.linalg.inv(matrix)[len(given) :, len(given) :] * max(scale, 1.0)
        return np.asarray(part / np.outer(size, size))


def p_values(
    evidence: Evidence, given: Columns, groups: Mapping[str, Sequence[Columns]], seed: int = 0
) -> dict[str, float]:
    """Return the p-value of each group of columns, corrected for the number of groups.

    The p-value of a group is the probability that, without any effect, the largest statistic of all groups
    reaches the statistic of this group.  The statistic is m^T V^-1 m, with the score m of the group given the
    columns in the model already.  It is converted to a normal deviate so that groups of different size
    compare.  A flip gives whole blocks of the score random signs.  Each flip is standardised by the
    covariance V that white noise gives it.  The reason is that the fit's share of a block depends on the
    signs of the other blocks (De Santis, Goeman, Hemerik, Davenport and Finos 2022).  So the level holds for
    wide groups, and where few blocks have most of the leverage.

    A block is as long as the residual with the group of largest gain is correlated.  The reason is that the
    part that this group explains is not noise.  Of a group with several shapes (alternative sets of columns),
    the shape with the largest statistic counts, chosen again in every flip; a choice made beforehand would
    bias the test.  The same holds for the parts of a shape with more than half as many columns as there are
    blocks.

    Args:
        evidence: Linearised problem.
        given: Columns in the model already.
        groups: Columns of each shape of each group, by the group's name.
        seed: Seed of the flips.

    Returns:
        p-value by name; the least is 1 / (FLIPS + 1).
    """
    if not groups:
        return {}
    shapes = [columns for group in groups.values() for columns in group]
    plainest = max(shapes, key=lambda columns: evidence.gain(given, columns))
    starts = np.arange(0, len(evidence.error), block_length(evidence.scores([*given, *plainest])))
    signs = np.random.default_rng(seed).choice(np.array([-1.0, 1.0]), size=(FLIPS + 1, len(starts)))
    signs[0] = 1.0  # as observed
    struck = dict.fromkeys(groups, -np.inf)
    highest, most = np.full(FLIPS, -np.inf), max(len(starts) // 2, 1)
    for name, group in groups.items():
        for part in (columns[i : i + most] for columns in group for i in range(0, len(columns), most)):
            deviates = _deviates(_forms(evidence, given, part, starts, signs), len(part))
            struck[name] = max(struck[name], float(deviates[0]))
            highest = np.maximum(highest, deviates[1:])
    return {
        name: (1.0 + np.count_nonzero(highest >= strength)) / (FLIPS + 1.0)
        for name, strength in struck.items()
    }


def _deviates(form: Array, columns: int) -> Array:
    """Convert quadratic forms to normal deviates; the first form is the observed one.

    Args:
        form: Quadratic forms, (F,).
        columns: Number of columns in each.
    """
    form = form * (columns / max(float(form[1:].mean()), 1e-300))
    with np.errstate(divide="ignore"):
        tail = np.log(scipy.special.chdtrc(columns, form))
    # Beyond the range of a double the form itself keeps the order.
    deviates: Array = np.where(
        tail > -700.0, -scipy.special.ndtri(np.exp(np.maximum(tail, -700.0))), np.sqrt(form)
    )
    return deviates


def _forms(
    evidence: Evidence, given: Columns, group: Columns, starts: NDArray[np.int64], signs: Array
) -> Array:
    """Return the statistic m^T V^-1 m of a group's score under each of F rows of signs, (F,).

    White noise gives a block's score s_b the covariance A_b.  The fit to the given columns X leaves s_b -
    A_bX T_X^-1 s_X.  T is the sum of A_b.  P is the part of the group that is orthogonal to X.  With signs
    g_b, m is the sum of g_b P (s_b - A_bX T_X^-1 s_X).  Its covariance V is P T P^T - C T_X^-1 C^T for unit
    white noise.  C is the sum of g_b P A_bX, which is 0 where all signs are as observed.

    Args:
        evidence: Linearised problem.
        given: Columns in the model already, X.
        group: Columns of the group.
        starts: First piece of each block.
        signs: Sign of each block in each flip, (F, blocks).
    """
    both, own = np.array([*given, *group]), len(given)
    blocks = np.add.reduceat(evidence.matrix[:, both[:, None], both], starts, axis=0)
    scores = np.add.reduceat(evidence.score[:, both], starts, axis=0)
    total = blocks.sum(axis=0) + RIDGE * np.eye(len(both))
    inner, across = total[:own, :own], blocks[:, :, :own]
    turn = np.hstack([-np.linalg.solve(inner, total[:own, own:]).T, np.eye(len(group))])
    left = (scores - across @ np.linalg.solve(inner, scores[:, :own].sum(axis=0))) @ turn.T
    flipped, mixed = signs @ left, np.tensordot(signs, turn @ across, axes=1)
    spread = turn @ total @ turn.T
    # all flips at once: separate solutions would factorise the same matrix each time
    held = np.linalg.solve(inner, mixed.reshape(len(signs) * len(group), own).T).T.reshape(mixed.shape)
    each = spread - mixed @ held.transpose(0, 2, 1)
    each += FLOOR * np.trace(spread) / len(group) * np.eye(len(group))
    # LAPACK takes far longer than a division for a system of one equation, and most groups have one column
    alone = len(group) == 1
    amounts = flipped / each[..., 0] if alone else np.linalg.solve(each, flipped[..., None])[..., 0]
    return np.asarray(np.maximum(np.einsum("fi,fi->f", flipped, amounts), 0.0))
