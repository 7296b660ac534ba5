"""Is a group of columns needed?  Gains, tests and standard errors from the pieces of a linearised problem.

All questions are of the same form: given the columns that are in the model already, what does a group of
further columns explain, and could chance do as much?  Chance is asked by flipping the signs of whole blocks
of the score (Hemerik, Goeman and Finos 2020): it needs no noise model, only blocks that are independent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtri

from hydro.core.columns import Array
from hydro.core.prediction.normal_equations import Normal, block_length

Columns = Sequence[int]

FLIPS = 1999
RIDGE = 1e-9  # of each column's own size: columns that are alike share what they explain
FLOOR = 1e-9  # of the mean variance of a group's score


@dataclass(frozen=True)
class Evidence:
    """A linearised problem in columns of unit size.

    Attributes:
        matrix: X^T X of each piece, (S, P, P).
        score: X^T e of each piece, (S, P).
        error: e^T e of each piece, (S,).
        size: What each column was divided by, (P,).
    """

    matrix: Array
    score: Array
    error: Array
    size: Array

    @classmethod
    def of(cls, normal: Normal) -> Evidence:
        """Scale the columns of a problem; pieces whose prediction diverges are dropped."""
        kept = np.isfinite(normal.gram[:, -1, -1])
        matrix, score = normal.matrix[kept], normal.score[kept]
        size = np.sqrt(np.einsum("sii->i", matrix))
        size[size == 0.0] = 1.0
        matrix /= size[:, None]
        matrix /= size
        return cls(matrix, score / size, normal.gram[kept, -1, -1], size)

    @cached_property
    def total(self) -> Array:
        """X^T X of all pieces, (P, P)."""
        return np.asarray(self.matrix.sum(axis=0))

    def solve(self, columns: Columns) -> Array:
        """Least-squares amounts of some columns, all others absent, in units of `size`; (p,)."""
        matrix = self.total[np.ix_(columns, columns)] + RIDGE * np.eye(len(columns))
        return np.linalg.solve(matrix, self.score[:, columns].sum(axis=0))

    def gain(self, given: Columns, group: Columns) -> float:
        """How much less squared residual is left when a group joins the given columns."""
        return self._explained([*given, *group]) - self._explained(given)

    def scores(self, columns: Columns) -> Array:
        """X^T e of each piece for some columns, e what is left with all of them, (S, p)."""
        found, matrix = self.solve(columns), self.matrix[:, columns][:, :, columns]
        left: Array = self.score[:, columns] - matrix @ found
        return left

    def _explained(self, columns: Columns) -> float:
        """What the least-squares amounts of some columns explain of the squared residual."""
        found = self.solve(columns)
        matrix = self.total[np.ix_(columns, columns)]
        return float(2.0 * self.score[:, columns].sum(axis=0) @ found - found @ matrix @ found)

    def covariance(self, given: Columns, group: Columns, scale: float) -> Array:
        """Of a group's amounts beside the given columns, (p, p), in the problem's own units.

        Args:
            given: Columns in the model.
            group: Further columns.
            scale: Mean square of what is left.
        """
        both, size = [*given, *group], self.size[list(group)]
        matrix = self.total[np.ix_(both, both)] + RIDGE * np.eye(len(both))
        part = np.linalg.inv(matrix)[len(given) :, len(given) :] * max(scale, 1.0)
        return np.asarray(part / np.outer(size, size))


def p_values(
    evidence: Evidence, given: Columns, groups: Mapping[str, Sequence[Columns]], seed: int = 0
) -> dict[str, float]:
    """Probability that, nothing being missing, the most striking group is as striking as each one.

    The statistic of a group is m^T V^-1 m of its score m against the model without it, on the scale of a
    normal deviate so that groups of different size compare.  Each flip is standardised by the covariance V
    that white noise gives it, for what the fit took of a block depends on the signs of the others (De Santis,
    Goeman, Hemerik, Davenport and Finos 2022): so the level is kept where a group is wide and where few
    blocks have most of the leverage.

    Blocks are as long as what the plainest group leaves is correlated: what it explains is no noise.
    Of a group with several shapes the most striking one counts, chosen in every flip anew: chosen beforehand
    it would tell more than chance does.  So does the most striking part of a shape with more than half as
    many columns as there are blocks.

    Args:
        evidence: The problem.
        given: Columns in the model already.
        groups: Columns of each shape of each group.
        seed: Of the flips.
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
            observed, *chance = _deviates(_forms(evidence, given, part, starts, signs), len(part))
            struck[name] = max(struck[name], float(observed))
            highest = np.maximum(highest, chance)
    return {
        name: (1.0 + np.count_nonzero(highest >= strength)) / (FLIPS + 1.0)
        for name, strength in struck.items()
    }


def _deviates(form: Array, columns: int) -> Array:
    """Quadratic forms of so many columns, of which the first is observed, as normal deviates."""
    form = form * (columns / max(float(form[1:].mean()), 1e-300))
    with np.errstate(divide="ignore"):
        tail = np.log(chdtrc(columns, form))
    # Beyond what a double can tell the form itself keeps the order.
    deviates: Array = np.where(tail > -700.0, -ndtri(np.exp(np.maximum(tail, -700.0))), np.sqrt(form))
    return deviates


def _forms(
    evidence: Evidence, given: Columns, group: Columns, starts: NDArray[np.int64], signs: Array
) -> Array:
    """m^T V^-1 m of a group's score under each row of signs, (F,), with the V of white noise of size 1.

    White noise gives a block's score s_b the covariance A_b; the fit to the given columns X leaves
    s_b - A_bX T_X^-1 s_X, T the sum of A_b.  With P the part of the group that is orthogonal to X, the sum of
    g_b P (s_b - A_bX T_X^-1 s_X) has the covariance P T P^T - C T_X^-1 C^T, C the sum of g_b P A_bX; for
    g_b^2 = 1, and C is 0 where all signs are as observed.
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
    # all flips at once: each on its own would factorise the same matrix anew
    held = np.linalg.solve(inner, mixed.reshape(len(signs) * len(group), own).T).T.reshape(mixed.shape)
    each = spread - mixed @ held.transpose(0, 2, 1)
    each += FLOOR * np.trace(spread) / len(group) * np.eye(len(group))
    form = np.einsum("fi,fi->f", flipped, np.linalg.solve(each, flipped[..., None])[..., 0])
    return np.asarray(np.maximum(form, 0.0))
