"""Levenberg-Marquardt iteration within bounds, with a line search for components that act in steps.

The half-width of a dead band acts on a row of commands or it does not.  The cost has a corner at the best
value, rises in steps away from it, and has false minima farther away.  Derivatives are useless there, so such
a component is searched along its own line, from wide to narrow (`searched`).

Its standard error cannot come from a curvature either, since that depends on the step of the difference.
Near a corner of slope a, the cost is a |x| plus a Brownian motion of variance 4 a |x|.  Its minimum scatters
about the truth with a standard deviation of sqrt(26)/a.  Here 26 is the variance of the minimiser of W(s) +
|s|/2, W a two-sided Brownian motion (its density in Y.-C. Yao, Approximating the distribution of the maximum
likelihood estimate of the change-point in a sequence of independent random variables, Annals of Statistics
15, 1321-1328, 1987).  A derivative over h has the information a/h.  Both agree where h is sqrt(26) times the
standard error that h itself gives: `over_standard_errors` uses that h.  For a smooth cost, h makes no
difference.  Where the commands hold little information on the dead band, the cost far from its best value
sets the standard error (`_reach`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from hydro.core.columns import Array
from hydro.core.prediction.normal_equations import Normal, bounded_step, covariance
from hydro.core.prediction.parameters import Free
from hydro.core.vehicle.description import Vehicle

PRIOR = 10.0
"""Prior standard deviation of each parameter in scales: undetermined parameters keep their initial values."""
ITERATIONS = 25
ENOUGH = 0.01  # minimum gain of a step, in units of the reduced chi-square
ALONE = 30.0  # minimum gain of steps in the shots' own unknowns alone, as a multiple of that share
GIVEN_UP = 1e8  # damping at which no step lowers the cost
WIDEST, NARROWER = 0.2, 0.25  # search: spacing of the trials in scales, and the factor by which it shrinks
PLACES = np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0])
ROUNDS, SAME = 5, 0.75  # iterations of step and standard error; ratio above which a step counts as unchanged
ERRORS = 26.0**0.5  # step of a derivative in standard errors
FINER = 2.0**0.5  # ratio of consecutive distances in the search for a standard error


@dataclass(frozen=True)
class Prior:
    """Normal prior distribution of P independent parameters, in units of the components' scales.

    Attributes:
        centre: Mean of the distribution, (P,).
        information: Inverse of the variances, (P,), in units of the least-squares problem's information.
        tempered: Whether each step of a fit multiplies the information by the present reduced chi-square.
            Where a model is wrong, a unit of squared residual holds less information.
    """

    centre: Array
    information: Array
    tempered: bool = False

    @classmethod
    def weak(cls, start: Array) -> Prior:
        """Return a prior with a standard deviation of PRIOR scales about initial values.

        Args:
            start: Initial values in units of the components' scales, (P,).
        """
        return cls(start, np.full(len(start), PRIOR**-2))

    def at(self, chi2: float) -> Prior:
        """Return the prior of a step from a reduced chi-square of `chi2`."""
        if not self.tempered or not 1.0 < chi2 < np.inf:
            return self
        return replace(self, information=chi2 * self.information)

    def cost(self, x: Array) -> float:
        """Return the sum of squared deviations of values from the prior's mean, each times its information.

        Args:
            x: Values in units of the components' scales, (P,).
        """
        return float((self.information * (x - self.centre) ** 2).sum())


PROFILE = (-2.0, -1.0, 1.0, 2.0)
"""Offsets of a profile from the best value, in standard errors."""


class Problem(Protocol):
    """Protocol of a least-squares problem whose parameters are numbers of a vehicle file.

    A problem may have internal unknowns, such as the initial states of shots, and weights of its residuals.
    """

    def linearise(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Normal:
        """Return the normal equations of the problem, linearised about a vehicle.

        Args:
            base: The vehicle.
            moved: Copies of the vehicle with one changed parameter each.
            steps: Size of each change, in units of the parameter's scale.
        """

    def cost(self, vehicle: Vehicle, step: Array, normal: Normal) -> tuple[float, Problem]:
        """Return the sum of squares after a step, and a new problem with its internal unknowns updated.

        Args:
            vehicle: Vehicle after the step.
            step: Change of the P parameters, in units of their scales, (P,).
            normal: Problem linearised before the step.
        """

    def reweighted(self, normal: Normal) -> tuple[Problem, bool]:
        """Return a new problem with weights that fit its residuals, and whether the weights changed.

        Args:
            normal: Problem linearised at the present estimate.
        """


def descend(
    unknown: Free,
    start: Array,
    problem: Problem,
    iterations: int,
    enough: float = ENOUGH,
    share: float = 0.0,
    prior: Prior | None = None,
    normal: Normal | None = None,
) -> tuple[Array, Normal, Problem]:
    """Minimise the cost of a problem by Levenberg-Marquardt steps within bounds; return values and problem.

    The iteration ends when a step lowers the cost by too little.  The limit is `enough` times the reduced
    chi-square, or `share` times the cost in excess of the noise, whichever is larger.

    Args:
        unknown: The P free components.
        start: Initial values in the components' units, (P,).
        problem: The problem.
        iterations: Maximum number of steps.
        enough: Factor of the reduced chi-square in the limit of the gain.
        share: Factor of the cost in excess of the noise in that limit.
        prior: Prior of the values; by default a weak prior about `start`.
        normal: Problem linearised at `start`, if available.

    Returns:
        Values in the components' units, (P,); the problem linearised at the values; and the problem with its
        internal unknowns updated.
    """
    scales = unknown.scales
    low, high = (bound / scales for bound in unknown.bounds)
    x = start / scales
    normal = normal or linearised(unknown, x, problem)
    given, damping, reached = prior or Prior.weak(x), 1e-6, np.inf
    for _ in range(iterations):
        prior = given.at(normal.chi2)
        known = prior.information
        matrix = normal.matrix.sum(axis=0) + np.diag(known)
        score = normal.score.sum(axis=0) - known * (x - prior.centre)
        worth = max(enough * max(1.0, normal.chi2), share * (normal.cost - normal.residuals))
        # A step must beat a step of the pieces' internal unknowns alone.  Its cost is computed if needed.
        fine, stay = prior.cost(x), None  # type: float, tuple[float, Problem] | None
        stride = np.zeros(len(x))
        while damping < GIVEN_UP:
            step = bounded_step(matrix + damping * np.diag(np.diag(matrix)), score, low - x, high - x)
            promise = float(2.0 * score @ step - step @ matrix @ step)
            if promise < worth:
                break
            trial = unknown.within((x + step) * scales)
            cost, along = problem.cost(unknown.at(trial), step, normal)
            total = cost + prior.cost(x + step)
            if stay is None and not total < normal.cost + fine:
                stay = _stayed(unknown, x, problem, normal)
            if total < (normal.cost if stay is None else stay[0]) + fine:
                stride = step
                break
            damping = max(damping * 10.0, 1e-4)
        # Without a step, only the pieces' internal unknowns are updated, while that lowers the cost.
        if not stride.any():
            cost, along = stay or _stayed(unknown, x, problem, normal)
            little = ALONE * share * (normal.cost - normal.residuals)
            if min(cost - normal.cost, reached - cost) <= max(worth, little, 1e-9 * cost):
                break
        reached, x, problem, damping = cost, x + stride, along, max(damping * 0.1, 1e-9)
        normal = linearised(unknown, x, problem)
    return unknown.within(x * scales), normal, problem


def _stayed(unknown: Free, x: Array, problem: Problem, normal: Normal) -> tuple[float, Problem]:
    """Return the cost at fixed x (P,) in scales, and the problem with its internal unknowns updated."""
    return problem.cost(unknown.at(unknown.within(x * unknown.scales)), np.zeros(len(x)), normal)


def linearised(unknown: Free, x: Array, problem: Problem) -> Normal:
    """Return a least-squares problem linearised by one-sided differences within the components' bounds.

    Args:
        unknown: The P free components.
        x: Values about which to linearise, in units of the components' scales, (P,).
        problem: The problem.
    """
    here = unknown.within(x * unknown.scales)
    return problem.linearise(unknown.at(here), *moved(unknown, here))


def moved(unknown: Free, here: Array) -> tuple[list[Vehicle], list[float]]:
    """Return P vehicles with one component each moved a little within its bounds, and the P steps.

    Args:
        unknown: The P free components.
        here: Values of the components, in their units, (P,).

    Returns:
        The vehicles, and the signed sizes of their changes in units of the components' scales.
    """
    vehicles, steps, (_, high) = [], [], unknown.bounds
    for i, entry in enumerate(unknown.entries):
        values = here.copy()
        step = entry.step if values[i] + entry.step <= high[i] else -entry.step
        values[i] += step
        vehicles.append(unknown.at(values))
        steps.append(step / entry.scale)
    return vehicles, steps


def linear_step(normal: Normal, columns: Sequence[int]) -> tuple[float, Array]:
    """Return the squared residual that some columns explain, and their coefficients, with all others fixed.

    Directions that the recording does not determine, such as two thrusters with equal commands, stay
    unchanged.

    Args:
        normal: Linearised problem.
        columns: Indices of the p columns (components) that may change.

    Returns:
        Reduction of the squared residual, and coefficients of the columns, (p,).
    """
    chosen = list(columns)
    known = normal.matrix.sum(axis=0)[np.ix_(chosen, chosen)]
    known += PRIOR**-2 * max(normal.chi2, 1.0) * np.eye(len(chosen))
    score = normal.score.sum(axis=0)[chosen]
    step = np.linalg.solve(known, score)
    return float(score @ step), step


def searched(unknown: Free, values: Array, problem: Problem, narrowest: float = 0.0) -> Array:
    """Return values in which every component that acts in steps is at its best value on a line search.

    Such a component, for example a dead band, has a cost with corners.  At each trial value, all other
    components follow the linearised problem.

    Args:
        unknown: The P free components.
        values: Initial values, (P,).
        problem: The problem.
        narrowest: Spacing of trial values at which the search ends, in units of the component's scale; the
            search ends at the component's resolution if that is wider.

    Returns:
        New values, (P,).
    """
    low, high = unknown.bounds
    for i, entry in enumerate(unknown.entries):
        width = WIDEST
        while entry.resolution and width >= max(entry.resolution, narrowest):
            trials = np.repeat(values[None], len(PLACES) + 1, axis=0)
            trials[1:, i] = np.clip(values[i] + width * entry.scale * PLACES, low[i], high[i])
            values = trials[np.argmin(_profile(unknown, trials, problem))]
            width *= NARROWER
    return values


def _profile(unknown: Free, trials: Array, problem: Problem) -> Array:
    """Return the sum of squares of each of `trials` (K, P), with smooth components at their best values."""
    smooth = unknown.holding(trials[0], np.array([entry.resolution > 0.0 for entry in unknown.entries]))
    nudged, steps = moved(smooth, smooth.starts[0])
    others = [unknown.at(trial) for trial in trials[1:]]
    gram = problem.linearise(unknown.at(trials[0]), nudged + others, steps + [1.0] * len(others)).gram
    total, count = gram.sum(axis=0), len(nudged)
    if not np.isfinite(total).all():  # the motion of a trial diverges: stay, and try closer values
        return np.arange(float(len(trials)))
    # The residual of a trial is that of the first minus the column from the first to the trial.
    way = np.vstack([np.zeros((1, len(trials) - 1)), np.eye(len(trials) - 1)])
    pick = np.hstack([np.zeros((len(trials), count)), -way, np.ones((len(trials), 1))])
    squares = np.einsum("ki,ij,kj->k", pick, total, pick)
    scores = pick @ total[:, :count]
    best = np.linalg.solve(total[:count, :count] + np.eye(count) * PRIOR**-2, scores.T)
    cost: Array = squares - np.einsum("ki,ik->k", scores, best)
    return cost


def over_standard_errors(unknown: Free, values: Array, normal: Normal, problem: Problem) -> Normal:
    """Return the problem linearised at the best values, with wide differences where components act in steps.

    For such a component, for example a dead band, the difference is sqrt(26) standard errors wide, for which
    the module gives the reason.  Widths are tried from wide to narrow.  The loop ends at a width that
    contains no row of commands.

    Args:
        unknown: The P free components.
        values: Best values, (P,).
        normal: The problem linearised at the values with plain differences.
        problem: The problem.
    """
    stepped = np.array([entry.resolution > 0.0 for entry in unknown.entries])
    before = errors_of(normal)
    for _ in range(ROUNDS):
        steps = np.array([entry.step / entry.scale for entry in unknown.entries])
        wanted = np.where(stepped, np.minimum(ERRORS * before, steps), steps)
        if (wanted > SAME * steps).all():
            break
        pairs = zip(unknown.entries, wanted * unknown.scales, strict=True)
        unknown = replace(unknown, entries=tuple(replace(e, step=float(step)) for e, step in pairs))
        narrower = linearised(unknown, values / unknown.scales, problem)
        errors = errors_of(narrower)
        if (errors[stepped] > before[stepped]).any():
            break
        normal, before = narrower, errors
    for i in np.flatnonzero(stepped):
        share = before[i] / max(before[i], _reach(unknown, values, int(i), problem))
        gram = normal.gram.copy()
        gram[:, i, :] *= share
        gram[:, :, i] *= share
        normal = replace(normal, gram=gram)
    return normal


def profiled(
    unknown: Free, values: Array, normal: Normal, problem: Problem, errors: Array, entries: Sequence[int]
) -> Array:
    """Return standard errors that include the nonlinear uncertainty of given components, (P,).

    An undetermined exponent makes its coefficient far more uncertain than the local curvature shows, since a
    drag with another exponent may imitate a quadratic drag.  Each given component is set to each offset of
    PROFILE, and all other components are refitted.  Each of these fits has the weight of its likelihood.  The
    variance of a value is the mean variance of the fits plus the variance between them.

    Args:
        unknown: The P free components.
        values: Best values, (P,).
        normal: The problem linearised at the values.
        problem: The fitted problem.
        errors: Standard errors of the values, (P,).
        entries: Indices of the given components.
    """
    found = errors.copy()
    for i in entries:
        held, weight, variance = np.arange(len(values)) == i, 1.0, errors**2
        for side in PROFILE:
            there = unknown.within(values + side * errors * held)
            if there[i] == values[i]:
                continue
            rest = unknown.holding(there, held)
            others, moved_on, _ = descend(rest, rest.starts[0], problem, ITERATIONS)
            likely = np.exp(-0.5 * max(moved_on.cost - normal.cost, 0.0) / max(normal.chi2, 1.0))
            spread = (others - values[~held]) ** 2 + (errors_of(moved_on) * rest.scales) ** 2
            variance[~held] += likely * spread
            variance[i] += likely * (there[i] - values[i]) ** 2
            weight += likely
        found = np.maximum(found, np.sqrt(variance / weight))
    return found


def _reach(unknown: Free, values: Array, i: int, problem: Problem) -> float:
    """Return a lower limit of a standard error, in scales, from costs far from the best value.

    The cost is constant between two levels of the commands, so any value there is equally good.  If few rows
    of commands lie near the dead band, the cost has several minima, and curvature or slope at one of them
    means nothing.  Three standard errors then reach at least to the farthest place with a sum of squares less
    than 9 above the best.
    """
    entry, (low, high) = unknown.entries[i], unknown.bounds
    first, widest = entry.resolution * entry.scale, max(values[i] - low[i], high[i] - values[i])
    steps = first * FINER ** np.arange(np.ceil(np.log(widest / first) / np.log(FINER)) + 1)
    trials = np.repeat(values[None], 2 * len(steps) + 1, axis=0)
    trials[1:, i] = np.clip(values[i] + np.hstack([steps, -steps]), low[i], high[i])
    rise = _profile(unknown, trials, problem)
    rise = (rise[1:] - rise[0]).reshape(2, -1)
    away = np.abs(trials[1:, i] - values[i]).reshape(2, -1) / entry.scale
    risen = (rise > 1.0) | (away == away[:, -1:])
    plateau = float(away[[0, 1], risen.argmax(axis=1)].sum())
    return float(max(plateau / 12.0**0.5, np.where(rise < 9.0, away, 0.0).max() / 3.0))


def errors_of(normal: Normal) -> Array:
    """Return standard errors of a linearised problem's P parameters in units of their scales, (P,)."""
    count = normal.score.shape[1]
    return np.asarray(np.sqrt(np.diag(covariance(normal, np.full(count, PRIOR**-2)))))
