"""How sure is a name?  Which effects explain a recording as well as the best, and how much does one explain.

Whole blocks of shots are weighed at random (Bayesian bootstrap, Rubin 1981): how often would each rival win,
and within what limits does the share lie.

And how well does an effect explain sessions that it was not fitted to?  Each rival is fitted anew without one
session at a time, by the linear problem about its fit, and predicts the session left out.  What is gained
there is no matter of having many parameters, nor of one session that is like no other.  A recording of fewer
than three sessions is cut into stretches that are left out instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.findings import SURE, Finding
from hydro.core.diagnosis.model import Model, penalty
from hydro.core.errors import DataError
from hydro.core.evaluation.block_resampling import block_sums, interval, weights
from hydro.core.experiment.advice import suspecting
from hydro.core.identification.levenberg_marquardt import PRIOR
from hydro.core.prediction.normal_equations import Normal, block_length

RIGHT = 2.0
"""Mean squared residual in units of the noise of a model that may be right: then likelihood names effects."""
CLEAN = 1.35
"""The same up to which nothing to speak of is left beside the noise,"""
CALM = 1.15
"""and the same where shots allow for waves,"""
NEAR = 102.0 / 118.0
"""and share of names by likelihood that were right where more is left."""
ODDS, ODDS_BY_SCORE, ODDS_BY_LEAD = -1.76, 2.74, 2.02
"""Logarithm of the odds that a name by transfer is right, at a score of 0, for a score of 1 more, and where
nothing comes near it."""
BY_LEAD, HALF = 1.8, 1.6
"""The same of a name by evidence, for each unit of log(1 + lead), and where it is as likely right as not."""
AHEAD = 0.15
"""Part of the evidence that a lead must be, or else a name is less sure by as much as it is less."""
RESAMPLES = 2000
TIED = 0.02
"""Part of the resamples that a rival must win to be named beside the best."""
SESSIONS = 3
"""Sessions from which whole sessions are left out."""
STRETCHES = 6
"""Stretches of equal length that are left out in turn where there are fewer."""
CONFIRMED = 0.5
"""Part of what an effect explains that it must explain of sessions left out, or else a warning is due."""
OVERLAP = 0.7
"""Part of what findings explain together below which the sum of what each adds tells that they overlap."""
IMITATED = 0.5
"""What no effect explains, in units of what a finding explains, from which it casts doubt on the finding."""


def selection_frequency(rivals: Mapping[str, Model], best: str, seed: int = 0) -> dict[str, float]:
    """Part of the resamples in which each rival explains most for its parameters.

    Args:
        rivals: A model for each effect.
        best: The effect whose residuals say how long a block is.
        seed: Of the weights.

    Returns:
        The best and all that are tied with it, the most frequent winner first.
    """
    costs = np.stack([model.penalised for model in rivals.values()], axis=1)
    part = dict(zip(rivals, _wins(costs, rivals[best].normal, seed), strict=True))
    tied = [name for name in rivals if part[name] >= TIED or name == best]
    return {name: float(part[name]) for name in sorted(tied, key=lambda name: -part[name])}


def change_frequency(normal: Normal, entries: Sequence[int], change: Array, seed: int = 0) -> float:
    """Return the share of the resamples in which changed values of one effect win over the file's.

    Where the effect keeps the file's values, all other parameters move to their best values beside it.

    Args:
        normal: The joint fit, with the changed values.
        entries: The parameters of the effect.
        change: Their change from the file's values, in units of the parameters, (len(entries),).
        seed: Of the weights.
    """
    count, own = normal.gram.shape[1] - 1, np.array(entries)
    others = np.setdiff1d(np.arange(count), own)
    matrix, score = normal.matrix.sum(axis=0), normal.score.sum(axis=0)
    step = np.zeros(count)
    step[own] = -change
    held = matrix[np.ix_(others, others)] + PRIOR**-2 * np.eye(len(others))
    step[others] = np.linalg.solve(held, score[others] - matrix[np.ix_(others, own)] @ step[own])
    costs, shots = normal.gram[:, -1, -1], len(normal.gram)
    unchanged = normal.expected(step) - penalty(shots, len(own), normal.chi2) / shots
    return float(_wins(np.stack([costs, unchanged], axis=1), normal, seed)[0])


def _wins(costs: Array, best: Normal, seed: int) -> Array:
    """Return the share of the resamples in which each of several models costs least, (M,).

    Args:
        costs: Squared residual of each shot and model, with fines, (S, M).
        best: The model whose residuals say how long a block is.
        seed: Of the weights.
    """
    blocks = block_sums(costs, max(block_length(best.score), 2))
    winner = np.argmin(weights(len(blocks), RESAMPLES, seed) @ blocks, axis=1)
    return np.bincount(winner, minlength=costs.shape[1]) / RESAMPLES


def explained_share(gain: Array, excess: Array, pieces: int, seed: int = 1) -> tuple[float, float, float]:
    """What part of an error is explained, with its 95 % interval.

    Args:
        gain: Squared residual explained in each shot, (S,).
        excess: Squared residual beyond the noise in each shot, (S,).
        pieces: Shots that make one block.
        seed: Of the weights.
    """
    blocks = block_sums(np.column_stack([gain, excess]), max(pieces, 1))
    drawn = weights(len(blocks), RESAMPLES, seed) @ blocks
    ratio = np.clip(drawn[:, 0] / np.maximum(drawn[:, 1], 1e-9), 0.0, 1.0)
    middle = float(np.clip(gain.sum() / max(excess.sum(), 1e-9), 0.0, 1.0))
    low, high = interval(ratio)
    return middle, float(min(low, middle)), float(max(high, middle))


@dataclass(frozen=True)
class Fitted:
    """A model at its fit.

    Attributes:
        normal: The problem about its values, in units of the entries' scales.
        amounts: How far each entry has moved from where it is without data, in scales, (P,).
        information: How firmly it is held there, (P,); by default as little as PRIOR scales hold it.
    """

    normal: Normal
    amounts: Array
    information: Array | None = None


@dataclass(frozen=True)
class Score:
    """What a rival explains of sessions left out.

    Attributes:
        share: Part of the error beyond the noise that it removes, over all of them, with
        low: the lower and
        high: the upper end of its 95 % interval.
        by_fold: The same of each session or stretch, in order; below 0 where it makes the error larger, and
            NaN where there is no error beyond the noise.
    """

    share: float
    low: float
    high: float
    by_fold: Array


def folds(session: ArrayLike) -> Rows:
    """What to leave out together: the number of a session, or of a stretch, for each shot.

    Args:
        session: Number of each shot's session, (S,), in the order of the recording.

    Raises:
        DataError: There are fewer than two shots.
    """
    numbers = np.asarray(session, np.int64)
    if len(numbers) < 2:
        raise DataError("one shot alone has nothing to be left out; record a longer session")
    names, label = np.unique(numbers, return_inverse=True)
    if len(names) >= SESSIONS:
        return np.asarray(label, np.int64)
    stretches = min(STRETCHES, len(numbers))
    return np.asarray(np.arange(len(numbers)) * stretches // len(numbers), np.int64)


def left_out_costs(fitted: Fitted, fold: Rows, new: Sequence[int] = (), kept: float = 0.0) -> Array:
    """Squared residual of each shot, predicted by one Gauss-Newton step to the fit to all other folds, (S,).

    Entries that only the fold left out tells of go back to where they are without data.

    Args:
        fitted: The model.
        fold: What is left out with each shot, (S,).
        new: Entries of which the other folds must tell,
        kept: and the part of all information on them that they must have; else the shots' costs are NaN.
    """
    matrix, score, costs = fitted.normal.matrix, fitted.normal.score, fitted.normal.gram[:, -1, -1].copy()
    prior = fitted.information
    prior = np.full(len(fitted.amounts), PRIOR**-2) if prior is None else prior
    seen = np.isfinite(costs)
    shown = np.einsum("sii->si", matrix)[:, list(new)].sum(axis=1)
    total, sums = matrix[seen].sum(axis=0) + np.diag(prior), score[seen].sum(axis=0)
    for number in np.unique(fold):
        out = (fold == number) & seen
        if shown[seen & ~out].sum() < kept * shown[seen].sum():
            costs[out] = np.nan
            continue
        rest, pull = total - matrix[out].sum(axis=0), sums - score[out].sum(axis=0)
        step = np.linalg.solve(rest, pull - prior * fitted.amounts)
        costs[out] += np.einsum("i,sij,j->s", step, matrix[out], step) - 2.0 * score[out] @ step
    return costs


def scores(first: Fitted, rivals: Mapping[str, Fitted], session: ArrayLike) -> dict[str, Score]:
    """Share of the error of sessions left out that each rival removes.

    Args:
        first: The model without any of them, its own effects fitted.
        rivals: The model with each effect, by its name, over the same shots.
        session: Number of each shot's session, (S,).

    Returns:
        One score per rival, the best first.
    """
    fold = folds(session)
    before = left_out_costs(first, fold)
    found: dict[str, Score] = {}
    for name, rival in rivals.items():
        after = left_out_costs(rival, fold)
        both = np.isfinite(before) & np.isfinite(after)
        gain, excess = (before - after)[both], (before - first.normal.freedoms)[both]
        found[name] = Score(
            *explained_share(gain, excess, block_length(rival.normal.score[both])),
            _by_fold(gain, excess, fold[both], int(fold.max()) + 1),
        )
    return dict(sorted(found.items(), key=lambda item: -item[1].share))


def _by_fold(gain: Array, excess: Array, fold: Rows, count: int) -> Array:
    """Share of each fold."""
    gained, left = (np.bincount(fold, weights=part, minlength=count) for part in (gain, excess))
    return np.where(left > 0.0, gained / np.where(left > 0.0, left, 1.0), np.nan)


def unconfirmed(effect: str, without: Model, model: Model, session: ArrayLike) -> str:
    """A warning where sessions that an effect was not fitted to do not bear it out; empty where they do.

    Only the effect's own entries are fitted anew: of what the file has beside it one session may tell alone.

    Args:
        effect: Its name.
        without: The model without it.
        model: The model with it.
        session: Number of each shot's session, (S,).
    """
    own = [i for i, entry in enumerate(model.unknown.entries) if entry.effect == effect]
    before = Fitted(without.normal.of([]), np.zeros(0))
    after = Fitted(model.normal.of(own), np.zeros(len(own)))
    elsewhere = scores(before, {effect: after}, session)[effect].share
    here = (without.normal.cost - model.normal.cost) / max(without.excess, 1e-9)
    if elsewhere >= CONFIRMED * min(here, 1.0):
        return ""
    return (
        f"; one session alone supports it: fitted to the others it removes {elsewhere:.0%} of the error, "
        f"not {here:.0%}"
    )


def shared(findings: Sequence[Finding], together: float) -> list[Finding]:
    """The findings with what they explain together parted among them, where one can stand in for another.

    Then each adds little to the others, and all they add is far less than what they explain.

    Args:
        findings: Each with what it adds to the others as its share.
        together: What all of them explain.
    """
    added = sum(finding.share for finding in findings)
    if added >= OVERLAP * together or added <= 0.0:
        return list(findings)
    names, parted = " and ".join(finding.effect for finding in findings), []
    for one in findings:
        low, share, high = (value * together / added for value in (one.low, one.share, one.high))
        warning = (
            f"; {names} explain {together:.0%} together, and each can stand for most of it: this one adds "
            f"{one.share:.0%} to the others"
        )
        parted.append(replace(one, share=share, low=low, high=min(high, 1.0), advice=one.advice + warning))
    return parted


def doubted(finding: Finding, remaining: Sequence[Finding]) -> Finding:
    """The finding, with a warning and less confidence where what no effect explains is of its own size.

    Where commands answer to a disturbance, as a pilot's or a controller's do to waves, the recording holds
    the disturbance and the answer together, and inertia or damping seem to be other than they are.
    """
    rest = sum(one.share for one in remaining)
    if rest < IMITATED * finding.share:
        return finding
    warning = (
        f"; {rest:.0%} of the error no effect explains, and this estimate may absorb part of it: where the "
        "commands answer to waves or the like, fly without feedback before you trust its values"
    )
    sure = finding.confidence * finding.share / (finding.share + rest)
    return replace(finding, confidence=sure, advice=finding.advice + warning)


def outshone(findings: Sequence[Finding], left: float) -> list[Finding]:
    """The findings, all but the most telling the less sure the less they explain beside it.

    So where more than RIGHT times the noise is left: what a hull does beside its file is told as effects,
    too, and of 45 such names beside a right one none was (`benchmarks.imperfect_base`, seeds 99000 to 99059).

    Args:
        findings: In any order.
        left: Mean squared residual of the model, in units of the noise.
    """
    most = max((finding.share for finding in findings), default=0.0)
    if left <= RIGHT or most <= 0.0:
        return list(findings)
    parts = [max(finding.share, 0.0) / most for finding in findings]
    return [replace(one, confidence=one.confidence * part) for one, part in zip(findings, parts, strict=True)]


def stated(finding: Finding) -> Finding:
    """Return the finding as a suspect where its name is less sure than a statement has to be.

    Of effects that the recording does not tell apart, it is the whole group that has to be as sure.
    """
    group = finding.support if finding.verdict == "cannot_tell_apart" else 1.0
    if finding.verdict not in ("missing", "cannot_tell_apart") or finding.confidence >= SURE * group:
        return finding
    return replace(finding, verdict="suspect", advice=suspecting(finding.effect, finding.advice))


def by_likelihood_confidence(frequency: float, left: float, *, in_waves: bool = False) -> float:
    """Probability that a name is right where likelihood names it.

    Of 921 names that were all but sure on the benchmarks' recordings 908 were right where the model leaves at
    most CLEAN, and 102 of 118 where it leaves more (seeds 80000 to 84059).

    Args:
        frequency: Share of the resampled recordings in which the effect wins, see `selection_frequency`.
        left: Mean squared residual of the model, in units of the noise.
        in_waves: Whether it is beside waves of the recording, which hide much of what a model leaves.
    """
    return frequency if left <= (CALM if in_waves else CLEAN) else NEAR * frequency


def by_transfer_confidence(score: float, others: Sequence[float]) -> float:
    """Probability that a name is right where no model reaches the noise.

    A logistic regression of right and wrong first names on the score and its lead, on 46 recordings of hulls
    of panels with one change or none (`benchmarks.imperfect_base`, seeds for development).  The lead is the
    share of what the next best leaves that the best removes: where many effects remove nearly all of an
    error, any could be it.

    Args:
        score: Share of the error of left-out data that the effect removes, see `diagnosis.transfer`.
        others: The same of all others.
    """
    next_best = max(others, default=0.0)
    lead = 1.0 - (1.0 - score) / max(1.0 - next_best, 1e-9)
    return float(expit(ODDS + ODDS_BY_SCORE * score + ODDS_BY_LEAD * max(lead, 0.0)))


def by_evidence_confidence(evidence: float, others: Sequence[float]) -> float:
    """Probability that a name is right where evidence beside what the hull may do orders the names.

    A logistic curve in the logarithm of its lead, on 29 recordings of hulls of panels with one change and 16
    with none (`benchmarks.imperfect_base`, seeds 1000 to 1029): in theory a lead of 3 leaves one in twenty,
    but no library has all that a hull does.  Evidence counts numbers as independent that may not be, so that
    the lead has to be a part of it, too: in a real vehicle's log, of which 16,000 times the noise is left,
    gains of nine thrusters led by 109 of 1558, three of them dead.

    Args:
        evidence: Logarithm of the evidence for it, see `residual.allowance`.
        others: The same of all others.
    """
    lead = max(evidence - max([0.0, *others]), 0.0)
    part = min(lead / (AHEAD * max(evidence, 1e-300)), 1.0)
    return float(part * expit(BY_LEAD * (np.log1p(lead) - HALF)))
