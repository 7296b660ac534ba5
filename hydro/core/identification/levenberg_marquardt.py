"""To the best values: a Levenberg-Marquardt iteration within bounds, and a search where it finds no slope.

The half-width of a dead band acts on a row of commands or does not.  The cost has a corner at the best value,
rises in steps away from it and has false valleys farther off, so that derivatives lead nowhere: such an entry
is searched along its own line, from wide to narrow (`searched`).

Its standard error cannot come from a curvature either, which depends on how far apart it is taken.  Near a
corner of slope a the cost is a |x| and a Brownian motion of variance 4 a |x|, whose lowest point scatters
about the truth with a standard deviation of sqrt(26)/a: 26 is the variance of the place where W(s) + |s|/2 is
least, W a Brownian motion in both directions (its density in Y.-C. Yao, Approximating the distribution of the
maximum likelihood estimate of the change-point in a sequence of independent random variables, Annals of
Statistics 15, 1321-1328, 1987).  A derivative over h has the information a/h.  Where h is sqrt(26) times the
standard error that it gives itself, both agree: `over_standard_errors` takes that h.  Of a smooth cost no h
changes anything.  Where the commands say little about the dead band, the cost far from its best value tells
how much (`_reach`).
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
"""Scales by which a parameter may move before the fit asks for evidence: it keeps what is not determined."""
ITERATIONS = 25
ENOUGH = 0.01  # a step that lowers the cost by less than this many residuals' worth ends an iteration
ALONE = 30.0  # times that share: what pieces' own unknowns gain where no value moves, changes no value
GIVEN_UP = 1e8  # damping at which no step lowers the cost
WIDEST, NARROWER = 0.2, 0.25  # of a search: distance of its places in scales, and how it shrinks
PLACES = np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0])
ROUNDS, SAME = 5, 0.75  # of steps and standard errors; what is no change of a step
ERRORS = 26.0**0.5  # standard errors that a derivative is taken over
FINER = 2.0**0.5  # from one distance to the next at which a standard error is looked for


@dataclass(frozen=True)
class Prior:
    """What is known of parameters beforehand: a normal distribution, in units of the entries' scales.

    Attributes:
        centre: Its mean, (P,).
        information: Inverse of its variances, (P,), in units of the least-squares problem's information.
    """

    centre: Array
    information: Array

    @classmethod
    def weak(cls, start: Array) -> Prior:
        """PRIOR scales about where a fit begins, (P,) in scales."""
        return cls(start, np.full(len(start), PRIOR**-2))

    def cost(self, x: Array) -> float:
        """What values (P,) in scales cost by it."""
        return float((self.information * (x - self.centre) ** 2).sum())


PROFILE = (-2.0, -1.0, 1.0, 2.0)
"""Standard errors by which an entry goes from its best value where its profile is asked for."""


class Problem(Protocol):
    """What the iteration asks of a method."""

    def linearise(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Normal:
        """The least-squares problem about a vehicle."""

    def cost(self, vehicle: Vehicle, step: Array, normal: Normal) -> tuple[float, Problem]:
        """Sum of squares after a step, and the problem with its own unknowns moved along."""

    def reweighted(self, normal: Normal) -> tuple[Problem, bool]:
        """The problem with weights that fit its residuals, and whether they differ."""


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
    """Levenberg-Marquardt within bounds, in units of the entries' scales, from `start`.

    `prior` is what is known of the values; by default, little.  `normal` is the problem about the start,
    where it is at hand.  It ends where a step would lower the cost by
    less than `enough` residuals' worth, or by less than a share of what there is beyond the noise.
    """
    scales = unknown.scales
    low, high = (bound / scales for bound in unknown.bounds)
    x = start / scales
    prior = prior or Prior.weak(x)
    damping, reached, known = 1e-6, np.inf, prior.information
    normal = normal or linearised(unknown, x, problem)
    for _ in range(iterations):
        matrix = normal.matrix.sum(axis=0) + np.diag(known)
        score = normal.score.sum(axis=0) - known * (x - prior.centre)
        worth = max(enough * max(1.0, normal.chi2), share * (normal.cost - normal.residuals))
        # A step has to beat the cost where the parameters stay and only the pieces' own unknowns move.  The
        # linear problem says what that is; it is predicted where a step does not come below what that says.
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
        # Without a step the pieces' own unknowns move on alone, while that brings them on.
        if not stride.any():
            cost, along = stay or _stayed(unknown, x, problem, normal)
            little = ALONE * share * (normal.cost - normal.residuals)
            if min(cost - normal.cost, reached - cost) <= max(worth, little, 1e-9 * cost):
                break
        reached, x, problem, damping = cost, x + stride, along, max(damping * 0.1, 1e-9)
        normal = linearised(unknown, x, problem)
    return unknown.within(x * scales), normal, problem


def _stayed(unknown: Free, x: Array, problem: Problem, normal: Normal) -> tuple[float, Problem]:
    """Cost where the parameters stay at x (P,) in scales, and the problem with its own unknowns moved."""
    return problem.cost(unknown.at(unknown.within(x * unknown.scales)), np.zeros(len(x)), normal)


def linearised(unknown: Free, x: Array, problem: Problem) -> Normal:
    """The problem about x (P,) in scales, with one-sided differences that keep within the bounds."""
    here = unknown.within(x * unknown.scales)
    return problem.linearise(unknown.at(here), *moved(unknown, here))


def moved(unknown: Free, here: Array) -> tuple[list[Vehicle], list[float]]:
    """The vehicle with each entry a little off `here` (P,), within the bounds; and by how many scales."""
    vehicles, steps, (_, high) = [], [], unknown.bounds
    for i, entry in enumerate(unknown.entries):
        values = here.copy()
        step = entry.step if values[i] + entry.step <= high[i] else -entry.step
        values[i] += step
        vehicles.append(unknown.at(values))
        steps.append(step / entry.scale)
    return vehicles, steps


def linear_step(normal: Normal, columns: Sequence[int]) -> tuple[float, Array]:
    """Squared residual that some columns explain, and how much of each does, (p,), all others held.

    What the recording does not show, as one of two thrusters that run in step, stays as it is.
    """
    chosen = list(columns)
    known = normal.matrix.sum(axis=0)[np.ix_(chosen, chosen)]
    known += PRIOR**-2 * max(normal.chi2, 1.0) * np.eye(len(chosen))
    score = normal.score.sum(axis=0)[chosen]
    step = np.linalg.solve(known, score)
    return float(score @ step), step


def searched(unknown: Free, values: Array, problem: Problem, narrowest: float = 0.0) -> Array:
    """Values (P,) with each entry that acts in steps at the best place along its own line.

    At every place all else is where the linearised problem would have it.  The search ends at the entry's
    resolution, or at the narrowest distance that is given, in scales.
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
    """Sum of squares of each of `trials` (K, P), the smooth entries moved to their best from trials[0]."""
    smooth = unknown.holding(trials[0], np.array([entry.resolution > 0.0 for entry in unknown.entries]))
    nudged, steps = moved(smooth, smooth.starts[0])
    others = [unknown.at(trial) for trial in trials[1:]]
    gram = problem.linearise(unknown.at(trials[0]), nudged + others, steps + [1.0] * len(others)).gram
    total, count = gram.sum(axis=0), len(nudged)
    if not np.isfinite(total).all():  # a trial's motion diverges: stay, and try nearer
        return np.arange(float(len(trials)))
    # The residual of a trial is the first one's less the column that leads from there to it.
    way = np.vstack([np.zeros((1, len(trials) - 1)), np.eye(len(trials) - 1)])
    pick = np.hstack([np.zeros((len(trials), count)), -way, np.ones((len(trials), 1))])
    squares = np.einsum("ki,ij,kj->k", pick, total, pick)
    scores = pick @ total[:, :count]
    best = np.linalg.solve(total[:count, :count] + np.eye(count) * PRIOR**-2, scores.T)
    cost: Array = squares - np.einsum("ki,ik->k", scores, best)
    return cost


def over_standard_errors(unknown: Free, values: Array, normal: Normal, problem: Problem) -> Normal:
    """The problem about the best values with derivatives over sqrt(26) standard errors where it has corners.

    From wide to narrow; a derivative so narrow that no row of commands lies in it tells less, and ends it.
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
    """Standard errors of all values over what some entries may be, each by itself, (P,).

    A power that the data leave open leaves open what it multiplies, by far more than the slope at the best
    value tells: with another power a drag may stand in for one that is quadratic.  It goes over PROFILE of
    its standard errors, the others are fitted anew, and each place counts as likely as its sum of squares
    leaves it; variances are those there and of what moves from place to place.

    Args:
        unknown: The entries.
        values: Their best values, (P,).
        normal: The problem about them.
        problem: What was fitted.
        errors: Standard errors of the values, (P,).
        entries: Those that go.
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
    """Standard error in scales as costs far from the best value tell it.

    Between two levels of the commands the cost does not rise at all: any value there is as good as another.
    Where few rows of commands lie near the dead band, the cost winds up and down far from the lowest of its
    valleys, and a curvature or slope there means nothing: three standard errors reach at least to the
    farthest place at which the sum of squares is less than 9 above the best.
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
    """Standard errors in scales, (P,)."""
    count = normal.score.shape[1]
    return np.asarray(np.sqrt(np.diag(covariance(normal, np.full(count, PRIOR**-2)))))
