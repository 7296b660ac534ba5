"""Regression of accelerations on thrusts in short windows, with nuisance terms for all other forces.

The momentum balance of a vehicle, integrated over windows of at most one second with a smooth test function
(`prediction.weak_form`), is linear in the thrusts. For each axis a,

    y_a = sum_j c_aj F_j + N_a beta_a + e_a

y is the measured acceleration minus the acceleration of the file without thrusters. F_j is the integrated
thrust of command column j, and c_aj the acceleration per newton of that column. F_j is the part of the thrust
curve F(u) that is odd in the command u. A thruster mounted in reverse gives -F(u), and a thruster with a
negated command gives F(-u). Both have the same odd part, and their even parts differ in sign. So the even
part is a nuisance term.

The nuisance terms N_a have coefficients beta_a with Gaussian priors, whose sizes follow from the mass and the
box of the hull. They cover an unknown force and ballast, restoring moments, a current, damping, and products
of velocities (Coriolis forces, Munk moments, lift). The errors e_a are autoregressive: unmodelled forces
change slowly. Whitening keeps the fast changes, which thrusts cause and slow disturbances do not.

The delay between command and motion is selected by the likelihood with all c_aj free, so its choice is
independent of any hypothesis about the thrusters.

A controller that opposes the motion on an axis makes thrusts that oppose any unknown disturbance there.  The
acceleration is that of the sum of both, so thrusters seem weak, or reversed if the thrusts cancel less than
half of the disturbance.  Accelerations on such an axis are not used.  Where the thrusters were reversed, the
demand by the file would follow the motion instead of opposing it (`recording.feedback`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations, product

import numpy as np
import scipy

from hydro.core.columns import Array, Mask, Rows
from hydro.core.effects.inertia import ADDED_MASS
from hydro.core.effects.layout import CURRENT, INVERSE_MASS_MATRIX
from hydro.core.effects.program import constants_of
from hydro.core.leaky_sum import leaky_sum
from hydro.core.prediction.candidate import Candidate, candidate
from hydro.core.prediction.weak_form import Windows
from hydro.core.recording.arrays import Recording
from hydro.core.recording.feedback import feedback
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST, UNIT_WRENCH, thrusts

AXES = 6
MIXED = tuple(product(range(3), range(3, 6)))
LINEAR, ANGULAR = tuple(combinations(range(3), 2)), tuple(combinations(range(3, 6), 2))
"""Pairs of velocities: linear with angular (MIXED), two linear (LINEAR), two angular (ANGULAR)."""
WINDOW_SECONDS = (1.0, 0.5, 0.25)
"""Candidate window lengths [s]: long enough to average velocity noise, short relative to disturbances."""
LEAST_POWER = 0.8
"""Minimum share of the variance of the thrusts that window integrals keep; otherwise windows shorten."""
MOST_WINDOWS, RUN = 1200, 60
"""Maximum number of windows (ten minutes of motion), and number of consecutive windows kept together."""
LEAST_WINDOWS, LEAST_ROWS = 24, 8
"""Minimum number of windows of a regression, and of sample times in one window."""
LEAK_SECONDS = 20.0
"""Time constant of the leaky integration of rates [s]: several roll and pitch periods of a vehicle."""
IDLE = 0.01
"""Standard deviation of a thrust, relative to the maximum thrust, below which a thruster counts as idle."""
DELAYS = np.arange(-0.1, 0.81, 0.05)
"""Candidate delays from command to motion [s]; negative if the commands were logged late."""
ORDER = 2
"""Order of the autoregression of the errors: a window overlaps the next and touches the one after that."""
ROUNDS = 2
"""Number of alternations between regression and autoregression; more have no visible effect."""
SLOW = 0.98
"""Maximum sum of absolute autoregressive coefficients: few windows cannot whiten a random walk."""
GEOMETRY = 0.15
"""Standard deviation of the errors of the file's lever arms, directions and cross inertias.

It is relative to the root mean square acceleration per newton of the thrusters on an axis, and equals 1 to 2
cm of a lever arm, or 10 degrees.
"""
LEAST_ARM = 0.25
"""Minimum root mean square acceleration per newton on an axis, for axes without thrust in the file.

It is relative to 1/m or (L/2)/I, with the mass m, length L and moment of inertia I.
"""
BALLAST, OFFSET = 0.05, 0.05
"""Prior standard deviations of an unknown weight, relative to the weight, and of an unknown lever arm.

The lever arm of the weight (OFFSET) is relative to the hull's length.
"""
STEADY = 0.2
"""Prior standard deviation of an unknown constant force, relative to the total thrust on the axis."""
FLOW, UNSTEADY = 0.5, 0.1
"""Prior standard deviations of an unknown uniform current, and of other motion of the water [m/s]."""
STILL, FIRST_STEP, LAST_STEP = (0.0, 0.0), 0.16, 0.02
"""Start [m/s, north and east], first step and last step of the search for a current [m/s]."""
HORIZONTAL = (0, 1, 5)
"""Axes used in the search for a current: surge, sway, yaw."""
ROUNDING = 1e-10
"""Share of the largest eigenvalue below which a combination of thrust columns counts as not excited."""
SINGULAR = 1e-6
"""Ratio of the smallest to the largest pivot of a Cholesky factor below which a matrix counts as singular.

Its square is the reciprocal of the condition number, which must stay far above the rounding of 1e-16.
"""
REACH = 10.0
"""Prior standard deviation of a free acceleration per newton, relative to that of the file."""
DRAG = 1.0
"""Prior standard deviation of the error of a drag coefficient of the box's faces."""
CREEP = 0.1
"""Speed added to the recording's root mean square, to give the size of linear damping [m/s, rad/s]."""
CROSS = 0.3
"""Prior standard deviation of damping across axes, relative to the geometric mean of both axes' damping."""
COUPLED = 0.5
"""Prior standard deviation of errors of Coriolis and Munk terms, relative to the displaced mass."""


@dataclass(frozen=True)
class Balance:
    """Sufficient statistics of a regression of accelerations on thrusts, all other forces integrated out.

    They are in units of the noise.  n is the number of thrusters, K that of different thrust curves.

    Attributes:
        gram: Products of the thrust columns with one another, for each axis, (6, K n, K n); column k n + j is
            the thrust that command column j gives through thrust curve k.
        score: Products of the thrust columns with the accelerations, for each axis, (6, K n).
        arms: Acceleration per newton of each thruster on each axis by the file, (6, n).
        kinds: Index of each thruster's thrust curve, (n,).
        shown: Whether the acceleration on each axis was measured and is used, (6,).
        held: Whether it was measured but is not used, because the commands oppose the motion there, (6,).
        inertia: Relative standard errors of the file's inertia about its axes, (6,).
        driven: Indices of the thrusters among the file's actuators, which include servos, (n,).
        idle: Whether each thruster did not run, (n,).
        delay: Delay from command to motion [s].
    """

    gram: Array
    score: Array
    arms: Array
    kinds: Rows
    shown: Mask
    held: Mask
    inertia: Array
    driven: Rows
    idle: Mask
    delay: float


def balance(vehicle: Vehicle, record: Recording, beside: Array | None = None) -> Balance | None:
    """Return the sums of a regression of a recording's accelerations on the thrusts of its command columns.

    Args:
        vehicle: The vehicle, whose file gives the thrusters and all other forces.
        record: The recording.
        beside: Known wrench on the hull in addition to the forces of the file, at every row, (N, 6) [N, N m].

    Returns:
        The sufficient statistics of the regression; None if there are no thrusters, too few windows or no
        measured acceleration.
    """
    driven = np.array([i for i, one in enumerate(vehicle.thruster) if one.pushes], np.int64)
    rows = int(np.diff(record.segments, axis=1).max(initial=0))
    if not driven.size or rows <= max(round(WINDOW_SECONDS[0] / record.dt), LEAST_ROWS):
        return None
    record, model = _tilted(record), candidate(vehicle)
    kinds, forces = _forces(model.thrusters[driven], record, driven)
    windows = _windows(record, forces)
    if len(windows.starts) < LEAST_WINDOWS:
        return None
    inverse = constants_of(model.program.flat)[INVERSE_MASS_MATRIX:][:36].reshape(AXES, AXES)
    table = model.thrusters[driven]
    arms = inverse @ table[:, UNIT_WRENCH].T
    limits = np.maximum(table[:, MAX_THRUST], table[:, MAX_REVERSE])
    terms = _Terms(vehicle, model, windows, inverse, arms, np.abs(arms) @ limits, beside)
    axes = terms.axes(STILL)
    shown = np.array([axis.shown for axis in axes])
    if not shown.any():
        return None
    pushed = [windows.sums(_shifted(forces, windows, delay)) for delay in DELAYS]
    best = _cheapest(axes, pushed)
    axes = [axis.whitened(pushed[best]) for axis in axes]
    best = _cheapest(axes, pushed)
    if shown[:2].all():
        axes = terms.axes(_current(terms, axes, pushed[best]), axes)
        axes = [axis.whitened(pushed[best]) for axis in axes]
        best = _cheapest(axes, pushed)
    count = forces.shape[1] - len(driven)
    gram, score = np.zeros((AXES, count, count)), np.zeros((AXES, count))
    held = shown & feedback(vehicle, record).held
    shown &= ~held
    for i in np.flatnonzero(shown):
        gram[i], score[i] = axes[i].reduced(pushed[best], count)
    own = forces[windows.rows][:, kinds * len(driven) + np.arange(len(driven))]
    idle = np.std(own, axis=0) < IDLE * limits
    delay = float(DELAYS[best])
    inertia = _inertia_errors(vehicle, inverse)
    return Balance(gram, score, arms, kinds, shown, held, inertia, driven, idle, delay)


def _windows(record: Recording, forces: Array) -> Windows:
    """Return the longest windows that keep LEAST_POWER of the thrusts' variance."""
    for seconds in WINDOW_SECONDS:
        windows = Windows.of(record, most=MOST_WINDOWS, seconds=seconds, run=RUN)
        held = np.var(forces[windows.rows], axis=0).sum()
        kept = np.var(windows.sums(forces[windows.rows]) / windows.test.sum(), axis=0).sum()
        if kept >= LEAST_POWER * held:
            break
    return windows


def _inertia_errors(vehicle: Vehicle, inverse: Array) -> Array:
    """Return the standard errors of the file's added mass over the total inertia, (6,); 0 if not given."""
    errors = np.zeros(AXES)
    for table in vehicle.effects(ADDED_MASS.name):
        given = np.asarray(table.get("standard_error", {}).get("diagonal", errors), float)
        errors = np.hypot(errors, given)
    return errors * np.diagonal(inverse)


def _tilted(record: Recording) -> Recording:
    """Return the recording with roll and pitch integrated from the rates if they are not measured.

    The integration leaks, because errors of rates accumulate and a restoring moment returns the vehicle.
    Without an attitude, an unmodelled restoring moment makes thrusters look reversed: below its natural
    frequency, the rate of a vehicle follows the derivative of the moment.
    """
    if record.seen is None:
        return record
    eta = record.eta.copy()
    for start, stop in record.segments:
        rates, seen = record.nu[start:stop, 3:], record.seen[start:stop]
        if not seen[:, 3:5].any() and seen[:, 9:11].any(axis=0).all():
            keep = float(np.exp(-record.dt / LEAK_SECONDS))
            eta[start:stop, 3:5] = leaky_sum(record.dt * rates[:, :2], keep)
    return replace(record, eta=eta)


def _forces(table: Array, record: Recording, driven: Rows) -> tuple[Rows, Array]:
    """Compute the thrust of every command column through every thrust curve.

    Returns:
        The index of each thruster's curve (n,), and thrusts (N, K n + n) [N].  The first K n are the parts
        odd in the command, through each of K curves.  The last n are the even parts, each through its
        thruster's curve.
    """
    curves = table.copy()
    curves[:, UNIT_WRENCH] = 0.0
    distinct, kinds = np.unique(curves, axis=0, return_inverse=True)
    kinds = np.asarray(kinds, np.int64).ravel()
    commands = np.ascontiguousarray(record.commands[:, driven])

    def through(rows: Array, sign: float) -> Array:
        return thrusts(rows, sign * commands, record.t, record.segments, after_gap=record.after_gap)

    alike = [np.ascontiguousarray(np.broadcast_to(row, table.shape)) for row in distinct]
    odd = [0.5 * (through(rows, 1.0) - through(rows, -1.0)) for rows in alike]
    own = np.ascontiguousarray(distinct[kinds])
    return kinds, np.hstack([*odd, 0.5 * (through(own, 1.0) + through(own, -1.0))])


def _cheapest(axes: Sequence[_Axis], pushed: Sequence[Array]) -> int:
    """Return the index of the delay, among integrated thrusts by delay, with the highest likelihood."""
    return int(np.argmin([_cost(axes, each) for each in pushed]))


def _cost(axes: Sequence[_Axis], pushed: Array) -> float:
    """Return minus twice the log likelihood of the axes with measured accelerations."""
    return sum(axis.cost(pushed) for axis in axes if axis.shown)


def _current(terms: _Terms, axes: Sequence[_Axis], pushed: Array) -> tuple[float, float]:
    """Search, from still water, for the most probable current north and east [m/s]."""

    @cache  # a step back leads to a current that was tried
    def cost(current: tuple[float, float]) -> float:
        prior = (current[0] ** 2 + current[1] ** 2) / FLOW**2
        return prior + _cost(terms.axes(current, axes, HORIZONTAL), pushed)

    best, least, step = STILL, cost(STILL), FIRST_STEP
    while step >= LAST_STEP:
        around = [(best[0] + step * x, best[1] + step * y) for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        costs = [cost(each) for each in around]
        k = int(np.argmin(costs))
        if costs[k] < least:
            best, least = around[k], costs[k]
        else:
            step *= 0.5
    return best


def _shifted(forces: Array, windows: Windows, delay: float) -> Array:
    """Return the forces `delay` seconds before the rows of the windows, interpolated, (K, k)."""
    record, rows = windows.record, windows.rows
    segment = np.searchsorted(record.segments[:, 1], rows, side="right")
    first, last = record.segments[segment, 0], record.segments[segment, 1] - 1
    place = np.clip(rows - delay / record.dt, first, last)
    low = np.minimum(place.astype(np.int64), np.maximum(last - 1, first))
    share = (place - low)[:, None]
    return np.asarray((1.0 - share) * forces[low] + share * forces[np.minimum(low + 1, last)])


@dataclass(frozen=True)
class _Axis:
    """Regression of the acceleration on one axis over W windows of a recording.

    Attributes:
        shown: Whether the acceleration of the axis is measured.
        left: Measured acceleration minus that of the file without thrusters, (W,).
        terms: Nuisance terms, each multiplied by its prior standard deviation, (W, p).
        size: Root mean square of the thrusters' accelerations per newton.
        consecutive: Whether each window directly follows the previous window, (W,).
        weights: Weights of the windows by the samples in them, (W,).
        filter: Autoregressive coefficients of the errors, (ORDER,).
        spread: Standard deviation of the whitened errors.
        noise: Autocovariance of the sensor noise over the windows, (ORDER + 1,).
    """

    shown: bool
    left: Array
    terms: Array
    size: float
    consecutive: Mask
    weights: Array
    filter: Array
    spread: float
    noise: Array

    def filtered(self, values: Array) -> Array:
        """Return whitened values: each window minus its autoregressive prediction, in units of the spread.

        Args:
            values: Values in the windows, (W,) or (W, k).
        """
        out, follows = values.copy(), self.consecutive
        for lag, coefficient in enumerate(self.filter, start=1):
            follows = self.consecutive[lag:] & follows[:-1] if lag > 1 else follows[1:]
            out[lag:] -= (coefficient * follows * values[:-lag].T).T
        out /= self.spread
        return out

    @cached_property
    def accelerations(self) -> Array:
        """Whitened accelerations, measured minus those of the file without thrusters, (W,)."""
        return self.filtered(self.left)

    @cached_property
    def nuisance(self) -> Array:
        """Whitened nuisance terms (all forces but the thrusts), (W, p)."""
        return self.filtered(self.terms)

    @cached_property
    def nuisance_products(self) -> Array:
        """Products of the whitened nuisance terms (all forces but the thrusts) with one another, (p, p)."""
        return np.asarray(self.nuisance.T @ self.nuisance)

    def thrust(self, pushed: Array) -> Array:
        """Return integrated thrusts, scaled by the prior standard deviations of their coefficients, (W, k).

        Args:
            pushed: Integrated thrusts, (W, k) [N s].
        """
        return REACH * self.size * pushed * self.weights[:, None]

    def fitted(self, pushed: Array) -> tuple[Array, Array, float]:
        """Fit nuisance terms and all thrusts freely, each scaled by its prior standard deviation.

        Args:
            pushed: Integrated thrusts, (W, k).

        Returns:
            The coefficients (p + k,), the whitened errors (W,), and the effective number of parameters.
        """
        thrust = self.filtered(self.thrust(pushed))
        columns = np.hstack([self.nuisance, thrust])
        count = self.nuisance.shape[1]
        gram = np.empty((columns.shape[1], columns.shape[1]))
        gram[:count, :count] = self.nuisance_products
        gram[:, count:] = columns.T @ thrust
        gram[count:, :count] = gram[:count, count:].T
        inverse = _inverse(gram + np.eye(len(gram)))
        beta = inverse @ (columns.T @ self.accelerations)
        return beta, self.accelerations - columns @ beta, float((inverse * gram).sum())

    def cost(self, pushed: Array) -> float:
        """Return minus twice the log likelihood with every column free and the spread estimated.

        Args:
            pushed: Integrated thrusts, (W, k).
        """
        _, errors, _ = self.fitted(pushed)
        return float(len(errors) * np.log(errors @ errors + 1e-300))

    def whitened(self, pushed: Array) -> _Axis:
        """Return a copy with the autoregression and the spread of the axis's errors, estimated from thrusts.

        Args:
            pushed: Integrated thrusts, (W, k).
        """
        if not self.shown:
            return self
        axis = self
        columns = np.hstack([self.terms, self.thrust(pushed)])
        for _ in range(ROUNDS):
            coefficients, _, freedom = axis.fitted(pushed)
            errors = self.left - columns @ coefficients
            plain = replace(axis, filter=_autoregression(errors, axis.consecutive), spread=1.0)
            squares = float((plain.filtered(errors) ** 2).sum())
            room = max(len(errors) - freedom, 0.1 * len(errors))
            axis = replace(plain, spread=float(np.sqrt(max(squares / room, plain.least_variance, 1e-24))))
        return axis

    @property
    def least_variance(self) -> float:
        """Variance of the whitened sensor noise, a lower bound on that of the errors.

        The estimated errors of a short recording can have a smaller variance.
        """
        taps = np.concatenate([[1.0], -self.filter])
        lags = np.abs(np.subtract.outer(np.arange(len(taps)), np.arange(len(taps))))
        return float(taps @ self.noise[lags] @ taps)

    def reduced(self, pushed: Array, count: int) -> tuple[Array, Array]:
        """Return products of the thrust columns and the accelerations, with nuisance terms integrated out.

        Errors of the geometry, one for each column, are integrated out last, in the eigenvectors of the
        products.  Commands of a mixer are linearly dependent, and rounding must not make the products
        indefinite.

        Args:
            pushed: Integrated thrusts, (W, k): odd parts, then even parts, which are nuisance terms.
            count: Number of odd parts.
        """
        whole = pushed * self.weights[:, None]
        terms = np.hstack([self.nuisance, self.filtered(self.size * whole[:, count:])])
        columns, y, width = self.filtered(whole[:, :count]), self.accelerations, terms.shape[1]
        basis, _ = np.linalg.qr(np.vstack([terms, np.eye(width)]))
        columns = np.vstack([columns, np.zeros((width, columns.shape[1]))])
        columns -= basis @ (basis.T @ columns)
        gram, score = columns.T @ columns, columns.T @ np.concatenate([y, np.zeros(width)])
        sizes, vectors = np.linalg.eigh(gram)
        visible = sizes > ROUNDING * max(float(sizes[-1]), 1e-300)
        sizes, vectors = sizes[visible], vectors[:, visible]
        kept = 1.0 / (1.0 + (GEOMETRY * self.size) ** 2 * sizes)
        return (vectors * (kept * sizes)) @ vectors.T, vectors @ (kept * (vectors.T @ score))


def _inverse(matrix: Array) -> Array:
    """Return the inverse of a symmetric matrix, or the pseudo-inverse of one that is singular in rounding.

    Of noise-free columns the priors vanish in rounding, so that the sum with them may be singular.
    """
    factor, failed = scipy.linalg.lapack.dpotrf(matrix)
    pivots = np.diagonal(factor)
    if failed or pivots.min() < SINGULAR * pivots.max():
        return np.asarray(scipy.linalg.pinvh(matrix))
    upper = np.triu(scipy.linalg.lapack.dpotri(factor)[0])
    return np.asarray(upper + np.triu(upper, 1).T)


def _autoregression(errors: Array, consecutive: Mask) -> Array:
    """Fit autoregressive coefficients of errors over consecutive windows, (ORDER,), bounded by SLOW."""
    both = consecutive & np.roll(consecutive, 1)
    rows = np.flatnonzero(both)
    rows = rows[rows >= ORDER]
    if len(rows) < 4 * ORDER:
        return np.zeros(ORDER)
    past = np.column_stack([errors[rows - lag] for lag in range(1, ORDER + 1)])
    found = np.linalg.lstsq(past, errors[rows], rcond=None)[0]
    size = float(np.abs(found).sum())
    return np.asarray(found * min(1.0, SLOW / max(size, 1e-12)))


@dataclass(frozen=True)
class _Terms:
    """Nuisance terms of all axes, as a function of the current.

    Attributes:
        vehicle: The vehicle.
        model: The compiled vehicle.
        windows: Windows of the recording.
        inverse: Inverse mass matrix, (6, 6).
        arms: Acceleration per newton of each thruster, (6, n).
        authority: Maximum acceleration by all thrusters together, (6,).
        beside: Known wrench on the hull in addition to the forces of the file, (N, 6); None if unknown.
    """

    vehicle: Vehicle
    model: Candidate
    windows: Windows
    inverse: Array
    arms: Array
    authority: Array
    beside: Array | None

    def axes(
        self,
        current: tuple[float, float],
        known: Sequence[_Axis] | None = None,
        wanted: Sequence[int] = tuple(range(AXES)),
    ) -> list[_Axis]:
        """Return the regressions of the accelerations on some axes at a given current.

        Args:
            current: Velocity of the water north and east, in addition to the file's current [m/s].
            known: All axes with whitened errors; by default the errors are assumed to be white.
            wanted: Indices of the axes.
        """
        windows, flat = self.windows, self.model.program.flat.copy()
        constants_of(flat)[CURRENT:][:2] += current
        program = replace(self.model.program, flat=flat)
        model = replace(self.model, program=program)
        drifting = windows.drifting(model)
        if self.beside is not None:
            drifting += self.beside[windows.rows] @ self.inverse.T
        left = self.measured - windows.sums(drifting)
        motion = self._motion(current)
        return [self._axis(i, left[:, i], motion, None if known is None else known[i]) for i in wanted]

    def _axis(self, axis: int, left: Array, motion: _Motion, known: _Axis | None) -> _Axis:
        """Set up the regression of one axis; an unknown mounting position of the DVL is a nuisance too."""
        windows = self.windows
        weights = np.ones(len(left)) if windows.known is None else windows.known[:, axis]
        terms = self._along(axis, motion)
        if axis < 3:
            terms = np.hstack([terms, self.levers[:, :, axis]])
        size = float(np.sqrt(np.mean(self.arms[axis] ** 2)))
        lever = 1.0 if axis < 3 else 0.5 * self.vehicle.hull.length
        size = max(size, LEAST_ARM * lever * self.inverse[axis, axis])
        return _Axis(
            shown=bool((weights > 0.0).any() and np.ptp(left[weights > 0.0]) > 0.0),
            left=left * weights,
            terms=terms * weights[:, None],
            size=size,
            consecutive=windows.consecutive,
            weights=weights,
            filter=np.zeros(ORDER) if known is None else known.filter,
            spread=max(float(np.std(left)), 1e-12) if known is None else known.spread,
            noise=windows.noise(ORDER)[:, axis] * float(np.mean(weights**2)),
        )

    def _motion(self, current: tuple[float, float]) -> _Motion:
        """Integrate the velocities relative to the water, and their products, over the windows.

        Args:
            current: Velocity of the water north and east, in addition to the file's current [m/s].
        """
        windows, (_, turns) = self.windows, self.steady
        nu = windows.nu[windows.rows].copy()
        nu[:, :3] -= np.einsum("kji,j->ki", self.turned[:, :2], current)
        v = nu[:, :3]
        found = windows.sums(np.hstack([v, np.abs(v) * v, _products(nu, MIXED), _products(nu, LINEAR)]))
        return _Motion(
            size=np.sqrt(np.mean(nu**2, axis=0)),
            velocity=np.hstack([found[:, :3], turns[:, :3]]),
            square=np.hstack([found[:, 3:6], turns[:, 3:6]]),
            mixed=found[:, 6 : 6 + len(MIXED)],
            linear=found[:, 6 + len(MIXED) :],
            angular=turns[:, 6:],
        )

    @cached_property
    def steady(self) -> tuple[Array, Array]:
        """Two arrays of integrals over W windows, of signals that do not depend on the current.

        The first has 1 and the rotation from body to NED, row by row, (W, 10); the second the rates, their
        squares with sign, and their products, (W, 9).
        """
        windows = self.windows
        nu = windows.nu[windows.rows]
        R, omega = self.turned.reshape(len(nu), 9), nu[:, 3:]
        found = windows.sums(
            np.hstack([np.ones((len(nu), 1)), R, omega, np.abs(omega) * omega, _products(nu, ANGULAR)])
        )
        return found[:, :10], found[:, 10:]

    @cached_property
    def measured(self) -> Array:
        """Measured accelerations, integrated over the windows, (W, 6)."""
        return self.windows.moved(self.model)

    @cached_property
    def turned(self) -> Array:
        """Rotation from body to NED at the rows of the windows, (K, 3, 3)."""
        return rotation(*self.windows.eta[self.windows.rows, 3:].T)

    @cached_property
    def levers(self) -> Array:
        """Accelerations of a DVL that is half a hull's size ahead, to starboard or below, (W, 3, 3).

        They are integrated over W windows; the second index is the place, the third the body axis.
        """
        hull, windows = self.vehicle.hull, self.windows
        rates = windows.nu[windows.rows, 3:]
        places = 0.5 * np.diag([hull.length, hull.width, hull.height])
        return np.stack([windows.changes(np.cross(rates, place)) for place in places], axis=1)

    def _along(self, axis: int, motion: _Motion) -> Array:
        """Return the integrals of the nuisance accelerations, scaled by their priors, (W, p).

        Args:
            axis: Index of the axis.
            motion: Integrals of the motion relative to the water.
        """
        hull, water = self.vehicle.hull, self.vehicle.environment
        length, width, height = hull.length, hull.width, hull.height
        area = np.array([width * height, length * height, length * width])
        third = np.array([max(width, height) ** 4 * length, length**4 * width, length**4 * height]) / 32.0
        quadratic = 0.5 * DRAG * water.water_density * np.concatenate([area, third])  # wrench per nu^2
        linear = quadratic * (motion.size + CREEP)
        weight = self.vehicle.rigid_body.mass * water.gravity
        displaced = self.vehicle.buoyancy.force / water.gravity
        light, (still, _) = self.inverse[axis, axis], self.steady
        one, down = still[:, :1], still[:, 7:]
        carried = UNSTEADY * still[:, 1:7]  # unknown velocity of the water, north and east, in body axes
        cross = np.full(AXES, CROSS)
        cross[axis] = 1.0
        lever = 1.0 if axis < 3 else OFFSET * length
        found = [
            (STEADY * self.authority[axis] + light * BALLAST * weight * lever) * one,
            light * quadratic[axis] * motion.square[:, [axis]],
            light * cross * np.sqrt(linear[axis] * linear) * motion.velocity,
            light * COUPLED * displaced * (1.0 if axis < 3 else 0.5 * length) * motion.mixed,
        ]
        if axis < 3:
            found.append(light * BALLAST * weight * down[:, [axis]])
            found.append(light * linear[axis] * carried[:, [axis, 3 + axis]])
        else:
            found.append(light * OFFSET * length * weight * down)
            found.append(light * CROSS * 0.5 * length * quadratic[:3] * motion.square[:, :3])
            found.append(light * COUPLED * displaced * motion.linear)
            found.append(COUPLED * motion.angular)
        return np.hstack(found)


@dataclass(frozen=True)
class _Motion:
    """Integrals over W windows of velocities relative to the water, and of their products.

    Attributes:
        size: Root mean square of the velocities, (6,).
        velocity: The velocities, (W, 6).
        square: Their squares with the sign of the velocity, (W, 6).
        mixed: Products of linear and angular velocities, (W, 9).
        linear: Products of two linear velocities, (W, 3).
        angular: Products of two angular velocities, (W, 3).
    """

    size: Array
    velocity: Array
    square: Array
    mixed: Array
    linear: Array
    angular: Array


def _products(nu: Array, pairs: Sequence[tuple[int, int]]) -> Array:
    """Return the products of pairs of velocity components, (K, pairs)."""
    return np.column_stack([nu[:, i] * nu[:, k] for i, k in pairs])
