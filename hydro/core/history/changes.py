"""Changes of a vehicle over its dives: level shifts with their sizes, or slow trends.

A trend causes one level shift after another.  So the shifts of a parameter are compared with a broken line,
constant up to a dive and straight after it.  The model with the lower Bayesian information criterion is
chosen (G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6, 461-464, 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hydro.core.columns import Array, Mask
from hydro.core.history.change_points import AFTER, BEFORE, LEVEL, Alarm, alarms, variances

RAMP = 4
"""Minimum number of dives along a trend: with fewer dives, a trend and a shift look alike."""
CLEARLY = 2.0
"""Minimum advantage of a trend over shifts in the information criterion.

It is positive evidence on the scale of Kass and Raftery, Journal of the American Statistical Association 90,
773-795, 1995.
"""


@dataclass(frozen=True)
class Change:
    """Change of one parameter of a vehicle over its dives.

    Attributes:
        parameter: Row of the parameter in the table of estimates, from 0.
        kind: `shift` or `trend`.
        date: Number of the first dive after a shift, or of the last dive before a trend, from 0.
        found: Number of the dive whose estimate caused the alarm, from 0.
        before: Level of the parameter before the change.
        after: Level after a shift, or at the last dive of a trend.
        error: Standard error of the difference of the levels.
    """

    parameter: int
    kind: Literal["shift", "trend"]
    date: int
    found: int
    before: float
    after: float
    error: float

    @property
    def size(self) -> float:
        """Difference of the levels, after minus before."""
        return self.after - self.before


@dataclass(frozen=True)
class Fitted:
    """Least-squares fit of the history of one parameter over N dives.

    Attributes:
        cost: Sum of squared residuals, in units of the variances.
        levels: Fitted value in each dive, (N,).
        coefficients: Coefficients of the C columns of the regression, (C,).
        covariance: Covariance of the coefficients, up to the factor of the scatter, (C, C).
    """

    cost: float
    levels: Array
    coefficients: Array
    covariance: Array


def changes(values: Array, errors: Array, baseline: int, level: float = LEVEL) -> list[Change]:
    """Return the level shifts and trends in a history of estimates, in the order of their dates.

    Args:
        values: Estimates of P parameters in N dives, (P, N); NaN where a dive has none.
        errors: Standard errors of the estimates, (P, N).
        baseline: Number of dives at the start that count as unchanged.
        level: Expected number of false alarms per unchanged dive.
    """
    raised = alarms(values, errors, baseline, level)
    found = list[Change]()
    for row in dict.fromkeys(alarm.parameter for alarm in raised):
        there = np.isfinite(values[row]) & np.isfinite(errors[row])
        variance = variances(errors[row : row + 1], there[None])[0]
        mine = [alarm for alarm in raised if alarm.parameter == row]
        found += _of_parameter(row, values[row], variance, there, mine, max(baseline, BEFORE))
    return sorted(found, key=lambda one: (one.date, one.parameter))


def levels(values: Array, errors: Array, found: Sequence[Change], row: int) -> Array:
    """Return the value of one parameter in every dive, fitted with the changes that were found, (N,).

    Args:
        values: Estimates of P parameters in N dives, (P, N).
        errors: Standard errors of the estimates, (P, N).
        found: All changes of the history, from `changes`.
        row: Row of the parameter in `values`.
    """
    there = np.isfinite(values[row]) & np.isfinite(errors[row])
    variance = variances(errors[row : row + 1], there[None])[0]
    mine = [one for one in found if one.parameter == row]
    if any(one.kind == "trend" for one in mine):
        return _broken(values[row], variance, there, mine[0].date).levels
    return _steps(values[row], variance, there, [one.date for one in mine]).levels


def _of_parameter(
    row: int, values: Array, variance: Array, there: Mask, raised: Sequence[Alarm], first: int
) -> list[Change]:
    """Return the changes of one parameter: shifts, or a trend if it describes the history better.

    Args:
        row: Row of the parameter.
        values: Its estimates, (N,).
        variance: Their variances up to a factor, (N,).
        there: Which of them exist, (N,).
        raised: Alarms of the parameter.
        first: First possible date of a change.
    """
    count, used = len(values), int(there.sum())
    dates = _refined(values, variance, there, [alarm.date for alarm in raised], first)
    stepped = _steps(values, variance, there, dates)
    breaks = [c for c in range(first - 1, count - RAMP) if there[c + 1 :].sum() >= RAMP]
    lines = {c: _broken(values, variance, there, c) for c in breaks}
    best = min(lines, key=lambda c: lines[c].cost, default=None)
    freedom = max(used - 2 * len(dates) - 1, 1)
    factor = max(stepped.cost / freedom, 1.0)
    if best is not None:
        line = lines[best]
        factor_of_line = max(line.cost / max(used - 3, 1), 1.0)
        unit = min(factor, factor_of_line)
        gain = (stepped.cost - line.cost) / unit + (2 * len(dates) - 2) * np.log(used)
        if gain >= CLEARLY:
            before, slope = line.coefficients
            span = count - 1 - best
            error = float(np.sqrt(factor_of_line * line.covariance[1, 1]) * span)
            after = float(before + slope * span)
            return [Change(row, "trend", best, raised[0].found, float(before), after, error)]
    heights = stepped.coefficients
    errors = [float(np.sqrt(factor * stepped.covariance[i, i])) for i in range(1, len(heights))]
    ends = np.cumsum(heights)
    return [
        Change(row, "shift", date, alarm.found, float(ends[i]), float(ends[i + 1]), errors[i])
        for i, (date, alarm) in enumerate(zip(dates, raised, strict=True))
    ]


def _refined(values: Array, variance: Array, there: Mask, dates: Sequence[int], first: int) -> list[int]:
    """Return the dates of shifts, each moved to the date of best fit between its neighbours."""
    found, count = list(dates), len(values)
    for i in range(len(found)):
        low = found[i - 1] + BEFORE if i else first
        high = found[i + 1] - BEFORE if i + 1 < len(found) else count - AFTER
        tried = range(min(low, found[i]), max(high, found[i]) + 1)
        costs = [_steps(values, variance, there, [*found[:i], date, *found[i + 1 :]]).cost for date in tried]
        found[i] = tried[int(np.argmin(costs))]
    return found


def _steps(values: Array, variance: Array, there: Mask, dates: Sequence[int]) -> Fitted:
    """Fit constant levels between dates; the coefficients are the first level and the size of each shift."""
    dive = np.arange(len(values))
    return _least_squares(
        values, variance, there, [np.ones(len(dive)), *((dive >= d).astype(float) for d in dates)]
    )


def _broken(values: Array, variance: Array, there: Mask, last: int) -> Fitted:
    """Fit a constant level up to dive `last` and a straight line after it; coefficients: level and slope."""
    dive = np.arange(len(values))
    return _least_squares(values, variance, there, [np.ones(len(dive)), np.maximum(dive - last, 0.0)])


def _least_squares(values: Array, variance: Array, there: Mask, columns: Sequence[Array]) -> Fitted:
    """Fit a sum of columns (N,) to the estimates of one parameter, weighted by their variances."""
    design = np.column_stack(columns)
    weight = np.where(there, 1.0 / variance, 0.0)
    known = np.where(there, values, 0.0)
    covariance = np.asarray(np.linalg.pinv(design.T @ (weight[:, None] * design)), float)
    found = covariance @ (design.T @ (weight * known))
    fitted = design @ found
    return Fitted(float((weight * (known - fitted) ** 2).sum()), fitted, found, covariance)
