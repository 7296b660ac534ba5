"""Joint posterior of the values of changes, with the error of the hull-force model integrated out.

The residual e of the recording after the changes is linear in their values d near a fit:

    e = J d + L h + n,

with the sensitivities J, the hull-force model's error h, its response L h, and the noise n.  Neither L h nor
the noise is white: both persist, and L h recurs with the motion.  So their covariance comes from data, not
from a formula:

- Stretches of the recording before the changes give draws of what L h adds to the values (`imitation`).
- Stretches of the recording after the changes give the scatter of the scores J^T e.

The scatter of the scores is used in a sandwich estimator for clustered errors (White 1982, Liang and Zeger
1986).

Entries that the search held at the file's values may have changed a little, and then bias the other entries.
So they are free here, with a normal prior about the file's values.  Its standard deviation has the maximum
evidence (MacKay 1992): it is 0 where the recordings do not show that any of them has changed.

Few stretches leave the variance uncertain, so standard errors are widened until two of them hold as much
probability as two of a normal distribution: Student's t with the effective degrees of freedom of Welch (1947)
and Satterthwaite (1946), as in the Guide to the expression of uncertainty in measurement, annex G.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from hydro.core.columns import Array, Rows
from hydro.core.identification.levenberg_marquardt import Prior
from hydro.core.prediction.normal_equations import Normal, bounded_step
from hydro.core.residual.limits import WITHIN

SPREADS = np.concatenate([[0.0], np.geomspace(0.01, 2.0, 24)])
"""Candidate prior standard deviations of entries that the search held, in scales, in steps of a quarter.

They range from no change to the prior of a new effect.
"""


@dataclass(frozen=True)
class Posterior:
    """Normal posterior distribution of P values, in the scales of their components.

    Attributes:
        mean: Mean, (P,).
        covariance: Covariance, (P, P).
    """

    mean: Array
    covariance: Array


def joint_posterior(
    normal: Normal,
    here: Array,
    prior: Prior,
    bounds: tuple[Array, Array],
    fold: Rows,
    imitated: Array,
    held: NDArray[np.bool_],
) -> Posterior:
    """Return the posterior of the values of changes, with the error of the hull-force model included.

    Correlations are those of white residuals: few stretches do not determine them.

    Args:
        normal: Least-squares problem of the recording after the changes, linearised about `here`.
        here: Values of P components at the linearisation, (P,), in scales.
        prior: Prior of the values.
        bounds: Least and greatest values, (P,) each, in scales.
        fold: Number of the stretch of each of S shots, (S,).
        imitated: Draws of the hull-force model's error in the values, from `imitations`, (stretches, P).
        held: Mask of the entries that the search held at the centre of the prior, (P,).
    """
    kept = np.isfinite(normal.gram[:, -1, -1])
    matrix = normal.matrix[kept].sum(axis=0) + np.diag(prior.information)
    score = normal.score[kept].sum(axis=0) - prior.information * (here - prior.centre)
    low, high = bounds
    step = bounded_step(matrix, score, low - here, high - here)
    scores = normal.score[kept] - normal.matrix[kept] @ step
    each = np.array([scores[fold[kept] == one].sum(axis=0) for one in np.unique(fold)])
    pulled = np.linalg.solve(matrix, each.T).T
    free = np.array([len(imitated), max(len(pulled) - 1, 1)])
    parts = np.stack([(imitated**2).mean(axis=0), (pulled**2).sum(axis=0) * len(pulled) / free[1]])
    errors = np.sqrt(parts.sum(axis=0)) * widening(parts, free[:, None])
    inverse = np.linalg.inv(matrix)
    scale = errors / np.sqrt(np.diag(inverse))
    return nearly_held(Posterior(here + step, inverse * np.outer(scale, scale)), prior.centre, held)


def nearly_held(free: Posterior, centre: Array, held: NDArray[np.bool_]) -> Posterior:
    """Return a posterior after adding a normal prior that keeps some entries near their values in the file.

    The standard deviation of this prior is that of SPREADS with the maximum evidence.

    Args:
        free: Posterior with all P entries free.
        centre: Values in the file, (P,).
        held: Mask of the entries with this prior, (P,).
    """
    if not held.any():
        return free
    own, away = free.covariance[np.ix_(held, held)], (free.mean - centre)[held]
    size, ways = np.linalg.eigh(own)
    along = ways.T @ away
    each = np.maximum(size, np.finfo(float).tiny) + SPREADS[:, None] ** 2
    likely = SPREADS[np.argmin((np.log(each) + along**2 / each).sum(axis=1))]
    gain = np.linalg.solve(own + likely**2 * np.eye(len(own)), free.covariance[held]).T
    return Posterior(free.mean - gain @ away, free.covariance - gain @ free.covariance[held])


def widening(parts: Array, freedoms: Array) -> Array:
    """Return the factor on standard errors whose variance is uncertain, at least 1, (P,).

    Args:
        parts: Independent parts whose sum is the variance of each of P values, (parts, P).
        freedoms: Degrees of freedom of each estimate, (parts, 1).
    """
    total = parts.sum(axis=0)
    freedom = total**2 / np.maximum((parts**2 / freedoms).sum(axis=0), np.finfo(float).tiny)
    return np.asarray(scipy.special.stdtrit(np.maximum(freedom, 1.0), scipy.special.ndtr(WITHIN)) / WITHIN)
