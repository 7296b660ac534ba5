"""Linearised least-squares problem, kept as one Gram matrix per piece of data.

A piece is a part of the data, such as a shot.  With the residual e and the columns X (derivatives of the
prediction by each parameter), its Gram matrix is [X, e]^T [X, e].  Sums over pieces give estimates.  The
scatter of pieces gives standard errors that hold for correlated residuals and imperfect models.  Any subset
of columns or pieces gives another problem at no cost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from hydro.core.columns import Array

LEAST_SCORE_BLOCKS = 12  # minimum number of blocks of a jackknife
CORRELATION_TIMES = 10  # length of a block in correlation times of the scores


@dataclass(frozen=True)
class Normal:
    """Linearised, whitened least-squares problem with P parameters in S pieces of data.

    X has the derivatives of the prediction by the parameters as columns, and e is the residual.

    Attributes:
        gram: [X, e]^T [X, e] of each piece, (S, P + 1, P + 1); its last diagonal entry is infinite where a
            prediction diverges.
        freedom: Number of independent residuals per piece, one number or (S,).
        channels: Sum of squared residuals of each of C measured channels, (S, C).
        follow: Response of the Q eliminated unknowns of a piece, such as its initial state, to each column of
            X and to e, (S, Q, P + 1); Q may be 0.
        compared: Samples of each channel in each piece, (S, C); None if all have the same number.
    """

    gram: Array
    freedom: int | Array
    channels: Array
    follow: Array
    compared: Array | None = None

    @property
    def matrix(self) -> Array:
        """Products of the columns X^T X in each piece, (S, P, P)."""
        return self.gram[:, :-1, :-1]

    @property
    def score(self) -> Array:
        """Products of the columns and the residual X^T e in each piece, (S, P)."""
        return self.gram[:, :-1, -1]

    def of(self, columns: Sequence[int]) -> Normal:
        """Return a new problem in a part of the parameters, with all other parameters fixed.

        Args:
            columns: Indices of the parameters that remain.
        """
        kept = [*columns, -1]
        gram = self.gram[:, kept][:, :, kept]
        return replace(self, gram=gram, follow=self.follow[..., kept])

    def some(self, kept: NDArray[np.bool_]) -> Normal:
        """Return a new problem for a part of the pieces of data.

        Args:
            kept: Mask of the pieces that remain, (S,).
        """
        compared = None if self.compared is None else self.compared[kept]
        rest = (self.gram[kept], self.freedoms[kept], self.channels[kept], self.follow[kept])
        return Normal(*rest, compared)

    @property
    def cost(self) -> float:
        """Sum of squared residuals over all pieces."""
        return float(self.gram[:, -1, -1].sum())

    def expected(self, step: Array) -> Array:
        """Return the sum of squared residuals that the linear problem predicts after a step, per piece, (S,).

        Args:
            step: Change of the parameters, (P,).
        """
        across = 2.0 * self.score @ step - np.einsum("sij,i,j->s", self.matrix, step, step)
        left: Array = self.gram[:, -1, -1] - across
        return left

    def after(self, step: Array) -> Normal:
        """Return a new problem, linearised about the parameters plus a step, with the same derivatives.

        Args:
            step: Change of the parameters, (P,).
        """
        gram = self.gram.copy()
        gram[:, -1, -1] = self.expected(step)
        gram[:, :-1, -1] -= self.matrix @ step
        gram[:, -1, :-1] = gram[:, :-1, -1]
        return replace(self, gram=gram)

    @property
    def residuals(self) -> float:
        """Number of independent residuals in all pieces together."""
        return float(self.freedoms.sum())

    @property
    def freedoms(self) -> Array:
        """Number of independent residuals in each piece, (S,)."""
        return np.broadcast_to(np.asarray(self.freedom, float), len(self.gram))

    @property
    def rms(self) -> Array:
        """Root mean square residual of each channel, (C,); 1 for a channel without a sample."""
        squares, count = self.channels.sum(axis=0), self.channels.shape[1]
        if self.compared is None:
            return np.asarray(np.sqrt(squares / (self.residuals / count)))
        each = self.compared.sum(axis=0) * (self.residuals / self.compared.sum())
        return np.sqrt(np.where(each > 0.0, squares, 1.0) / np.where(each > 0.0, each, 1.0))

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Mask of the pieces whose predictions diverge, (S,); `chi2` ignores them."""
        return ~np.isfinite(self.gram[:, -1, -1])

    @property
    def chi2(self) -> float:
        """Reduced chi-square of the pieces that do not diverge; 1 for a true model with known noise."""
        within = self.gram[~self.lost, -1, -1]
        return float(within.mean()) / float(self.freedoms[~self.lost].mean()) if within.size else 1.0


def eliminate(gram: Array, first: int, known: Array) -> tuple[Array, Array]:
    """Eliminate the unknowns z of each piece of data from the least-squares problem e = Z z + X p.

    Args:
        gram: Gram matrix [Z, X, e]^T [Z, X, e] of each piece, (S, first + P + 1, first + P + 1).
        first: Number of unknowns z of each piece; the P parameters p are common to all pieces.
        known: Prior information on z, the inverse of its prior variance, (first,) or (S, first).  With it,
            unknowns that a piece does not determine do not move.

    Returns:
        The Gram matrices without z, (S, P + 1, P + 1), and the response of z to [X, e], (S, first, P + 1).
    """
    own, mixed = gram[:, :first, :first] + known[..., None] * np.eye(first), gram[:, :first, first:]
    size = np.sqrt(np.einsum("sii->si", own))
    unit = own / (size[:, :, None] * size[:, None, :])
    follow = np.linalg.solve(unit, mixed / size[:, :, None]) / size[:, :, None]
    return gram[:, first:, first:] - mixed.transpose(0, 2, 1) @ follow, follow


def taken(gram: Array, first: int, known: Array) -> Array:
    """Return the degrees of freedom that the eliminated unknowns of each piece use, (S,).

    The number is `first` if the data alone determine the unknowns, and less if the prior does.

    Args:
        gram: Gram matrix [Z, X, e]^T [Z, X, e] of each of S pieces, (S, first + P + 1, first + P + 1):
            Z of the unknowns, X of P parameters, and the residual e.
        first: Number of unknowns that are eliminated from each piece.
        known: Prior information on the unknowns, the inverse of their prior variances, (S, first).
    """
    own = gram[:, :first, :first]
    size = 1.0 / np.sqrt(np.einsum("sii->si", own) + known)
    unit = own * size[:, :, None] * size[:, None, :]
    whole = unit + (known * size**2)[..., None] * np.eye(first)
    count: Array = np.einsum("sii->s", np.linalg.solve(whole, unit))
    return count


def bounded_step(matrix: Array, score: Array, low: Array, high: Array) -> Array:
    """Return the step d with low <= d <= high that minimises d^T matrix d - 2 score^T d, (P,).

    Args:
        matrix: Positive definite matrix of P unknowns, (P, P).
        score: Right-hand side, (P,).
        low: Least steps, (P,).
        high: Greatest steps, (P,).
    """
    if not score.size:
        return score
    scale = 1.0 / np.sqrt(np.diag(matrix))
    upper = np.linalg.cholesky(matrix * np.outer(scale, scale)).T
    target = scipy.linalg.solve_triangular(upper.T, score * scale, lower=True)
    free: Array = scipy.linalg.solve_triangular(upper, target) * scale
    if ((free >= low) & (free <= high)).all():
        return free
    wide = np.maximum(high / scale, low / scale + 1e-12)
    solved = scipy.optimize.lsq_linear(upper, target, (low / scale, wide), method="bvls")
    return np.clip(np.asarray(solved.x) * scale, low, high)


def block_length(scores: Array) -> int:
    """Return how many consecutive pieces of data form a block: ten correlation times of their scores.

    Blocks are shorter where fewer than twelve would remain.  Scores of neighbouring pieces are correlated if
    model errors last longer than a piece.  With white residuals they are not correlated, and a block is one
    piece.

    Args:
        scores: X^T e of each of S pieces, for P parameters, (S, P): columns X, the derivatives of the
            prediction, and residual e.
    """
    pieces = len(scores)
    size = np.sqrt((scores**2).sum(axis=0))
    unit = scores[:, size > 0.0] / size[size > 0.0]
    if pieces < 2 * LEAST_SCORE_BLOCKS or not unit.size:
        return 1
    time, least = 0.0, 2.0 / math.sqrt(pieces * max(1.0, unit.shape[1] / 4.0))
    for lag in range(1, pieces // LEAST_SCORE_BLOCKS):
        correlation = float((unit[lag:] * unit[:-lag]).sum()) / unit.shape[1]
        if correlation <= least:
            break
        time += correlation
    return max(1, min(math.ceil(CORRELATION_TIMES * time), pieces // LEAST_SCORE_BLOCKS))


def covariance(normal: Normal, prior: Array) -> Array:
    """Return the covariance of the parameters estimated by least squares, (P, P).

    Two variances are computed for each parameter, and the larger counts.  The first is that of white
    residuals of the observed size.  The second is the delete-one-block jackknife of the linearised problem
    (the sandwich with leverage correction, Cameron and Miller 2015), which needs neither whiteness nor a true
    model.  The prior applies where the data hold no information.

    Args:
        normal: The problem with P parameters at the estimate.
        prior: Information added to the diagonal, the inverse of the prior variances, (P,), positive.

    Returns:
        Covariance, in the units of the problem's parameters.
    """
    information = normal.matrix.sum(axis=0)
    total = information + np.diag(prior)
    inverse = _inverse(total)
    # The root keeps symmetry: near a singular matrix, inverse @ matrix @ inverse is not symmetric.
    half = inverse @ _root(max(1.0, normal.chi2) * information + np.diag(prior))
    plain: Array = half @ half.T
    np.fill_diagonal(plain, np.maximum(np.diag(plain), np.diag(inverse)))  # rounding may leave less
    size = block_length(normal.score)
    edges = np.arange(0, len(normal.gram), size)
    if len(edges) > 1 and len(normal.gram) - edges[-1] < size:
        edges = edges[:-1]
    blocks = len(edges)
    if blocks < LEAST_SCORE_BLOCKS:
        return plain
    matrices = np.add.reduceat(normal.matrix, edges, axis=0)
    scores = np.add.reduceat(normal.score, edges, axis=0)
    scores = scores - scores.sum(axis=0) / blocks
    left_out = (_inverse(total - matrices) @ -scores[..., None])[..., 0]
    left_out -= left_out.mean(axis=0)
    robust = left_out.T @ left_out * (blocks - 1) / blocks
    share = np.maximum(1.0 - np.diag(robust) / np.diag(plain), 0.0) ** 0.5
    both: Array = robust + plain * np.outer(share, share)
    return both


def _inverse(information: Array) -> Array:
    """Return inverses of information matrices (..., P, P), made positive definite against rounding errors."""
    sizes, values, ways = _decomposed(information)
    over = ways / values[..., None, :]
    inverse: Array = over @ np.swapaxes(ways, -2, -1) / (sizes[..., :, None] * sizes[..., None, :])
    return inverse


def _root(information: Array) -> Array:
    """Return L of an information matrix L L^T, (P, P)."""
    sizes, values, ways = _decomposed(information)
    root: Array = sizes[:, None] * ways * np.sqrt(values)
    return root


def _decomposed(information: Array) -> tuple[Array, Array, Array]:
    """Return roots of the diagonal, eigenvalues and eigenvectors of the correlations of matrices (..., P, P).

    Eigenvalues are made positive against rounding errors.
    """
    diagonal = np.maximum(np.diagonal(information, axis1=-2, axis2=-1), np.finfo(float).tiny)
    sizes = np.sqrt(diagonal)
    values, ways = np.linalg.eigh(information / (sizes[..., :, None] * sizes[..., None, :]))
    least = values.shape[-1] * np.finfo(float).eps * values[..., -1:]
    return sizes, np.maximum(values, least), ways
