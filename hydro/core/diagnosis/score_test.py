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
from scipy.stats import chi2, norm

from hydro.core.columns import Array
from hydro.core.identification.normal_equations import Normal, block_length

Columns = Sequence[int]

FLIPS = 1999
RIDGE = 1e-9  # of each column's own size: columns that are alike share what they explain


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
        return cls(matrix / size[:, None] / size, score / size, normal.gram[kept, -1, -1], size)

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
    evidence: Evidence, given: Columns, groups: Mapping[str, Columns], seed: int = 0
) -> dict[str, float]:
    """Probability that, nothing being missing, the most striking group is as striking as each one.

    The statistic of a group is m^T V^-1 m of its score m against the model without it, on the scale of a
    normal deviate so that groups of different size compare.  V and the flipped scores are of the residual
    that is left *with* the group, each block's by a fit without that block: so an effect that is plainly
    there does not hide in its own spread, and the level is kept where blocks have leverage.

    Blocks are as long as what the plainest group leaves is correlated: what it explains is no noise.
    Of a group with more than half as many columns as there are blocks the most striking part counts.

    Args:
        evidence: The problem.
        given: Columns in the model already.
        groups: Columns of each group.
        seed: Of the flips.
    """
    if not groups:
        return {}
    plainest = max(groups.values(), key=lambda group: evidence.gain(given, group))
    starts = np.arange(0, len(evidence.error), block_length(evidence.scores([*given, *plainest])))
    signs = np.random.default_rng(seed).choice(np.array([-1.0, 1.0]), size=(FLIPS, len(starts)))
    struck = dict.fromkeys(groups, -np.inf)
    highest, most = np.full(FLIPS, -np.inf), max(len(starts) // 2, 1)
    for name, group in groups.items():
        for part in (group[i : i + most] for i in range(0, len(group), most)):
            score, loose = _scores(evidence, given, part, starts)
            struck[name] = max(struck[name], float(_deviates(score[None], loose, flipped=False)[0]))
            highest = np.maximum(highest, _deviates(signs @ loose, loose, flipped=True))
    return {
        name: (1.0 + np.count_nonzero(highest >= strength)) / (FLIPS + 1.0)
        for name, strength in struck.items()
    }


def _deviates(sums: Array, blocks: Array, *, flipped: bool) -> Array:
    """How far sums (F, p) are from zero beside the spread of blocks (B, p), as normal deviates; (F,).

    The spread of what is flipped holds its mean, which Hotelling's T^2 takes out: without the group the
    blocks scatter about their mean, and the observed sum is compared with blocks that have none.
    """
    spread = blocks.T @ blocks
    spread += (1e-9 * np.trace(spread) + 1e-300) * np.eye(len(spread))
    form = np.maximum(((sums @ np.linalg.inv(spread)) * sums).sum(axis=1), 0.0)
    if flipped:
        form = form / np.maximum(1.0 - form / len(blocks), 1e-12)
    tail = chi2.logsf(form, len(spread))
    # Beyond what a double can tell the form itself keeps the order.
    deviates: Array = np.where(tail > -700.0, -norm.ppf(np.exp(np.maximum(tail, -700.0))), np.sqrt(form))
    return deviates


def _scores(
    evidence: Evidence, given: Columns, group: Columns, starts: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Score (p,) of columns made orthogonal to the given ones, and blocks (B, p) of its value by chance."""
    both = [*given, *group]
    blocks = np.add.reduceat(evidence.matrix[:, both][:, :, both], starts, axis=0)
    scores = np.add.reduceat(evidence.score[:, both], starts, axis=0)
    total, sums, own = blocks.sum(axis=0) + RIDGE * np.eye(len(both)), scores.sum(axis=0), len(given)
    turn = np.hstack([-np.linalg.solve(total[:own, :own], total[:own, own:]).T, np.eye(len(group))])
    restricted = np.zeros(len(both))
    restricted[:own] = np.linalg.solve(total[:own, :own], sums[:own])
    without = np.linalg.solve(total - blocks, (sums - scores)[..., None])[..., 0]
    chance = scores - np.einsum("bij,bj->bi", blocks, without)
    return turn @ (sums - total @ restricted), chance @ turn.T
