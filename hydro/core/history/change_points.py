"""Tests for level shifts in a history of estimates, with false alarms limited over all parameters and dives.

Whenever a dive is added, every parameter is tested at every possible date of a shift (a generalised
likelihood ratio test; Basseville and Nikiforov, Detection of Abrupt Changes, 1993).  The scatter between
dives comes from the history itself: the dives before and after a date scatter about their means by a factor
times their standard errors.  The factors of all parameters are shrunk towards each other (the moderated
t-statistic; G. K. Smyth, Linear models and empirical Bayes methods, Statistical Applications in Genetics and
Molecular Biology 3, 3, 2004), and a factor is at least 1.  So standard errors that are too small do not cause
alarms.

The shift is that of the means or of the inner middle values on both sides, whichever is smaller, so that one
outlier among few dives makes no shift.

A part of the level is spent by Bonferroni's inequality over all parameters and dates, again for each dive.
Hence the expected number of false alarms in a history of N unchanged dives is at most N times LEVEL, however
long the history becomes.

Dives are numbered from 0.  A date is the number of the first dive after a shift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from hydro.core.columns import Array, Mask, Rows

LEVEL = 1.0 / 500.0
"""Expected number of false alarms per unchanged dive, over all parameters [1]: at most one in 500 dives."""
RESERVE = 4.0
"""Factor by which the spent level is below LEVEL: heavy-tailed scatter causes more alarms than Student's t.

Simulated Student-t(3) scatter with standard errors one to four times too small caused 9 alarms in 3,120 dives
without this reserve and 6 with it.
"""
AFTER = 2
"""Minimum number of dives after a shift: a single odd dive is not a change of the vehicle."""
BEFORE = 2
"""Minimum number of dives before a shift; or the number of baseline dives, if greater."""
MOST_PRIOR = 20.0
"""Maximum degrees of freedom that the scatter of all other parameters adds to that of a parameter."""


@dataclass(frozen=True)
class Alarm:
    """Alarm of the tests: a level shift of one parameter of the vehicle.

    Attributes:
        parameter: Row of the parameter in the table of estimates, from 0.
        date: Number of the first dive after the shift, from 0.
        found: Number of the dive whose estimate caused the alarm, from 0.
    """

    parameter: int
    date: int
    found: int


def alarms(values: Array, errors: Array, baseline: int, level: float = LEVEL) -> list[Alarm]:
    """Return the level shifts in a history of estimates, in the order in which added dives show them.

    After a shift is found, only the dives since then are compared.

    Args:
        values: Estimates of P parameters in N dives, (P, N); NaN where a dive has none.
        errors: Standard errors of the estimates, (P, N).
        baseline: Number of dives at the start that count as unchanged.
        level: Expected number of false alarms per unchanged dive.
    """
    found, begin = list[Alarm](), np.zeros(len(values), np.int64)
    for count in range(max(baseline, BEFORE) + AFTER, values.shape[1] + 1):
        test = shifts(values[:, :count], errors[:, :count], begin, baseline)
        allowed = level / RESERVE / max(int(np.isfinite(test.p).sum()), 1)
        p = np.where(np.isfinite(test.p), test.p, 1.0)
        for row in np.flatnonzero(p.min(axis=1, initial=1.0) < allowed):
            date = int(test.dates[p[row].argmin()])
            found.append(Alarm(int(row), date, count - 1))
            begin[row] = date
    return found


@dataclass(frozen=True)
class Shifts:
    """Results of tests of P parameters for a level shift at K dates.

    Attributes:
        dates: Number of the first dive after the shift, from 0, (K,).
        p: p-value of each parameter at each date, (P, K); NaN where no shift was tested.
    """

    dates: Rows
    p: Array


def shifts(values: Array, errors: Array, begin: Rows, baseline: int) -> Shifts:
    """Return p-values of level shifts, for every parameter at every possible date.

    A date is the number of the first dive after a shift, from 0.

    Args:
        values: Estimates of P parameters in N dives, (P, N); NaN where a dive has none.
        errors: Standard errors of the estimates, (P, N).
        begin: First dive to compare, for each parameter, (P,): the date of its last shift, or 0.
        baseline: Number of dives at the start that count as unchanged.
    """
    count = values.shape[1]
    dates = np.arange(BEFORE, count - AFTER + 1)
    dive = np.arange(count)
    there = np.isfinite(values) & np.isfinite(errors) & (dive >= begin[:, None])
    weight = np.where(there, 1.0 / variances(errors, there), 0.0)
    value = np.where(there, values, 0.0)
    after = (dive >= dates[:, None]).astype(float)
    sides = np.stack([1.0 - after, after])  # (2, K, N)
    numbers = np.einsum("pn,skn->spk", there.astype(float), sides)
    total = np.einsum("pn,skn->spk", weight, sides)
    mean = np.einsum("pn,skn->spk", weight * value, sides) / np.maximum(total, 1e-300)
    squares = (weight * value**2).sum(axis=1)[:, None] - (total * mean**2).sum(axis=0)
    freedom = numbers.sum(axis=0) - 2.0
    first = np.where(begin > 0, begin + BEFORE, max(baseline, BEFORE))
    tested = (numbers[0] >= BEFORE) & (numbers[1] >= AFTER) & (dates >= first[:, None]) & (freedom > 0.0)
    factor, degrees = moderated(np.maximum(squares, 0.0), freedom, tested)
    shift = mean[1] - mean[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = shift / np.sqrt(np.maximum(factor, 1.0) * (1.0 / total).sum(axis=0))
        p = np.where(tested, 2.0 * scipy.special.stdtr(degrees, -np.abs(t)), np.nan)
    for row, column in zip(*np.nonzero(p < LEVEL), strict=True):
        inner = _inner_shift(values[row], there[row], int(dates[column]), np.sign(shift[row, column]))
        share = min(max(inner, 0.0) / abs(shift[row, column]), 1.0)
        p[row, column] = 2.0 * scipy.special.stdtr(degrees[row, column], -share * abs(t[row, column]))
    return Shifts(dates, p)


def variances(errors: Array, there: Mask) -> Array:
    """Return the variance of each estimate up to a common factor for each parameter, (P, N).

    A variance is the mean of the squared standard error and of the median of these squares over the dives.
    So a dive with a far too small standard error does not outweigh all others.

    Args:
        errors: Standard errors of P parameters in N dives, (P, N).
        there: Mask of the estimates that exist, (P, N).
    """
    stated = np.where(there, errors, np.nan) ** 2
    with np.errstate(all="ignore"):
        middle = np.array(
            [np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else 1.0 for row in stated]
        )
    both: Array = 0.5 * (np.where(there, stated, 0.0) + middle[:, None])
    return np.maximum(both, 1e-300)


def moderated(squares: Array, freedom: Array, tested: Mask) -> tuple[Array, Array]:
    """Return the scatter of the estimates about their means, shrunk towards the mean over all parameters.

    Args:
        squares: Weighted sum of squares of P parameters about their means before and after each of K dates,
            (P, K).
        freedom: Degrees of freedom of these sums, (P, K).
        tested: Mask of the parameters and dates that count, (P, K).

    Returns:
        Mean squared deviations in units of the squared standard errors, and their degrees of freedom, (P, K)
        each.
    """
    d = np.maximum(freedom, 1.0)
    own = np.maximum(squares / d, 1e-12)
    many = tested.sum(axis=0)
    e = np.where(tested, np.log(own) - scipy.special.digamma(0.5 * d) + np.log(0.5 * d), 0.0)
    mean = e.sum(axis=0) / np.maximum(many, 1)
    spread = (np.where(tested, (e - mean) ** 2, 0.0)).sum(axis=0) / np.maximum(many - 1, 1)
    chance = np.where(tested, scipy.special.polygamma(1, 0.5 * d), 0.0).sum(axis=0) / np.maximum(many, 1)
    prior = np.minimum(2.0 * inverse_trigamma(np.maximum(spread - chance, 1e-6)), MOST_PRIOR)
    prior = np.where(many > 1, prior, 0.0)
    half = 0.5 * np.maximum(prior, 1e-6)
    common = np.exp(mean + scipy.special.digamma(half) - np.log(half))
    factor: Array = (prior * common + d * own) / (prior + d)
    return factor, prior + d


def inverse_trigamma(y: Array) -> Array:
    """Return the positive x for which the trigamma function has the value y > 0, an array like `y`.

    Newton's method is applied to 1 / trigamma (Smyth 2004, appendix).
    """
    x = 0.5 + 1.0 / y
    for _ in range(20):
        value = scipy.special.polygamma(1, x)
        x = x + value * (1.0 - value / y) / scipy.special.polygamma(2, x)
    return np.asarray(x)


def _inner_shift(values: Array, there: Mask, date: int, sign: float) -> float:
    """Return the shift between the middle values on both sides of a date that are nearer to each other.

    Args:
        values: Estimates of one parameter, (N,).
        there: Which of them exist, (N,).
        date: First dive after the shift.
        sign: Sign of the shift of the means.
    """
    before = np.sort(sign * values[:date][there[:date]])
    after = np.sort(sign * values[date:][there[date:]])
    return float(after[(len(after) - 1) // 2] - before[len(before) // 2])
