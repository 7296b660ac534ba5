"""Confidence in a name, effects that explain a recording equally well, and the share of the error explained.

Whole blocks of shots get random weights (Bayesian bootstrap, Rubin 1981).  They give the frequency with which
each rival wins, and an interval for the share.

Held-out sessions test whether an effect transfers.  Each rival is refitted without one session at a time, by
the linear problem about its fit, and predicts that session.  A gain there is not due to many parameters, nor
to one unusual session.  A recording of fewer than three sessions is cut into stretches, which are held out
instead.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.model import Model, penalty
from hydro.core.diagnosis.settings import (
    CHANGED,
    FOLDS,
    LEAST_EVIDENCE,
    LEAST_SESSIONS,
    NEARLY_EQUAL,
    NEGLIGIBLE,
    RESAMPLES,
    RIGHT_ABOVE,
)
from hydro.core.errors import DataError
from hydro.core.evaluation.block_resampling import block_sums, interval, weights
from hydro.core.identification.levenberg_marquardt import PRIOR
from hydro.core.prediction.normal_equations import Normal, block_length


def wins(costs: Mapping[str, Array], size: int) -> dict[str, float]:
    """Return the share of the resamples in which each candidate costs least, the largest share first.

    Args:
        costs: Penalised squared residual of each of S shots, (S,), by candidate.
        size: Number of shots in a block, which is resampled as a whole.
    """
    blocks = block_sums(np.stack([*costs.values()], axis=1), size)
    winner = np.argmin(weights(len(blocks), RESAMPLES, seed=0) @ blocks, axis=1)
    part = np.bincount(winner, minlength=len(costs)) / RESAMPLES
    return dict(sorted(zip(costs, part.tolist(), strict=True), key=lambda one: -one[1]))


def resampled_shots(normal: Normal) -> int:
    """Return the number of shots that are resampled together: at least two, as residuals are correlated."""
    return max(block_length(normal.score), 2)


def selection_frequency(rivals: Mapping[str, Model], best: str) -> dict[str, float]:
    """Return the share of the resamples in which each rival has the least penalised cost.

    Returns:
        Shares of `best` and of all effects that win at least a share NEGLIGIBLE, in descending order.
    """
    costs = {name: model.penalised for name, model in rivals.items()}
    found = wins(costs, resampled_shots(rivals[best].normal))
    return {name: part for name, part in found.items() if part >= NEGLIGIBLE or name == best}


def change_frequency(normal: Normal, entries: Sequence[int], change: Array) -> float:
    """Return the share of resamples in which the changed values of an effect leave a smaller penalised error.

    They are compared with the file's values of the effect, next to which all other parameters move to their
    best values once, for all resamples.

    Args:
        normal: Joint fit, linearised at the changed values.
        entries: Indices of the parameters of the effect.
        change: Change from the file's values, in units of the parameters, (len(entries),).
    """
    count, own = normal.gram.shape[1] - 1, np.array(entries)
    others = np.setdiff1d(np.arange(count), own)
    matrix, score = normal.matrix.sum(axis=0), normal.score.sum(axis=0)
    step = np.zeros(count)
    step[own] = -change
    held = matrix[np.ix_(others, others)] + PRIOR**-2 * np.eye(len(others))
    step[others] = np.linalg.solve(held, score[others] - matrix[np.ix_(others, own)] @ step[own])
    shots = len(normal.gram)
    unchanged = normal.expected(step) - penalty(shots, len(own), normal.chi2) / shots
    costs = {"changed": normal.gram[:, -1, -1], "unchanged": unchanged}
    return wins(costs, resampled_shots(normal))["changed"]


def explained_share(gain: Array, excess: Array, pieces: int) -> tuple[float, float, float]:
    """Return the share of an error that is explained, with the ends of its 95 % interval.

    Args:
        gain: Squared residual explained in each of S shots, (S,).
        excess: Squared residual beyond the noise in each shot, (S,).
        pieces: Number of shots in a block, at least 1, which is resampled as a whole.
    """
    blocks = block_sums(np.column_stack([gain, excess]), pieces)
    drawn = weights(len(blocks), RESAMPLES, seed=1) @ blocks
    ratio = np.clip(drawn[:, 0] / np.maximum(drawn[:, 1], 1e-9), 0.0, 1.0)
    middle = float(np.clip(gain.sum() / max(excess.sum(), 1e-9), 0.0, 1.0))
    low, high = interval(ratio)
    return middle, float(min(low, middle)), float(max(high, middle))


def folds(session: ArrayLike) -> Rows:
    """Return the number of the fold that each of S shots is held out with, (S,).

    A fold is a session.  With fewer than LEAST_SESSIONS sessions it is one of at most FOLDS stretches.

    Args:
        session: Number of each shot's session, (S,), in the order of the recording.

    Raises:
        DataError: There are fewer than two shots.
    """
    numbers = np.asarray(session, np.int64)
    if len(numbers) < 2:
        raise DataError("one shot is too few to hold data out; record a longer session")
    names, label = np.unique(numbers, return_inverse=True)
    if len(names) >= LEAST_SESSIONS:
        return np.asarray(label, np.int64)
    stretches = min(FOLDS, len(numbers))
    return np.asarray(np.arange(len(numbers)) * stretches // len(numbers), np.int64)


def left_out_costs(
    normal: Normal,
    fold: Rows,
    amounts: ArrayLike = 0.0,
    information: ArrayLike = PRIOR**-2,
    new: Sequence[int] = (),
    kept: float = 0.0,
) -> Array:
    """Return the squared residual of each of S shots, predicted by the fit to all other folds, (S,).

    One Gauss-Newton step from the fitted values stands for that fit.  Components that only the held-out fold
    determines return to their prior mean.

    Args:
        normal: Problem linearised about the fitted values of P components, in units of their scales.
        fold: Fold that each shot is held out with, (S,).
        amounts: Distance of each component from its prior mean, in scales, (P,).
        information: Prior information on each component, (P,), the inverse square of the standard deviation
            in scales.
        new: Components that the other folds must determine.
        kept: Least share of all information on these components that the other folds must have; below it the
            costs of the fold's shots are NaN.
    """
    matrix, score, costs = normal.matrix, normal.score, normal.gram[:, -1, -1].copy()
    away, prior = (np.broadcast_to(one, matrix.shape[1]) for one in (amounts, information))
    seen = np.isfinite(costs)
    shown = np.einsum("sii->si", matrix)[:, list(new)].sum(axis=1)
    total, sums = matrix[seen].sum(axis=0) + np.diag(prior), score[seen].sum(axis=0)
    for number in np.unique(fold):
        out = (fold == number) & seen
        if shown[seen & ~out].sum() < kept * shown[seen].sum():
            costs[out] = np.nan
            continue
        rest, pull = total - matrix[out].sum(axis=0), sums - score[out].sum(axis=0)
        step = np.linalg.solve(rest, pull - prior * away)
        costs[out] += np.einsum("i,sij,j->s", step, matrix[out], step) - 2.0 * score[out] @ step
    return costs


def left_out_share(first: Normal, rival: Normal, amounts: Array, session: ArrayLike) -> float:
    """Return the share of the error of held-out sessions that a rival removes, 0 to 1.

    Args:
        first: Fit without the rival, its existing effects fitted, linearised.
        rival: Fit with the rival, over the same shots.
        amounts: Distance of each component of the rival from its value without it, in scales, (P,).
        session: Number of each shot's session, (S,).
    """
    fold = folds(session)
    before, after = left_out_costs(first, fold), left_out_costs(rival, fold, amounts)
    both = np.isfinite(before) & np.isfinite(after)
    gain, excess = (before - after)[both].sum(), (before - first.freedoms)[both].sum()
    return float(np.clip(gain / max(excess, 1e-9), 0.0, 1.0))


def shared(findings: Sequence[Finding], together: float) -> list[Finding]:
    """Return findings with the share that they explain together divided among them, if they overlap.

    Each finding adds little to all other findings, and the sum of these additions is far less than the
    share of all together.  Each then gets a part of `together` in proportion to its addition.  Findings
    that do not overlap are returned as they are.

    Args:
        findings: Findings, with the share that each adds to the others.
        together: Share that all of them explain together.
    """
    added = sum(finding.share for finding in findings)
    if added >= NEARLY_EQUAL * together or added <= 0.0:
        return list(findings)
    names, parted = " and ".join(finding.effect for finding in findings), []
    for one in findings:
        low, share, high = (value * together / added for value in (one.low, one.share, one.high))
        warning = (
            f"; {names} explain {together:.0%} together and overlap: this one alone adds {one.share:.0%} to "
            "the others"
        )
        parted.append(replace(one, share=share, low=low, high=min(high, 1.0), advice=one.advice + warning))
    return parted


def by_likelihood_confidence(frequency: float, is_right: bool) -> float:
    """Return the probability that a name by likelihood is right.

    `frequency` is the share of the resamples in which the effect has the least penalised cost, 0 to 1.
    `is_right` tells whether the model may be right; otherwise names may stand for an effect that it lacks.
    """
    return frequency if is_right else RIGHT_ABOVE * frequency


def lead_confidence(over_next: float, over_none: float, by_chance: float) -> float:
    """Return the probability that the lead of the best candidate is not due to chance.

    Two candidates may each lead by chance, so the difference has a Laplace distribution.  Without a lead,
    each is right with a probability of one half.  A lead over no effect has an exponential distribution:
    without a lead, nothing is missing.

    Args:
        over_next: Lead over the next candidate; infinite without one.
        over_none: Lead over the model without any candidate.
        by_chance: Mean lead by chance, in the same unit.
    """
    half = 0.5 * math.exp(-abs(over_next) / by_chance)
    preferred = 1.0 - half if over_next >= 0.0 else half
    return -preferred * math.expm1(-max(over_none, 0.0) / by_chance)


def by_transfer_confidence(score: float, others: Sequence[float]) -> float:
    """Return the probability that a name by transfer is right, where no model reaches the noise.

    The lead over the next effect is a share of the residual that this effect leaves: where many effects
    remove nearly all of an error, any of them could be right.

    Args:
        score: Share of the held-out error that the effect removes, beyond the share that it absorbs.
        others: Scores of all other effects.
    """
    next_best = max(others, default=-math.inf)
    lead = 1.0 - (1.0 - score) / max(1.0 - next_best, 1e-9)
    return min(max(score, 0.0), 1.0) * lead_confidence(lead, score, CHANGED)


def by_evidence_confidence(evidence: float, others: Sequence[float]) -> float:
    """Return the probability that a name is right, where evidence with the hull force free ranks the names.

    No library contains every hull force, so its gaps give a lead of LEAST_EVIDENCE by chance.  Evidence also
    counts correlated residuals as independent, so a share of it may be due to chance too.  In one real log
    the residual was 16,000 times the noise.  There, gains of nine thrusters, three of them dead, led with a
    log evidence of 1558 by 109.

    Args:
        evidence: Log evidence of the effect beyond that of the file, with the hull force integrated out.
        others: Log evidence of all other effects.
    """
    by_chance = LEAST_EVIDENCE + CHANGED * max(evidence, 0.0)
    return lead_confidence(evidence - max(others, default=-math.inf), evidence, by_chance)
