"""Smoothing of measured velocity: a constant-acceleration Kalman filter per axis.

The state of each axis is (nu_i, nu_dot_i), driven by white jerk of spectral density q [m^2/s^5, rad^2/s^5];
nu_i is measured with variance R.  The gains depend on one dimensionless number, the ratio q dt^3 / R: far
below 1 the filter averages over many rows; far above 1 it follows every row, and the smoother becomes the
natural cubic spline through the data.

The gains of the filter and of the Rauch-Tung-Striebel smoother equal those of `filterpy`, in units of sqrt(R)
and dt.  They are computed here because that package loads all of `scipy.stats`, which takes a third of a
second of every start of a command.  The gains depend only on the number of rows since the start of the
segment, and converge; so compiled code applies them.  A segment starts at its first measurement with an
unknown acceleration.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array, Rows
from hydro.core.compiled import copy_kernel, jit, kernel
from hydro.core.errors import DataError

Method = Literal["rts", "kalman", "kalman-difference"]
METHODS: tuple[str, ...] = ("rts", "kalman", "kalman-difference")

DIFFUSE = 1e6  # variance of the unknown first acceleration [R / dt^2], times the ratio where that is above 1
SETTLED_GAIN = 1e-13  # relative change at which a gain has converged
MOST_ROWS = 5000  # maximum rows for a gain to converge
RATIOS = 10.0 ** np.arange(-8.0, 6.01, 0.25)  # a step changes the filter's bandwidth by 15 %
WINDOW, WINDOWS = 256, 64  # rows and number of the windows used to estimate the ratio
UNINFORMED = 2  # innovations at the start of a window that only determine the first acceleration
NEGLIGIBLE_WEIGHT = 1e-3  # share of the largest weight below which a weight is negligible


@dataclasses.dataclass(frozen=True)
class Design:
    """Settings of the Kalman filter for one vehicle's velocity measurements.

    The filter assumes white jerk of spectral density q and white noise of variance R.

    Attributes:
        dt: Sample time [s].
        ratio: Ratio q dt^3 / R of each axis, shape (6,), dimensionless.  A large ratio means little
            smoothing.
        noise: Standard deviation sqrt(R) of a measurement on each axis, shape (6,) [m/s, rad/s].  The gains
            do not depend on it.
    """

    dt: float
    ratio: tuple[float, ...]
    noise: tuple[float, ...]

    def at(self, dt: float) -> Design:
        """Return a copy of the design with the same noise and jerk at a sample time of `dt` [s]."""
        return dataclasses.replace(self, dt=dt, ratio=tuple(r * (dt / self.dt) ** 3 for r in self.ratio))

    def following(self, times: float) -> Design:
        """Return a copy of the design with the jerk density q multiplied by `times`, so that it smooths less.

        The noise stays the same.  The ratio q dt^3 / R is raised at most to the largest of RATIOS.
        """
        most = float(RATIOS[-1])
        return dataclasses.replace(self, ratio=tuple(max(r, min(r * times, most)) for r in self.ratio))

    @property
    def jerk(self) -> tuple[float, ...]:
        """Spectral density q of the white jerk of each axis, shape (6,) [m^2/s^5, rad^2/s^5]."""
        return tuple(r * s**2 / self.dt**3 for r, s in zip(self.ratio, self.noise, strict=True))


class Gains(NamedTuple):
    """Gains of filter and smoother in each of n rows since the start of a segment.

    Later rows use the last ones.

    Attributes:
        forward: Gains of (nu, nu_dot) from the innovation, (n, 6, 2); the second in 1/s.
        backward: Gain of the smoother, a 2 x 2 matrix row by row, (n, 6, 4), in SI units.
    """

    forward: Array
    backward: Array


def gains(design: Design) -> Gains:
    """Return the gains of the filter and the smoother of every axis, up to the row where they converge."""
    designed = {ratio: _unit_gains(ratio) for ratio in set(design.ratio)}
    axes = [designed[ratio] for ratio in design.ratio]
    rows = max(len(forward) for forward, _ in axes)
    forward = np.stack([_hold_last(f, rows) for f, _ in axes], axis=1)
    backward = np.stack([_hold_last(b, rows) for _, b in axes], axis=1)
    dt = design.dt
    return Gains(forward * [1.0, 1.0 / dt], backward * [1.0, dt, 1.0 / dt, 1.0])


@functools.lru_cache(maxsize=len(RATIOS))  # designs are recomputed at each use, but their ratios are few
def _unit_gains(ratio: float) -> tuple[Array, Array]:
    """Return forward (n, 2) and backward (n, 4) gains for R = 1 and dt = 1.

    The model is F = [[1, 1], [0, 1]] with white jerk, Q = ratio [[1/3, 1/2], [1/2, 1]].
    """
    forward, backward = [(1.0, 0.0)], list[tuple[float, ...]]()
    p, q, r = 1.0, 0.0, DIFFUSE * max(1.0, ratio)  # covariance P = [[p, q], [q, r]] of (nu, nu_dot)
    while True:
        # predicted covariance [[a, b], [b, c]] = F P F^T + Q; no digits cancel in this sum, its determinant
        a, b, c = p + 2.0 * q + r + ratio / 3.0, q + r + 0.5 * ratio, r + ratio
        area = (p * r - q * q) + ratio**2 / 12.0 + ratio * (p + q + r / 3.0)
        # gain of the smoother: P F^T = [[p + q, q], [q + r, r]] times the inverse of the predicted covariance
        rows = ((p + q) / area, q / area), ((q + r) / area, r / area)
        backward.append(tuple(one for x, y in rows for one in (x * c - y * b, y * a - x * b)))
        if len(forward) == MOST_ROWS or (len(forward) > 1 and _settled(forward[-2], forward[-1])):
            return np.array(forward), np.array(backward)
        # gain of the filter, and the corrected covariance in Joseph's form
        k, m = a / (a + 1.0), b / (a + 1.0)
        forward.append((k, m))
        p, q = (1.0 - k) ** 2 * a + k * k, (1.0 - k) * (b - m * a) + k * m
        r = c - 2.0 * m * b + m * m * (a + 1.0)


def _settled(before: tuple[float, ...], now: tuple[float, ...]) -> bool:
    """Return whether no gain changes any more."""
    return all(abs(b - a) <= SETTLED_GAIN * abs(b) for a, b in zip(before, now, strict=True))


def _hold_last(values: Array, rows: int) -> Array:
    return np.concatenate([values, np.repeat(values[-1:], rows - len(values), axis=0)])


@kernel
def _step(state: Array, z: float, gain: Array, dt: float) -> float:
    """Predict and correct one axis, (nu, nu_dot) in place; return the innovation."""
    predicted = state[0] + dt * state[1]
    innovation: float = z - predicted
    state[0] = predicted + gain[0] * innovation
    state[1] += gain[1] * innovation
    return innovation


@kernel
def filter_axis(row: int, state: Array, z: float, gain: Array, dt: float) -> None:
    """Advance the Kalman filter of one axis by one sample; the first sample initialises the filter.

    Args:
        row: Samples since the start of the segment; 0 for the first.
        state: (nu, nu_dot) of the axis, changed in place, (2,).
        z: Measured velocity [m/s or rad/s].
        gain: Gains of (nu, nu_dot) from the innovation at this row, (2,).
        dt: Time since the last sample [s].
    """
    if row == 0:
        state[0], state[1] = z, 0.0
    else:
        _step(state, z, gain, dt)


@kernel
def filter_step(row: int, state: Array, z: Array, forward: Array, dt: float) -> None:
    """Advance the Kalman filters of all six axes by one sample; the first sample initialises the filters.

    Args:
        row: Samples since the start of the segment; 0 for the first.
        state: nu and nu_dot of each axis, changed in place, shape (6, 2) [m/s, rad/s; m/s^2, rad/s^2].
        z: Measured velocity, shape (6,) [m/s, rad/s].
        forward: Gains by row since the start, shape (n, 6, 2) [-, 1/s]; see `Gains`.
        dt: Time since the last sample [s].
    """
    gain = forward[min(row, forward.shape[0] - 1)]
    for i in range(6):
        filter_axis(row, state[i], z[i], gain[i], dt)


@jit
def _filter_segment(z: Array, forward: Array, dt: float, out: Array) -> None:
    """Write filtered (nu, nu_dot) of one segment to `out` (N, 6, 2)."""
    for k in range(z.shape[0]):
        for i in range(6):
            copy_kernel(out[max(k - 1, 0), i], out[k, i])
        filter_step(k, out[k], z[k], forward, dt)


@jit
def _smooth_segment(backward: Array, dt: float, out: Array) -> None:
    """Rauch-Tung-Striebel pass, in place, over the filtered states `out` (N, 6, 2) of one segment."""
    settled = backward.shape[0] - 1
    for i in range(6):
        for k in range(out.shape[0] - 2, -1, -1):
            row = min(k, settled)
            nu, dot = out[k, i, 0], out[k, i, 1]
            nu_ahead = out[k + 1, i, 0] - nu - dt * dot
            dot_ahead = out[k + 1, i, 1] - dot
            out[k, i, 0] = nu + backward[row, i, 0] * nu_ahead + backward[row, i, 1] * dot_ahead
            out[k, i, 1] = dot + backward[row, i, 2] * nu_ahead + backward[row, i, 3] * dot_ahead


@jit
def _difference_segment(dt: float, out: Array) -> None:
    """Replace nu_dot by the difference of nu: central, one-sided in the first and last row of the segment."""
    last = out.shape[0] - 1
    for k in range(last + 1):
        before, after = max(k - 1, 0), min(k + 1, last)
        for i in range(6):
            out[k, i, 1] = (out[after, i, 0] - out[before, i, 0]) / ((after - before) * dt)


def smooth(
    velocity: ArrayLike, bounds: ArrayLike, design: Design, method: str = "rts", designed: Gains | None = None
) -> Array:
    """Return smoothed velocity and acceleration of every row, both at the row's own time t_k.

    Args:
        velocity: Measured nu of CO in body axes, shape (N, 6) [m/s, rad/s].
        bounds: Segments [start, stop), shape (S, 2), that cover all rows; the filter restarts in each.
        design: Settings of the filter.
        method: `rts`: two-sided smoother (Rauch, Tung, Striebel), without delay.  `kalman`: nu and nu_dot of
            the filter, from past rows alone.  `kalman-difference`: nu of the filter, and its differences from
            row to row as nu_dot (Deep Hydro-Sim, IV-B).
        designed: `gains(design)`, if available.

    Returns:
        (nu, nu_dot), shape (N, 6, 2).

    Raises:
        DataError: The method is unknown, or a segment has a single row and so no acceleration.
    """
    if method not in METHODS:
        raise DataError(f"acceleration {method!r} is not known; choose one of {', '.join(METHODS)}")
    z = np.ascontiguousarray(velocity, dtype=np.float64)
    forward, backward = designed or gains(design)
    out = np.empty((*z.shape, 2))
    for start, stop in np.asarray(bounds, np.int64):
        if stop - start < 2:
            raise DataError(
                f"row {start} stands alone between gaps in time: it has no acceleration; remove such rows"
            )
        part = out[start:stop]
        _filter_segment(z[start:stop], forward, design.dt, part)
        if method == "rts":
            _smooth_segment(backward, design.dt, part)
        elif method == "kalman-difference":
            _difference_segment(design.dt, part)
    return out


def reach(design: Design) -> int:
    """Return how many rows before and after a row influence its smoothed (nu, nu_dot).

    The weight of any row further away is less than 1e-3 of the largest weight.

    Args:
        design: Settings of the smoother.
    """
    weights = np.abs(_weights(design))
    heavy = np.flatnonzero((weights > NEGLIGIBLE_WEIGHT * weights.max(axis=0)).any(axis=(1, 2)))
    return int(max(MOST_ROWS - heavy[0], heavy[-1] - MOST_ROWS))


def acceleration_noise(design: Design) -> Array:
    """Return the standard deviation of smoothed nu_dot that measurement noise causes, (6,) [m/s^2, rad/s^2].

    Args:
        design: Settings of the smoother, with the noise.
    """
    left: Array = np.asarray(design.noise) * np.sqrt((_weights(design)[:, :, 1] ** 2).sum(axis=0))
    return left


def _weights(design: Design) -> Array:
    """Return the weights of a measurement in smoothed (nu, nu_dot) around it, (2 MOST_ROWS + 1, 6, 2)."""
    impulse = np.zeros((2 * MOST_ROWS + 1, 6))
    impulse[MOST_ROWS] = 1.0
    return smooth(impulse, [[0, len(impulse)]], design)


def estimate(
    velocity: ArrayLike, bounds: ArrayLike, dt: float, noise: Sequence[float] | None = None
) -> Design:
    """Return settings of the smoother with the maximum-likelihood ratio q dt^3 / R of each axis.

    q is the spectral density of the jerk, R the variance of a measurement.  For the right ratio, innovations
    e_k are white with variance R s_k, where s_k follows from the ratio.  For each ratio of a grid, R is the
    mean of e_k^2 / s_k (or given); the ratio with the highest likelihood is used.  Up to 64 windows of 256
    rows, evenly spread over the log, are used.  For data without noise the likelihood rises to the upper end
    of the grid: the data are interpolated without smoothing.

    Args:
        velocity: Measured nu, shape (N, 6) [m/s, rad/s].
        bounds: Segments [start, stop), shape (S, 2).
        dt: Sample time [s].
        noise: Standard deviation of each axis' measurement, shape (6,) [m/s, rad/s]; 0 means no noise, None
            that the noise is estimated.

    Raises:
        DataError: `noise` is not six finite numbers of at least 0, or no segment has eight rows.
    """
    return estimate_in(velocity, windows(np.asarray(bounds, np.int64)), dt, noise)


def estimate_in(velocity: ArrayLike, within: Rows, dt: float, noise: Sequence[float] | None = None) -> Design:
    """Return maximum-likelihood settings of the smoother from given windows of a log, as `estimate` does.

    Only the rows of the windows are read.

    Args:
        velocity: Measured nu, shape (N, 6) [m/s, rad/s].
        within: The windows, as rows [first, last) of `velocity`, shape (W, 2); see `windows`.
        dt: Sample time [s].
        noise: Standard deviation of each axis' measurement, shape (6,) [m/s, rad/s]; 0 means no noise, None
            that the noise is estimated.

    Raises:
        DataError: `noise` is not six finite numbers of at least 0.
    """
    known = None if noise is None else np.asarray(noise, float)
    if known is not None and (known.shape != (6,) or not np.isfinite(known).all() or (known < 0).any()):
        raise DataError(
            f"noise: give six standard deviations of at least 0 (m/s, rad/s), not {list(noise or [])}"
        )
    z = np.ascontiguousarray(velocity, dtype=np.float64)
    scores = np.empty((len(RATIOS), 6, 3))
    for k, ratio in enumerate(RATIOS):
        _innovations_kernel(z, within, _unit_design(ratio, WINDOW), scores[k])
    squares, logs = scores[:, :, 0] / scores[:, :, 2], scores[:, :, 1] / scores[:, :, 2]
    smallest = np.finfo(float).tiny  # an axis without motion has zero innovations
    variance = np.maximum(squares if known is None else np.broadcast_to(known**2, squares.shape), smallest)
    cost = squares / variance + logs + np.log(variance)  # -2 log(likelihood) / rows
    best = np.argmin(cost, axis=0)
    noise_found = np.sqrt(variance[best, np.arange(6)])
    return Design(float(dt), tuple(RATIOS[best].tolist()), tuple(noise_found.tolist()))


def windows(bounds: Rows) -> Rows:
    """Return at most WINDOWS windows of at most WINDOW rows, evenly spread over segments.

    Args:
        bounds: Segments [start, stop), shape (S, 2).

    Returns:
        First row of each window and the row after its last, shape (W, 2).

    Raises:
        DataError: No segment has eight rows.
    """
    pieces = [
        (at, min(at + WINDOW, stop)) for start, stop in bounds.tolist() for at in range(start, stop, WINDOW)
    ]
    long = [piece for piece in pieces if piece[1] - piece[0] >= 8]
    if not long:
        raise DataError(
            "no session has eight rows without a gap: too few to design a filter for the velocity"
        )
    chosen = sorted(set(np.linspace(0, len(long) - 1, WINDOWS).round().astype(int).tolist()))
    return np.array([long[k] for k in chosen], dtype=np.int64)


@jit
def _unit_design(ratio: float, rows: int) -> Array:
    """Return gains and innovation variance (k_1, k_2, s) of each row for R = dt = 1, shape (rows, 3).

    This is the recursion of `_unit_gains` in compiled form, for a search over ratios.
    """
    design = np.zeros((rows, 3))
    p11, p12, p22 = 1.0, 0.0, DIFFUSE * max(1.0, ratio)
    for k in range(1, rows):
        p11, p12, p22 = p11 + 2.0 * p12 + p22 + ratio / 3.0, p12 + p22 + ratio / 2.0, p22 + ratio
        s = p11 + 1.0
        k1, k2 = p11 / s, p12 / s
        p11, p12, p22 = k1, p12 / s, p22 - k2 * p12
        design[k, 0], design[k, 1], design[k, 2] = k1, k2, s
    return design


@jit
def _innovations_kernel(z: Array, windows: Rows, design: Array, out: Array) -> None:
    """Write sums over the windows of e^2 / s, of log s, and their number, for each axis, to `out` (6, 3)."""
    out[:] = 0.0
    state = np.zeros(2)
    for m in range(windows.shape[0]):
        start, stop = windows[m, 0], windows[m, 1]
        for i in range(6):
            state[0], state[1] = z[start, i], 0.0
            for k in range(1, stop - start):
                s = design[k, 2]
                innovation = _step(state, z[start + k, i], design[k], 1.0)
                if k >= UNINFORMED:
                    out[i, 0] += innovation * innovation / s
                    out[i, 1] += math.log(s)
                    out[i, 2] += 1.0
