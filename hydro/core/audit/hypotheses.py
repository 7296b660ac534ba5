"""Posterior probabilities of assignments of command columns to thrusters, with any signs.

By a hypothesis, column pi(i) drives thruster i with effectiveness g_i, the thrust relative to the file.  The
acceleration of axis a is s_a times that by the file's inertia.  Then c_aj = s_a h_ai g_i with j = pi(i),
where c_aj is the acceleration on axis a per newton of column j, and h are the file's accelerations per newton
(`momentum_balance`). Given its sign sigma_i, g_i has a Gaussian prior with mean sigma_i m and standard
deviation SPREAD m, where m is the scale common to all thrusters. So a thruster without thrust carries no
information on its sign, and a weak thruster carries little. Marginal likelihoods are exact in g; m is summed
over a grid, and s is set to its mode.

A command may accelerate an axis on which its thruster does not push in the file. Causes are a mixer outside
the file, thrusters on the steep part of their curve, or a controller that reacts to a disturbance on two
axes. Such a coupling is modelled as a Gaussian error of one c_aj. Its variance is set to its mode (relevance
determination, Tipping 2001). Thrusters with correlated commands are treated as one, so two thrusters of equal
command that pitch a vehicle may have a coupling in heave.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import product

import numpy as np
import scipy

from hydro.core.audit.momentum_balance import AXES, GEOMETRY, Balance
from hydro.core.audit.wiring import Wiring
from hydro.core.columns import Array, Mask

SPREAD = 0.5
"""Prior standard deviation of an effectiveness, relative to the common scale: intact thrusters vary less."""
FREE = 3.0
"""Prior standard deviation of an effectiveness of unknown sign, for intervals: above that of any thruster."""
SCALES = np.exp(np.linspace(np.log(0.2), np.log(5.0), 21))
"""Grid of common scales, from 0.2 to 5: a wrong thrust curve or voltage stays within this range."""
SCALE_SPREAD = 0.5
"""Prior standard deviation of the logarithm of the common scale: a factor of 1.6 either way."""
INERTIA = 0.3
"""Prior standard deviation of an axis factor: estimated inertia is accurate to about 30 %."""
FACTORS = (0.2, 5.0)
"""Range of an axis factor s_a, the measured over the file's acceleration per newton."""
REVERSED, EXCHANGED = 0.1, 0.1
"""Prior probabilities that a thruster is reversed, and that another pair of columns is exchanged."""
COUPLED = 0.1
"""Prior probability that a command accelerates an axis on which its thruster does not push in the file.

Half or twice this value changes none of 60 audits (20 sound files, 40 with a fault).
"""
ALIKE = 0.9
"""Minimum absolute correlation of two commands at which their thrusters are treated as one.

Neither 0.8 nor 0.95 changes one of the 60 audits of COUPLED.
"""
ENUMERATED = 10
"""Maximum number of thrusters for which all combinations of signs are evaluated: 1,024 combinations."""
ROUNDS = 30
"""Maximum number of alternations between effectivenesses and axis factors."""
WORTH = 12.0
"""Maximum log odds against an order of columns, relative to the best order, for it to enter the posterior."""
MOST_ORDERS = 400
"""Maximum number of column orders that the search evaluates."""


@dataclass(frozen=True)
class Order:
    """One assignment of the command columns to the thrusters, with evidence for all combinations of signs.

    n is the number of thrusters, S that of combinations of signs, M that of the common scales SCALES.

    Attributes:
        column: Index of the column of each thruster, (n,).
        signs: Combinations of the thrusters' signs (1, or -1 if it pushes opposite to the file), (S, n).
        evidence: Unnormalised log posterior of each combination at each of SCALES, (S, M).
        prior: Logarithm of the prior probability of each combination, (S,).
    """

    column: tuple[int, ...]
    signs: Array
    evidence: Array
    prior: Array

    @cached_property
    def best(self) -> float:
        """Logarithm of the unnormalised posterior of this order of columns, summed over signs and scales."""
        return float(_summed(self.evidence.ravel()))


@dataclass(frozen=True)
class Posterior:
    """Posterior probabilities over all evaluated orders of command columns and signs of thrusters.

    Attributes:
        orders: Orders sorted by probability, most probable first.
    """

    orders: tuple[Order, ...]
    _norm: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Compute the normalisation constant."""
        object.__setattr__(self, "_norm", float(_summed(np.array([order.best for order in self.orders]))))

    def wirings(self) -> list[tuple[Wiring, float]]:
        """Return pairs of an assignment of columns with signs, and its probability, most probable first.

        Assignments with a probability below 0.001 are left out.
        """
        found = []
        for order in self.orders:
            chances = np.exp(_summed(order.evidence) - self._norm)
            for i in np.flatnonzero(chances > 1e-3):
                signs = tuple(int(sign) for sign in order.signs[i])
                found.append((Wiring(order.column, signs), float(chances[i])))
        return sorted(found, key=lambda each: -each[1])

    def turned(self, column: tuple[int, ...]) -> Array:
        """Return the probability that each thruster is reversed given an order of the columns, (n,).

        The probabilities are 0 for an order that was not evaluated because it is far less likely than others.

        Args:
            column: Index of the command column of each thruster, from 0, (n,).
        """
        for order in self.orders:
            if order.column == column:
                each = _summed(order.evidence)
                return np.asarray(np.exp(each - _summed(each)) @ (order.signs < 0.0))
        return np.zeros(len(column))

    def scales(self, wiring: Wiring) -> Array:
        """Return the probabilities of the M candidate common scales SCALES, given an assignment, (M,).

        Args:
            wiring: Assignment of columns and signs; its order of columns must have been evaluated.

        Raises:
            ValueError: The order of columns was not evaluated.
        """
        for order in self.orders:
            if order.column == wiring.column:
                row = order.evidence[(order.signs == np.array(wiring.sign)).all(axis=1)][0]
                return np.asarray(np.exp(row - _summed(row)))
        raise ValueError(wiring)


def _summed(logarithms: Array) -> Array:
    """Return log(sum(exp(x))) over the last axis of x."""
    most = logarithms.max(axis=-1, keepdims=True)
    return np.asarray(most[..., 0] + np.log(np.exp(logarithms - most).sum(axis=-1)))


def effectiveness(found: Balance, column: tuple[int, ...]) -> tuple[Array, Array]:
    """Return each thruster's effectiveness, its thrust relative to the file's, for one order of the columns.

    A negative effectiveness means that the thruster pushes opposite to the file.

    Args:
        found: Sufficient statistics of the regression of accelerations on thrusts.
        column: Index of the command column of each thruster, from 0, (n,).

    Returns:
        Effectivenesses, (n,), and their covariance, (n, n).
    """
    gram, score, _ = _Fit.of(found, column).summed()
    covariance = np.asarray(np.linalg.inv(gram + np.eye(len(gram)) / FREE**2), np.float64)
    return covariance @ score, covariance


def posterior(found: Balance) -> Posterior:
    """Return posterior probabilities of orders of command columns and signs, from a local search of orders.

    Args:
        found: Sufficient statistics of the regression of accelerations on thrusts.
    """
    count = found.arms.shape[1]
    tried: dict[tuple[int, ...], Order] = {}
    for start in _starts(found):
        _search(found, start, tried)
    file, most = tuple(range(count)), max(order.best for order in tried.values())
    likely = [order for order in tried.values() if order.best > most - WORTH or order.column == file]
    ranked = sorted((_coupled(found, order) for order in likely), key=lambda order: -order.best)
    return Posterior(tuple(ranked))


def _search(found: Balance, start: tuple[int, ...], tried: dict[tuple[int, ...], Order]) -> None:
    """Exchange pairs of columns, each time that with the largest gain, until none increases the posterior.

    Args:
        found: Sufficient statistics of the regression.
        start: Order to start from.
        tried: Evaluated orders, added to.
    """
    current = _remembered(found, start, tried)
    while len(tried) < MOST_ORDERS:
        nearby = [
            _remembered(found, column, tried)
            for column in Wiring(current.column, (1,) * len(current.column)).exchanges()
        ]
        best = max(nearby, key=lambda order: order.best, default=current)
        if not best.best > current.best:
            return
        current = best


def _remembered(found: Balance, column: tuple[int, ...], tried: dict[tuple[int, ...], Order]) -> Order:
    """Return the evaluation of an order of columns, from `tried` if it is there."""
    if column not in tried:
        tried[column] = _order(found, column)
    return tried[column]


def _starts(found: Balance) -> Iterator[tuple[int, ...]]:
    """Yield orders to start from: the file's, its reverse, and that with the best matching directions."""
    count = found.arms.shape[1]
    yield tuple(range(count))
    yield tuple(reversed(range(count)))
    likeness = np.zeros((count, count))
    for i in range(count):
        own = found.kinds[i] * count + np.arange(count)
        for axis in range(AXES):
            squares = np.maximum(np.diagonal(found.gram[axis])[own], 1e-300)
            likeness[i] += found.arms[axis, i] * found.score[axis, own] / np.sqrt(squares)
    rows, columns = scipy.optimize.linear_sum_assignment(-np.abs(likeness))
    yield tuple(int(columns[i]) for i in np.argsort(rows))


def _order(found: Balance, column: tuple[int, ...]) -> Order:
    """Evaluate all combinations of thruster signs for one order of the columns, without couplings."""
    count, fit = len(column), _Fit.of(found, column)
    whole, slope, _ = fit.summed()
    signs = _signs(whole, slope)
    exchanged = count - _cycles(column)
    prior = (signs < 0).sum(axis=1) * np.log(REVERSED / (1.0 - REVERSED))
    prior += exchanged * np.log(EXCHANGED / max(count * (count - 1) / 2, 1))
    return Order(column, signs, fit.evidence(signs) + prior[:, None], prior)


def _coupled(found: Balance, order: Order) -> Order:
    """Evaluate an order again with couplings, found for the file's signs and for the likeliest signs."""
    plain = _Fit.of(found, order.column)
    likeliest = order.signs[int(order.evidence.max(axis=1).argmax())]
    starts = np.unique([np.ones(len(likeliest)), likeliest], axis=0)
    fits = [plain, *(plain.coupled(signs) for signs in starts)]
    every = np.stack([fit.evidence(order.signs) for fit in fits], axis=-1) + order.prior[:, None, None]
    return replace(order, evidence=_summed(every))


@dataclass(frozen=True)
class _Fit:
    """Regression of all axes for one order of the columns.

    Attributes:
        arms: Acceleration per newton of each thruster in the file, (6, n).
        shown: Axes with measured accelerations, (6,).
        gram: Products of the columns that drive the thrusters, (6, n, n).
        score: Products of these columns with the accelerations, (6, n).
        chance: Log prior and log likelihood of the couplings alone.
    """

    arms: Array
    shown: Mask
    gram: Array
    score: Array
    chance: float = 0.0

    @classmethod
    def of(cls, found: Balance, column: tuple[int, ...]) -> _Fit:
        """Return the regression for an order of the columns, without couplings.

        Args:
            found: Sufficient statistics of the regression of accelerations on thrusts.
            column: Index of the command column of each thruster, from 0, (n,).
        """
        at = found.kinds * len(column) + np.array(column)
        return cls(found.arms, found.shown, found.gram[:, at[:, None], at[None, :]], found.score[:, at])

    @cached_property
    def factors(self) -> Array:
        """Most probable ratio of the measured to the file's acceleration per newton, for each axis, (6,)."""
        gram = self.gram * self.arms[:, :, None] * self.arms[:, None, :]
        return _factors(gram, self.score * self.arms)

    @cached_property
    def apart(self) -> Mask:
        """Whether, by the file, the thrusters with a command do not push an axis, for each pair, (6, n).

        Thrusters with highly correlated commands count as one.  Thrusts within the errors of the file's
        geometry count as none.
        """
        size = np.sqrt(np.maximum(np.diagonal(self.gram, axis1=1, axis2=2), 1e-300))
        alike = self.gram / (size[:, :, None] * size[:, None, :])
        together = np.where(np.abs(alike) >= ALIKE, np.sign(alike), 0.0)
        pushed = np.abs(np.einsum("aij,aj->ai", together, self.arms))
        allowed = GEOMETRY * np.sqrt(np.mean(self.arms**2, axis=1, keepdims=True))
        return np.asarray(pushed <= allowed * np.abs(together).sum(axis=2))

    def summed(self) -> tuple[Array, Array, float]:
        """Return the log posterior of the effectivenesses g, over all axes, as terms of c + s g - g H g / 2.

        Returns:
            Curvature H, (n, n); gradient s at zero, (n,); and constant c.
        """
        pushed = self.factors[:, None] * self.arms
        whole = np.einsum("ai,aij,aj->ij", pushed, self.gram, pushed)
        constant = self.chance - 0.5 * float((((self.factors - 1.0) / INERTIA) ** 2)[self.shown].sum())
        return whole, (pushed * self.score).sum(axis=0), constant

    def evidence(self, signs: Array) -> Array:
        """Return log likelihood plus log prior for each combination of signs and each of SCALES, (S, M).

        Args:
            signs: S combinations of the signs of all thrusters, (S, n).
        """
        whole, slope, constant = self.summed()
        return _evidence(whole, slope, signs) + constant - 0.5 * (np.log(SCALES) / SCALE_SPREAD) ** 2

    def errors(self, signs: Array) -> tuple[Array, Array]:
        """Return slope and curvature of the log likelihood in each acceleration per newton, (6, n) each.

        The effectivenesses are integrated out, so residuals that they explain do not count.

        Args:
            signs: Signs of all thrusters, (n,).
        """
        whole, slope, _ = self.summed()
        scale = SCALES[int(self.evidence(signs[None])[0].argmax())]
        precision = 1.0 / (SPREAD * scale) ** 2
        inverse = np.linalg.inv(whole + precision * np.eye(len(signs)))
        pushed = self.factors[:, None] * self.arms
        answers = pushed[:, :, None] * self.gram
        left = self.score - np.einsum("aij,i->aj", answers, inverse @ (slope + precision * scale * signs))
        explained = np.einsum("aij,ik,akj->aj", answers, inverse, answers)
        return left, np.diagonal(self.gram, axis1=1, axis2=2) - explained

    def coupled(self, signs: Array) -> _Fit:
        """Return a new regression with couplings added while the gain in likelihood exceeds their prior cost.

        A coupling is an acceleration by a command on an axis that its thruster does not push in the file.
        For an error of z standard errors, the best variance of a coupling is z^2 - 1 squared standard
        errors.  The log likelihood then increases by (z^2 - 1 - log z^2) / 2.

        Args:
            signs: Signs of all thrusters, (n,).
        """
        fit, cost, apart = self, float(np.log((1.0 - COUPLED) / COUPLED)), self.apart
        for _ in range(self.score.size):
            left, curved = fit.errors(signs)
            curved = np.where(apart & (curved > 0.0), curved, np.inf)
            squares = np.maximum(left**2 / curved, 1.0)
            axis, i = np.unravel_index(int(squares.argmax()), squares.shape)
            square = float(squares[axis, i])
            if 0.5 * (square - 1.0 - np.log(square)) <= cost:
                break
            fit = fit._loosened(int(axis), int(i), (square - 1.0) / float(curved[axis, i]), cost)
        return fit

    def _loosened(self, axis: int, i: int, variance: float, cost: float) -> _Fit:
        """Return the regression with a coupling of given variance of command `i` on an axis."""
        gram, score = self.gram.copy(), self.score.copy()
        row, own = self.gram[axis, i], self.score[axis, i]
        volume = 1.0 + variance * row[i]
        gram[axis] -= variance / volume * np.outer(row, row)
        score[axis] -= variance / volume * own * row
        gain = 0.5 * float(variance / volume * own**2 - np.log(volume))
        return replace(self, gram=gram, score=score, chance=self.chance + gain - cost)


def _factors(gram: Array, score: Array) -> Array:
    """Fit the most probable factor of each axis, (6,), alternating with the effectivenesses."""
    count = score.shape[1]
    low, high = FACTORS
    flat, free = gram.reshape(AXES, -1), np.eye(count) / FREE**2
    factors = np.ones(AXES)
    for _ in range(ROUNDS):
        whole = (factors**2 @ flat).reshape(count, count) + free
        g = np.linalg.solve(whole, factors @ score)
        curved, slope = gram @ g @ g, score @ g
        updated = np.minimum(np.maximum((slope + INERTIA**-2) / (curved + INERTIA**-2), low), high)
        close = np.abs(updated - factors).max() < 1e-3
        factors = updated
        if close:
            break
    return factors


def _signs(gram: Array, score: Array) -> Array:
    """Return the combinations of thruster signs to evaluate, (S, n).

    All combinations; for more than ENUMERATED thrusters, those near the best fit and near the file.
    """
    count = len(score)
    if count <= ENUMERATED:
        return _every_sign(count)
    fitted = np.linalg.solve(gram + np.eye(count) / FREE**2, score)
    centres = [np.where(fitted < 0.0, -1.0, 1.0), np.ones(count)]
    turned = [np.ones(count)]
    for i in range(count):
        for k in range(i, count):
            one = np.ones(count)
            one[[i, k]] = -1.0
            turned.append(one)
    return np.unique(np.vstack([centre * one for centre in centres for one in turned]), axis=0)


@cache
def _every_sign(count: int) -> Array:
    """Return all combinations of signs of n thrusters, (2^n, n)."""
    return np.array(list(product((1.0, -1.0), repeat=count))).reshape(-1, count)


def _evidence(gram: Array, score: Array, signs: Array) -> Array:
    """Return the log marginal likelihood for each combination of signs and each of SCALES, (S, M)."""
    count, precision = len(score), 1.0 / (SPREAD * SCALES) ** 2
    sizes, vectors = np.linalg.eigh(gram)
    curved = np.maximum(sizes, 0.0)[:, None] + precision
    own, turned = vectors.T @ score, signs @ vectors
    pull = precision * SCALES  # precision times prior mean
    quadratic = own**2 @ (1.0 / curved) + pull * (2.0 * (turned * own) @ (1.0 / curved))
    quadratic += pull**2 * (turned**2 @ (1.0 / curved))
    constant = precision * SCALES**2 * count
    volume = np.log(curved).sum(axis=0) - count * np.log(precision)
    return np.asarray(0.5 * (quadratic - constant - volume))


def _cycles(column: tuple[int, ...]) -> int:
    """Return the number of cycles of a permutation; n minus this number is the number of exchanges."""
    left, found = set(range(len(column))), 0
    while left:
        at = left.pop()
        found += 1
        while column[at] in left:
            at = column[at]
            left.remove(at)
    return found
