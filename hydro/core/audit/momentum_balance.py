"""Regression of accelerations on thrusts, in short windows, with nuisance terms for everything else.

The momentum balance of a vehicle, multiplied by a smooth test function and integrated over windows of a
second (`prediction.weak_form`), is linear in the thrusts. For each axis a,

    y_a = sum_j c_aj F_j + N_a beta_a + e_a

y is the acceleration that the file leaves unexplained with all thrusters at rest, F_j the integrated thrust
of command column j, and c_aj the acceleration per newton of that column. F_j is the part of the thrust curve
that is odd in the command. A thruster mounted in reverse gives -F(u) to a command u, and one whose command is
negated gives F(-u); both have the same odd part, and their even parts differ in sign. The even part is
therefore a nuisance term. The nuisance terms N_a have
Gaussian priors whose sizes follow from the mass and the box of the hull: an unknown force and ballast,
restoring moments, a current, damping, and products of velocities (Coriolis forces, Munk moments, lift). The
errors e_a are autoregressive, because what no term explains changes slowly; whitening them leaves the fast
changes, which thrusts cause and slow disturbances do not.

A delay between command and motion is the one that explains the accelerations best with all c_aj free. No
hypothesis about the thrusters enters its choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
import scipy
from scipy.linalg import pinvh

from hydro.core.columns import Array, Mask, Rows
from hydro.core.effects.inertia import ADDED_MASS
from hydro.core.effects.layout import CURRENT, INVERSE_MASS_MATRIX
from hydro.core.effects.program import constants_of
from hydro.core.prediction.candidate import Candidate, candidate
from hydro.core.prediction.weak_form import Windows
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST, UNIT_WRENCH, thrusts

AXES = 6
MIXED = tuple(product(range(3), range(3, 6)))
LINEAR, ANGULAR = tuple(combinations(range(3), 2)), tuple(combinations(range(3, 6), 2))
"""Pairs of velocities: a linear and an angular one, two linear, two angular ones."""
WINDOW_SECONDS = (1.0, 0.5, 0.25)
"""Lengths of a window [s]: long against the noise of a velocity, short against changes of a disturbance."""
LEAST_POWER = 0.8
"""Share of the variance of the thrusts that the integrals over a window keep at least; else it is shorter."""
MOST_WINDOWS, RUN = 1200, 60
"""Largest number of windows (ten minutes of motion), and of consecutive windows kept together."""
LEAST_WINDOWS, LEAST_ROWS = 24, 8
"""Smallest number of windows that a regression uses, and of sample times in one."""
LEAK_SECONDS = 20.0
"""Time constant of the sum of rates [s]: several periods of a vehicle's roll and pitch."""
IDLE = 0.01
"""Standard deviation of a thrust, as a share of the largest, below which a thruster did not run."""
DELAYS = np.arange(-0.1, 0.81, 0.05)
"""Delays from command to motion that are tried [s]; negative where the commands were logged late."""
ORDER = 2
"""Order of the autoregression of the errors: neighbouring windows overlap, the next but one touch."""
ROUNDS = 2
"""Alternations between regression and autoregression; further ones change nothing visible."""
SLOW = 0.98
"""Largest sum of autoregressive coefficients in size: a random walk cannot be whitened with few windows."""
GEOMETRY = 0.15
"""Standard deviation of the errors of the file's lever arms, directions and cross inertias, as a share of the
root mean square of the thrusters' accelerations on an axis; a centimetre or two of a lever arm, or 10
degrees."""
LEAST_ARM = 0.25
"""The same error where the file's thrusters do not push along an axis: a share of 1/m, and of L/2 over I."""
BALLAST, OFFSET = 0.05, 0.05
"""Standard deviation of an unknown weight as a share of the weight, and of an unknown lever arm of the weight
as a share of the hull's length."""
STEADY = 0.2
"""Standard deviation of an unknown constant force as a share of what all thrusters can do on the axis."""
FLOW, UNSTEADY = 0.5, 0.1
"""Standard deviation of an unknown current, and of what the water does besides a uniform one [m/s]."""
STILL, FIRST_STEP, LAST_STEP = (0.0, 0.0), 0.16, 0.02
"""Where the search for a current begins, and its first and last step [m/s]."""
HORIZONTAL = (0, 1, 5)
"""Axes that the search for a current looks at."""
ROUNDING = 1e-10
"""Share of the largest product of thrust columns below which a combination of columns is not excited."""
REACH = 10.0
"""Prior standard deviation of an acceleration per newton with every column free, in units of the file's."""
DRAG = 1.0
"""Standard deviation of the error of a drag coefficient of the box's faces."""
CREEP = 0.1
"""Speed that linear damping counts as quadratic damping at, besides the recording's own [m/s, rad/s]."""
CROSS = 0.3
"""Standard deviation of cross damping as a share of the damping of the two axes."""
COUPLED = 0.5
"""Standard deviation of the errors of Coriolis and Munk terms as a share of the displaced mass."""


@dataclass(frozen=True)
class Balance:
    """Sufficient statistics of the regression, nuisance terms integrated out, in units of the errors.

    Attributes:
        gram: Products of the thrust columns with one another, (6, K n, K n) [1/N^2 of the errors]; column
            k n + j is that of command column j through the thrust curve of kind k.
        score: Their products with the accelerations, (6, K n).
        arms: Acceleration per newton of each thruster by the file, (6, n).
        kinds: Number of each thruster's thrust curve, (n,).
        shown: Which axes the recording shows, (6,).
        inertia: Standard errors of the file's inertia about its axes, as shares of it, (6,).
        driven: Indices of the thrusters among the file's entries, (n,): all but servos.
        idle: Which thrusters did not run, (n,).
        delay: From command to motion [s].
    """

    gram: Array
    score: Array
    arms: Array
    kinds: Rows
    shown: Mask
    inertia: Array
    driven: Rows
    idle: Mask
    delay: float


def balance(vehicle: Vehicle, record: Recording, beside: Array | None = None) -> Balance | None:
    """Regress the accelerations of a recording on the thrusts of its command columns.

    Args:
        vehicle: The vehicle.
        record: The recording.
        beside: Known wrench of the hull besides the file at every row, (N, 6) [N, N m].

    Returns:
        None where there are no thrusters, or the recording has too few windows or shows no acceleration.
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
    for i in np.flatnonzero(shown):
        gram[i], score[i] = axes[i].reduced(pushed[best], count)
    own = forces[windows.rows][:, kinds * len(driven) + np.arange(len(driven))]
    idle = np.std(own, axis=0) < IDLE * limits
    delay = float(DELAYS[best])
    return Balance(gram, score, arms, kinds, shown, _inertia_errors(vehicle, inverse), driven, idle, delay)


def _windows(record: Recording, forces: Array) -> Windows:
    """Windows as long as the changes of the thrusts allow."""
    for seconds in WINDOW_SECONDS:
        windows = Windows.of(record, most=MOST_WINDOWS, seconds=seconds, run=RUN)
        held = np.var(forces[windows.rows], axis=0).sum()
        kept = np.var(windows.sums(forces[windows.rows]) / windows.test.sum(), axis=0).sum()
        if kept >= LEAST_POWER * held:
            break
    return windows


def _inertia_errors(vehicle: Vehicle, inverse: Array) -> Array:
    """Standard errors of the file's added mass, 0 without any, as shares of the whole inertia, (6,)."""
    errors = np.zeros(AXES)
    for table in vehicle.effects(ADDED_MASS.name):
        given = np.asarray(table.get("standard_error", {}).get("diagonal", errors), float)
        errors = np.hypot(errors, given)
    return errors * np.diagonal(inverse)


def _tilted(record: Recording) -> Recording:
    """The recording with an attitude from the rates where none is measured.

    Rates are summed with a leak: their errors add up, and a vehicle with a restoring moment comes back. A
    restoring moment that nobody knows of makes thrusters look reversed: below its natural frequency a vehicle
    turns with the derivative of the moment.
    """
    if record.seen is None:
        return record
    eta = record.eta.copy()
    for start, stop in record.segments:
        rates, seen = record.nu[start:stop, 3:], record.seen[start:stop]
        if not seen[:, 3:5].any() and seen[:, 9:11].any(axis=0).all():
            keep = float(np.exp(-record.dt / LEAK_SECONDS))
            eta[start:stop, 3:5] = scipy.signal.lfilter([record.dt], [1.0, -keep], rates[:, :2], axis=0)
    return replace(record, eta=eta)


def _forces(table: Array, record: Recording, driven: Rows) -> tuple[Rows, Array]:
    """Thrust of every command column through every kind of thrust curve.

    Returns:
        The kind of each thruster (n,), and forces (N, K n + n) [N]: parts that are odd in the command through
        each kind of curve, and then parts that are even, of each column through its own thruster's curve.
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
    """Index of the integrated thrusts that explain the accelerations best."""
    return int(np.argmin([_cost(axes, each) for each in pushed]))


def _cost(axes: Sequence[_Axis], pushed: Array) -> float:
    """Minus twice the logarithm of the likelihood of the axes that are shown."""
    return sum(axis.cost(pushed) for axis in axes if axis.shown)


def _current(terms: _Terms, axes: Sequence[_Axis], pushed: Array) -> tuple[float, float]:
    """Search for the current north and east [m/s] that explains the accelerations best, from still water."""

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
    """Forces at the rows of the windows as they were `delay` seconds before, (K, k)."""
    record, rows = windows.record, windows.rows
    segment = np.searchsorted(record.segments[:, 1], rows, side="right")
    first, last = record.segments[segment, 0], record.segments[segment, 1] - 1
    place = np.clip(rows - delay / record.dt, first, last)
    low = np.minimum(place.astype(np.int64), np.maximum(last - 1, first))
    share = (place - low)[:, None]
    return np.asarray((1.0 - share) * forces[low] + share * forces[np.minimum(low + 1, last)])


@dataclass(frozen=True)
class _Axis:
    """Regression of one axis.

    Attributes:
        shown: Whether the recording shows its acceleration.
        left: Acceleration without thrusters, (W,).
        terms: Nuisance terms, each multiplied by its prior standard deviation, (W, p).
        size: Root mean square of the thrusters' accelerations per newton.
        consecutive: Which windows follow the one before, (W,).
        weights: Of the windows, by what samples show, (W,).
        filter: Autoregressive coefficients of the errors, (ORDER,).
        spread: Standard deviation of the whitened errors.
        noise: Autocovariance of the sensor's noise over the windows, (ORDER + 1,).
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
        """Errors whitened: each window less what those before it foretell, in units of the spread."""
        out, follows = values.copy(), self.consecutive
        for lag, coefficient in enumerate(self.filter, start=1):
            follows = self.consecutive[lag:] & follows[:-1] if lag > 1 else follows[1:]
            out[lag:] -= (coefficient * follows * values[:-lag].T).T
        out /= self.spread
        return out

    def design(self, pushed: Array) -> Array:
        """Regressors (W, p + k), scaled by their priors."""
        return np.hstack([self.terms, REACH * self.size * pushed * self.weights[:, None]])

    def fitted(self, pushed: Array) -> tuple[Array, float]:
        """Errors (W,), not whitened, of the fit with every column free, and the number of free parameters."""
        whole = self.design(pushed)
        y, columns = self.filtered(self.left), self.filtered(whole)
        gram = columns.T @ columns
        inverse = pinvh(gram + np.eye(len(gram)))  # noise-free columns outweigh the priors by all digits
        beta = inverse @ (columns.T @ y)
        freedom = float((inverse * gram).sum())
        return self.left - whole @ beta, freedom

    def cost(self, pushed: Array) -> float:
        """Minus twice the logarithm of the likelihood with every column free, the spread estimated."""
        errors, _ = self.fitted(pushed)
        squares = self.filtered(errors) ** 2
        return float(len(errors) * np.log(squares.sum() + 1e-300))

    def whitened(self, pushed: Array) -> _Axis:
        """Estimate the autoregression and the spread of the errors."""
        axis = self
        if not self.shown:
            return self
        for _ in range(ROUNDS):
            errors, freedom = axis.fitted(pushed)
            plain = replace(axis, filter=_autoregression(errors, axis.consecutive), spread=1.0)
            squares = float((plain.filtered(errors) ** 2).sum())
            room = max(len(errors) - freedom, 0.1 * len(errors))
            axis = replace(plain, spread=float(np.sqrt(max(squares / room, plain.least_variance, 1e-24))))
        return axis

    @property
    def least_variance(self) -> float:
        """Variance of the sensor's noise after the filter; errors of a short recording can look smaller."""
        taps = np.concatenate([[1.0], -self.filter])
        lags = np.abs(np.subtract.outer(np.arange(len(taps)), np.arange(len(taps))))
        return float(taps @ self.noise[lags] @ taps)

    def reduced(self, pushed: Array, count: int) -> tuple[Array, Array]:
        """Products of the thrust columns and the accelerations, nuisance terms integrated out.

        The first `count` columns are odd parts of thrusts, the others even ones, which are nuisance terms.

        Errors of the geometry, one for each column, are integrated out last, in the eigenvectors of the
        products: commands of a mixer are linearly dependent, and rounding must not make the products
        indefinite.
        """
        whole = pushed * self.weights[:, None]
        terms = self.filtered(np.hstack([self.terms, self.size * whole[:, count:]]))
        columns, y, width = self.filtered(whole[:, :count]), self.filtered(self.left), terms.shape[1]
        basis, _ = np.linalg.qr(np.vstack([terms, np.eye(width)]))
        columns = np.vstack([columns, np.zeros((width, columns.shape[1]))])
        columns -= basis @ (basis.T @ columns)
        gram, score = columns.T @ columns, columns.T @ np.concatenate([y, np.zeros(width)])
        sizes, vectors = np.linalg.eigh(gram)
        visible = sizes > ROUNDING * max(float(sizes[-1]), 1e-300)
        sizes, vectors = sizes[visible], vectors[:, visible]
        kept = 1.0 / (1.0 + (GEOMETRY * self.size) ** 2 * sizes)
        return (vectors * (kept * sizes)) @ vectors.T, vectors @ (kept * (vectors.T @ score))


def _autoregression(errors: Array, consecutive: Mask) -> Array:
    """Coefficients by least squares over windows that follow one another, bounded short of a random walk."""
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
    """Nuisance terms of all axes, for any current.

    Attributes:
        vehicle: The vehicle.
        model: The same, compiled.
        windows: Of the recording.
        inverse: Inverse mass matrix, (6, 6).
        arms: Acceleration per newton of each thruster, (6, n).
        authority: Largest acceleration by all thrusters together, (6,).
        beside: Known wrench of the hull besides the file at every row, (N, 6); None where unknown.
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
        """Collect the terms of each axis that is wanted.

        Args:
            current: Velocity of the water north and east, besides the file's [m/s].
            known: All axes with their errors whitened; by default the errors are taken as white.
            wanted: Numbers of the axes.
        """
        windows, flat = self.windows, self.model.program.flat.copy()
        constants_of(flat)[CURRENT:][:2] += current
        program = replace(self.model.program, flat=flat)
        model = replace(self.model, program=program)
        drifting = windows.drifting(model)
        if self.beside is not None:
            drifting += self.beside[windows.rows] @ self.inverse.T
        left = windows.moved(model) - windows.sums(drifting)
        R = rotation(*windows.eta[windows.rows, 3:].T)
        nu = windows.nu[windows.rows].copy()
        nu[:, :3] -= np.einsum("kji,j->ki", R[:, :2], current)
        return [self._axis(i, left[:, i], nu, R, None if known is None else known[i]) for i in wanted]

    def _axis(self, axis: int, left: Array, nu: Array, R: Array, known: _Axis | None) -> _Axis:
        """Collect the terms of one axis, an unknown place of the velocity log among them."""
        windows = self.windows
        weights = np.ones(len(left)) if windows.known is None else windows.known[:, axis]
        terms = windows.sums(self._along(axis, nu, R))
        if axis < 3:
            terms = np.hstack([terms, windows.changes(self._lever(axis, nu))])
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

    def _lever(self, axis: int, nu: Array) -> Array:
        """Velocity that a log half a hull's size ahead, right or below sees besides the body's, (K, 3)."""
        hull = self.vehicle.hull
        places = 0.5 * np.diag([hull.length, hull.width, hull.height])
        return np.cross(nu[:, None, 3:], places)[:, :, axis]

    def _along(self, axis: int, nu: Array, R: Array) -> Array:
        """Nuisance accelerations at the rows of the windows, times their prior deviations, (K, p).

        Args:
            axis: Number of the axis.
            nu: Velocity relative to the water, (K, 6).
            R: Rotation from body to NED, (K, 3, 3).
        """
        hull, water = self.vehicle.hull, self.vehicle.environment
        length, width, height = hull.length, hull.width, hull.height
        area = np.array([width * height, length * height, length * width])
        third = np.array([max(width, height) ** 4 * length, length**4 * width, length**4 * height]) / 32.0
        quadratic = 0.5 * DRAG * water.water_density * np.concatenate([area, third])  # of the wrench
        linear = quadratic * (np.sqrt(np.mean(nu**2, axis=0)) + CREEP)
        weight = self.vehicle.rigid_body.mass * water.gravity
        displaced = self.vehicle.buoyancy.force / water.gravity
        light, down = self.inverse[axis, axis], R[:, 2, :]
        cross = np.full(AXES, CROSS)
        cross[axis] = 1.0
        carried = UNSTEADY * R[:, :2, :]  # an unknown velocity of the water, north and east, in body axes
        lever = 1.0 if axis < 3 else OFFSET * length
        found = [
            np.full((len(nu), 1), STEADY * self.authority[axis] + light * BALLAST * weight * lever),
            light * quadratic[axis] * np.abs(nu[:, [axis]]) * nu[:, [axis]],
            light * cross * np.sqrt(linear[axis] * linear) * nu,
            light * COUPLED * displaced * (1.0 if axis < 3 else 0.5 * length) * _products(nu, MIXED),
        ]
        if axis < 3:
            found.append(light * BALLAST * weight * down[:, [axis]])
            found.append(light * linear[axis] * carried[:, :, axis])
        else:
            found.append(light * OFFSET * length * weight * down)
            found.append(light * CROSS * 0.5 * length * quadratic[:3] * np.abs(nu[:, :3]) * nu[:, :3])
            found.append(light * COUPLED * displaced * _products(nu, LINEAR))
            found.append(COUPLED * _products(nu, ANGULAR))
        return np.hstack(found)


def _products(nu: Array, pairs: Sequence[tuple[int, int]]) -> Array:
    """Products of velocities, (K, pairs)."""
    return np.column_stack([nu[:, i] * nu[:, k] for i, k in pairs])
