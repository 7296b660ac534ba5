"""Tests for errors of the DVL from kinematics alone.

Whatever forces act, d(position)/dt = R v, with the rotation R from body to NED and the body velocity v
(Fossen 2011, sec. 2.2).  So pose and logged velocity show each error of the DVL (`core.effects.sensor`)
without a model of the dynamics, and a current or missing force cannot be mistaken for a DVL error.  The test
compares the position with the integral of R v.  Both pass a high-pass filter that whitens the noise of
position and velocity together: the Kalman filter of a noisy position with drifting dead reckoning.  Noisy
data are never differentiated.  Residuals beyond the noise count as noise of the position, so fixes that are
rarer than rows have a smaller weight.

The thirteen parameters of DVL errors are fitted at once: scale (3), mounting angles (3), delay, lever arm (3)
and bias (3).  So each effect is tested given all other effects.  Where a recording cannot separate two
effects, neither is shown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE
from hydro.core.effects.sensor import ANGLES, BIAS, DELAY, LEVER, LOG, SCALE
from hydro.core.errors import DataError
from hydro.core.leaky_sum import leaky_sum
from hydro.core.prediction.normal_equations import Normal, block_length, covariance
from hydro.core.recording.arrays import Recording, noise
from hydro.core.vehicle.frames import rotation

ENTRIES = {
    name: (effect.kinematics.parameter, effect.kinematics.place)
    for name, effect in CATALOGUE.items()
    if effect.kinematics is not None
}
"""Parameter of each DVL error by effect name, and its indices in the vector of DVL parameters (LOG,)."""

SHOWN = 1e-3
"""Maximum p-value at which an effect counts as shown."""
VETO = 1e-4
"""Maximum p-value at which the test refutes values claimed by another method."""
SEEN = 0.9
"""Probability with which the test shows an error as large as `KinematicTest.visible`."""

HORIZON = (0.25, 20.0)  # s, bounds of the time constant of the high-pass
PIECE_SECONDS = 2.0  # s, length of a block of the normal equations
BOX = 0.1  # s, half-width of the average of an acceleration
PLAIN_SIZE = 0.5  # prior standard deviation of every parameter, in its unit
LATEST = 2.0  # s, maximum delay
CAUTION = 0.9  # share of the common noise that is subtracted
LEAST_PIECES = 8  # minimum number of pieces of PIECE_SECONDS in a recording
ITERATIONS = 8  # maximum number of Gauss-Newton steps
REWEIGHTED = 4  # maximum number of updates of the noise of the position
RARE = 3.0  # ratio to the row-to-row noise above which a position was interpolated or held between fixes
ROUGH = 10.0  # factor on the negligible size of an error if positions are interpolated or held
OTHERWISE = 1.1  # ratio of residual to noise above which the noise of the position is updated
SETTLED = 0.01  # standard errors, convergence limit of a step
HELD = 1e15  # prior information of a held component


@dataclass(frozen=True)
class KinematicTest:
    """Kinematic test of one error of the DVL: measured pose against velocity, all other errors given.

    Attributes:
        effect: Name of the error in the catalogue of effects, for example `sensor_delay`.
        estimate: Estimated values of the effect's p components, (p,), in packing order (`Effect.pack`).
        covariance: Covariance of the estimate, (p, p), robust against correlated residuals.
        blocks: Number of independent blocks of data.
        negligible: Size of a component below which it needs no correction, in the component's unit.
        missed: Increase of the squared residual if the effect is left out and all other errors are refitted,
            in units of the reduced chi-square; computed only if the estimate is otherwise significant, else
            infinite.
    """

    effect: str
    estimate: Array
    covariance: Array
    blocks: int
    negligible: float
    missed: float = np.inf

    @property
    def standard_error(self) -> Array:
        """Standard error of each component, (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def visible(self) -> Array:
        """Size at which each component alone would be found significant with a probability of SEEN, (p,)."""
        size: Array = (scipy.special.ndtri(SEEN) - scipy.special.ndtri(0.5 * SHOWN)) * self.standard_error
        return np.maximum(size, self.negligible)

    @property
    def table(self) -> dict[str, Any]:
        """The estimate as a dict, as in an `[[effect]]` table of a vehicle file: `name` and one parameter."""
        name = ENTRIES[self.effect][0]
        number = CATALOGUE[self.effect].parameter(name).shape == ()
        value = float(self.estimate[0]) if number else self.estimate.tolist()
        return {"name": self.effect, name: value}

    @property
    def errors(self) -> dict[str, Any]:
        """Standard errors by parameter name, in the shape of the values in `table`."""
        name = ENTRIES[self.effect][0]
        number = CATALOGUE[self.effect].parameter(name).shape == ()
        return {name: float(self.standard_error[0]) if number else self.standard_error.tolist()}

    @property
    def p_value(self) -> float:
        """p-value of the estimate if the DVL has no such error."""
        return self.chance(np.zeros_like(self.estimate))

    def distance(self, claimed: Array) -> float:
        """Return the squared Mahalanobis distance of the estimate from claimed values.

        Args:
            claimed: Claimed values of the p components, (p,).
        """
        away = self.estimate - claimed
        return float(away @ np.linalg.solve(self.covariance, away))

    def chance(self, claimed: Array) -> float:
        """Return the p-value of the estimate if claimed values are true, by an F test.

        Args:
            claimed: Claimed values of the p components, (p,).
        """
        entries = len(self.estimate)
        return float(
            scipy.special.fdtrc(entries, max(self.blocks - entries, 1), self.distance(claimed) / entries)
        )


def shown(test: KinematicTest) -> bool:
    """Return whether a test shows a DVL error: significant, not negligible, and needed by the fit."""
    size, error = test.estimate, test.standard_error
    if (size < CATALOGUE[test.effect].parameter(ENTRIES[test.effect][0]).low).any():
        return False  # impossible for a DVL: the pose is late, not the DVL
    clear = np.abs(size) > test.negligible - scipy.special.ndtri(0.5 * SHOWN) * error
    return test.p_value <= SHOWN and bool(clear.any()) and _missed(test)


def _missed(test: KinematicTest) -> bool:
    """Return whether the fit without the effect is significantly worse.

    For motion along one line, scales and angles can replace one another.  The estimate is then large and its
    linearised errors are small, but the fit without the effect is equally good.
    """
    return float(scipy.special.chdtrc(len(test.estimate), test.missed)) <= SHOWN


def vetoed(test: KinematicTest, claimed: Mapping[str, Any]) -> bool:
    """Return whether kinematics contradicts the values of a DVL error that a model of the dynamics claims.

    Args:
        test: Kinematic test of the effect.
        claimed: `[[effect]]` table with the claimed values.

    Returns:
        True if the test refutes the claimed values and the estimate is nearer to zero error than to these
        values. False also if the recording could not have shown an error of that size.

    Raises:
        DataError: The table does not belong to this effect.
    """
    given = {key: value for key, value in claimed.items() if key != "standard_error"}
    values = CATALOGUE[test.effect].pack(given, thrusters=0)
    values = np.broadcast_to(values, test.estimate.shape)
    nearer_none = test.distance(np.zeros_like(values)) < test.distance(values)
    return nearer_none and test.chance(values) <= VETO


def kinematic_tests(record: Recording) -> dict[str, KinematicTest]:
    """Return a test of each error of the DVL, which compares measured pose and velocity.

    Args:
        record: The recording.

    Returns:
        One test for each DVL error, by effect name.  A position without samples was computed from the
        velocity, so it shows nothing; depth alone shows the errors of all axes if the vehicle tilts.  Empty
        without samples of any position, or of a channel of attitude or velocity.

    Raises:
        DataError: The recording has fewer than eight stretches of two seconds without a gap.
    """
    if not _axes(record).any() or not _sampled(record)[3:9].all():
        return {}
    given, log = noise(record), np.zeros(LOG)
    sigma = given.copy()
    for _ in range(REWEIGHTED + 1):
        log, spread, normal = _fitted(record, log, sigma)
        left = np.sqrt(normal.channels.sum(axis=0) / (normal.residuals / _axes(record).sum()))
        if (left < OTHERWISE).all():
            break
        # A position with fixes rarer than rows has larger errors than its row-to-row noise.
        sigma[:3] *= np.maximum(left, 1.0)
    blocks = len(normal.gram) // block_length(normal.score)
    rough = ROUGH if (sigma[:3] > RARE * given[:3]).any() else 1.0
    tests = {}
    for name, (_, place) in ENTRIES.items():
        negligible = rough * _negligible(name, record.dt)
        test = KinematicTest(name, log[place], spread[place, place], blocks, negligible)
        if shown(test):
            without = _fitted(record, log, sigma, place)[2]
            test = replace(test, missed=(_squares(without) - _squares(normal)) / max(normal.chi2, 1.0))
        tests[name] = test
    return tests


def _sampled(record: Recording) -> NDArray[np.bool_]:
    """Return which of the twelve channels of pose and velocity have samples, (12,)."""
    return np.ones(12, np.bool_) if record.seen is None else np.asarray(record.seen.any(axis=0))


def _axes(record: Recording) -> NDArray[np.bool_]:
    """Return which coordinates of the position were measured, (3,): underwater often depth alone."""
    return _sampled(record)[:3]


def _squares(normal: Normal) -> float:
    """Return the sum of the squared residuals of a problem."""
    return float(normal.channels.sum())


def _negligible(effect: str, dt: float) -> float:
    """Return the negligible size of an error; half the sample time `dt` [s] for a delay."""
    kinematics = CATALOGUE[effect].kinematics
    size = kinematics.negligible if kinematics is not None else None
    return 0.5 * dt if size is None else size


def _fitted(
    record: Recording, log: Array, sigma: Array, without: slice | int | None = None
) -> tuple[Array, Array, Normal]:
    """Fit the DVL parameters by Gauss-Newton; return them (LOG,), their covariance and the last problem.

    Args:
        record: The recording.
        log: Initial values of the DVL parameters, (LOG,).
        sigma: Noise of all channels, (12,).
        without: Indices of parameters to hold at 0.
    """
    prior = np.full(LOG, PLAIN_SIZE**-2)
    if without is not None:
        log = log.copy()
        log[without], prior[without] = 0.0, HELD
    for _ in range(ITERATIONS):
        normal, biased = _problem(record, log, sigma)
        pull = normal.score.sum(axis=0) - prior * log
        step = np.linalg.solve(normal.matrix.sum(axis=0) + np.diag(prior), pull)
        spread = covariance(normal, prior) + np.diag(biased**2)
        log = log + step
        log[SCALE] = np.clip(log[SCALE], -0.9, None)
        log[DELAY] = np.clip(log[DELAY], -LATEST, LATEST)
        if (np.abs(step) < SETTLED * np.sqrt(np.diag(spread))).all():
            break
    return log, spread, normal


def _problem(record: Recording, log: Array, sigma: Array) -> tuple[Normal, Array]:
    """Linearise at the DVL parameters `log`; return the problem, and the possible bias from noise, (LOG,).

    The columns and the residual share the noise of the velocity.  Its contribution to their products is known
    and is subtracted (Fuller 1987, sec. 2.5).  The products must stay positive for an axis without motion,
    and also if any one block of pieces is left out, since a jackknife over the blocks would otherwise be
    unbounded. The remaining contribution biases a scale or an angle by its share of the products: an axis
    that hardly moves seems many times too large.
    """
    pieces = list(_pieces(record, log, sigma))
    if sum(len(gram) for gram, _, _ in pieces) < LEAST_PIECES:
        raise DataError(
            f"the recording has fewer than {LEAST_PIECES} stretches of {PIECE_SECONDS:g} s without a gap to "
            f"hold velocity against pose; record at least {LEAST_PIECES * PIECE_SECONDS:g} s"
        )
    gram, shared, squares = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    rows = int(_axes(record).sum()) * round(PIECE_SECONDS / record.dt)

    def less(share: float) -> Normal:
        """Return the problem with a share of the noise contribution subtracted."""
        return Normal(gram - share * shared, rows, squares, np.zeros((len(gram), 0, LOG + 1)))

    share = _spare(gram.sum(axis=0), shared.sum(axis=0))
    edges = np.arange(0, len(gram), block_length(less(CAUTION * share).score))
    left_out = (part.sum(axis=0) - np.add.reduceat(part, edges) for part in (gram, shared))
    share = CAUTION * min(share, *map(_spare, *left_out))
    noisy, whole = (np.diagonal(part.sum(axis=0))[:LOG] for part in (shared, gram))
    noise = (1.0 - share) * noisy
    least = np.maximum(noise / PLAIN_SIZE, np.finfo(float).tiny)  # an axis without motion has no information
    return less(share), noise / np.maximum(whole - share * noisy, least)


def _spare(gram: Array, shared: Array) -> float:
    """Return the largest share of the noise contribution that can be subtracted from the products, at most 1.

    With a larger share, the information on a scale or an angle given the other parameters would be negative.

    Args:
        gram: Products of the columns and the residual, (LOG + 1, LOG + 1).
        shared: Contribution of the velocity's noise to them.
    """
    mount = np.arange(SCALE.start, ANGLES.stop)
    others = np.setdiff1d(np.arange(LOG), mount)
    known = gram[np.ix_(others, others)] + PLAIN_SIZE**-2 * np.eye(len(others))
    both = gram[np.ix_(others, mount)]
    told = gram[np.ix_(mount, mount)] - both.T @ np.linalg.solve(known, both)
    least = scipy.linalg.eigh(told, shared[np.ix_(mount, mount)], eigvals_only=True)[0]
    return float(np.clip(least, 0.0, 1.0))


def _pieces(record: Recording, log: Array, sigma: Array) -> Iterator[tuple[Array, Array, Array]]:
    """Yield, for each segment, the products of columns and residual in pieces of two seconds.

    The high-pass starts from the first position of a segment, whose error decays with its time constant.
    This error is free: where fixes are rare and the time constant is long, it would act on many pieces.

    Yields:
        Gram matrices (pieces, LOG + 1, LOG + 1), the contribution of the velocity's noise to them, and the
        sums of squared residuals by axis, (pieces, 3).
    """
    dt, mount, turned = record.dt, _mount(log), _mount_derivatives(log)
    wander = np.sqrt((sigma[6:9] ** 2).mean())
    horizon = np.clip(sigma[:3] / wander, *HORIZON)
    keep = np.exp(-dt / horizon)
    # Variance of the filtered noise: of the position, and of the velocity summed up by trapezoids.
    summed = 0.5 * dt**2 / (1.0 - keep)
    weight = 1.0 / np.sqrt(sigma[:3] ** 2 * 2.0 / (1.0 + keep) + wander**2 * summed)
    weight[~_axes(record)] = 0.0
    noisy = np.concatenate([turned, -mount[None]])
    shared = np.einsum("jab,b,kcb->jkac", noisy, sigma[6:9] ** 2, noisy)
    shared[-1, -1] = 0.0
    length, late = max(round(PIECE_SECONDS / dt), 4), round((abs(log[DELAY]) + BOX) / dt)
    for start, stop in record.segments:
        count = (stop - start - 2 * late) // length
        if count < 1:
            continue
        eta, nu = record.eta[start:stop], record.nu[start:stop]
        R = rotation(*eta[:, 3:].T)
        velocity, columns = _reading(log, mount, turned, nu, record.t[start:stop])
        moved = np.concatenate([columns, velocity[None]])
        along = (R @ moved.transpose(1, 2, 0)).transpose(1, 0, 2)  # (3, rows, LOG + 1)
        both = np.empty_like(along)
        for i in range(3):
            ahead = 0.5 * dt * along[i]
            ahead[1:] += 0.5 * dt * along[i, :-1]
            both[i] = weight[i] * leaky_sum(ahead, keep[i])
            placed = leaky_sum(np.diff(eta[:, [i]], axis=0, prepend=eta[:1, [i]]), keep[i])[:, 0]
            both[i, :, -1] = weight[i] * placed - both[i, :, -1]
        both = both[:, late : late + count * length]
        for i in range(3):  # free error of the first position
            decay = keep[i] ** np.arange(count * length)
            both[i] -= np.outer(decay, decay @ both[i]) / (decay @ decay)
        cut = both.reshape(3, count, length, LOG + 1)
        gram = np.einsum("ipka,ipkb->pab", cut, cut, optimize=True)
        turns = R[late : late + count * length].reshape(count, length, 3, 3)
        trace = np.einsum("i,pkia,pkic->pac", weight**2 * summed, turns, turns, optimize=True)
        yield (
            gram,
            np.einsum("pac,jkac->pjk", trace, shared, optimize=True),
            (cut[..., -1] ** 2).sum(axis=2).T,
        )


def _mount(log: Array) -> Array:
    """Return the matrix (3, 3) from the DVL's unbiased output to the velocity at the DVL, body axes."""
    matrix: Array = rotation(*log[ANGLES]) / (1.0 + log[SCALE])
    return matrix


def _mount_derivatives(log: Array) -> Array:
    """Return the derivatives of `_mount` by all parameters of the DVL, (LOG, 3, 3)."""
    little, out = 1e-5, np.zeros((LOG, 3, 3))
    for i in [*range(LOG)[SCALE], *range(LOG)[ANGLES]]:
        shift = little * np.eye(LOG)[i]
        out[i] = (_mount(log + shift) - _mount(log - shift)) / (2.0 * little)
    return out


def _reading(log: Array, mount: Array, turned: Array, nu: Array, t: Array) -> tuple[Array, Array]:
    """Return the velocity of CO from the DVL output, (N, 3), and its parameter derivatives, (LOG, N, 3).

    Args:
        log: DVL parameters, (LOG,).
        mount: Matrix of `_mount`.
        turned: Derivatives of `_mount_derivatives`.
        nu: Logged velocity, (N, 6).
        t: Times [s], (N,).
    """
    path = scipy.interpolate.CubicSpline(t, nu[:, :3])
    now, before, after = (path(np.clip(t + log[DELAY] + shift, t[0], t[-1])) for shift in (0.0, -BOX, BOX))
    now -= log[BIAS]
    columns = now @ turned.transpose(0, 2, 1)
    columns[DELAY] = (after - before) @ mount.T / (2.0 * BOX)
    columns[LEVER] = -np.cross(nu[:, 3:], np.eye(3)[:, None])
    columns[BIAS] = -mount.T[:, None]
    return now @ mount.T - np.cross(nu[:, 3:], log[LEVER]), columns
