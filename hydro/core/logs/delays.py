"""Estimation of the delays of sensors relative to the pose, and of the motion relative to the commands.

Sensors are compared with the pose by kinematics (see `logs.agreement`).  The lag of a sensor is the time
shift of its samples that best satisfies d(position)/dt = R v and dR/dt = R S(omega).  Commands are compared
with the motion by least squares of accelerations for every delay: forces linear and quadratic in each delayed
command, damping, and the Coriolis and weight terms of a rigid body, with free coefficients.  Intervals have
95 % confidence and account for residuals that are correlated in time (Newey and West 1987; Ljung 1999, sec.
9.6).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.interval import NORMAL_95
from hydro.core.logs import conventions
from hydro.core.logs.agreement import Evidence, testable, tested, windows
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.importing import motion
from hydro.core.logs.logmap import LogMap, measured
from hydro.core.recording.segments import GAP

FARTHEST = 1.2
"""Largest lag that is searched, in both directions [s]."""
STEP = 0.1
"""Spacing of the first grid of lags [s]."""
ROW = 0.05
"""Spacing of the rows of a window [s]; closer rows add no information."""
LEAST = 15
"""Minimum number of windows, without those that a shift would move across a gap."""
UNEXPLAINED = 0.7
"""Unexplained share of the motion at the best lag above which no lag is reported."""
WIDEST = 0.5
"""Maximum half-width of a reported interval [s]."""
PLAIN = 4.0
"""Standard errors above which a lag is significant."""
LAGS = 3
"""Lags of the residual autocorrelation, in windows."""


@dataclass(frozen=True)
class Offset:
    """Estimated delay of a sensor relative to the pose, or of the motion relative to the commands.

    Attributes:
        block: Quantity that is late: `velocity`, `rates` or `attitude`; or `commands` for the motion.
        seconds: Estimated delay [s].
        low, high: 95 % interval of the delay [s].
        step: Median step of the sensor's samples, or sample time of the commands' estimate [s].
    """

    block: str
    seconds: float
    low: float
    high: float
    step: float

    @property
    def plain(self) -> bool:
        """Whether the delay differs from zero by more than PLAIN (4) standard errors."""
        half = max(self.high - self.seconds, self.seconds - self.low)
        return abs(self.seconds) > PLAIN / NORMAL_95 * half

    @property
    def over_a_sample(self) -> bool:
        """Whether the delay is longer than the sensor's sample time."""
        return abs(self.seconds) > self.step


def shifted(log: SessionLog, given: LogMap, block: str, by: float) -> SessionLog:
    """Return a copy of a session with one sensor's time stamps moved earlier.

    Args:
        log: The session.
        given: Map of the log.
        block: Block of the sensor: `position`, `attitude`, `velocity` or `rates`.
        by: Time by which the stamps move earlier [s].
    """
    sources = measured(getattr(given, block))
    clocks = {one.column: log.time_of(one.column) for one in sources}
    moved = {id(t): t - by for t in clocks.values()}
    return replace(log, clocks={**log.clocks, **{name: moved[id(t)] for name, t in clocks.items()}})


def sensor_offsets(
    logs: Sequence[SessionLog], times: Sequence[Array], dt: float, given: LogMap
) -> list[Offset]:
    """Return the delays of velocity, rates and attitude relative to the pose that the motion shows.

    Velocity and attitude are compared with the position, rates with the attitude.

    Args:
        logs: The sessions.
        times: Of each session, the times at which all channels have values [s].
        dt: Sample time [s].
        given: The map that the data follow.
    """
    thin = max(1, int(ROW / dt))
    taken = windows([_inner(t, dt)[::thin] for t in times], thin * dt)
    if sum(map(len, taken)) < LEAST:
        return []
    moves, spins = tested(given)
    found = []
    if moves:
        found += _estimated(logs, taken, given, ("velocity", "attitude"), slice(0, 3))
    if spins:
        found += _estimated(logs, taken, given, ("rates",), slice(3, 6))
    return found


def _inner(t: Array, dt: float) -> Array:
    """Return the times that are farther than FARTHEST, the largest tested lag, from every gap."""
    edges = np.r_[0, np.flatnonzero(np.diff(t) > GAP * dt) + 1, len(t)]
    kept = [
        part[(part > part[0] + FARTHEST) & (part < part[-1] - FARTHEST)]
        for part in (t[start:stop] for start, stop in pairwise(edges))
        if len(part)
    ]
    return np.concatenate(kept) if kept else t[:0]


def _estimated(
    logs: Sequence[SessionLog], taken: Sequence[Array], given: LogMap, blocks: tuple[str, ...], rows: slice
) -> list[Offset]:
    """Estimate lags of some blocks by nonlinear least squares of one identity: grid, then Gauss-Newton.

    Args:
        logs: Sessions of the log.
        taken: Times of the windows of each session, from `agreement.windows`.
        given: Map that the data follow.
        blocks: Sensors whose lags are estimated; the first is searched on the grid.
        rows: Components of the identity among six: the first three for translation, the others for rotation.
    """
    plain = Evidence(logs, taken)
    of = testable(given)[rows]

    @cache
    def late(lag: float) -> Evidence:
        return Evidence(logs, [t + lag for t in taken]) if lag else plain  # only one block is read from it

    def left(lags: Array) -> Array:
        moved = {block: late(round(float(lag), 6)) for block, lag in zip(blocks, lags, strict=True)}
        if "rates" in moved:
            assert given.rates is not None
            assert given.attitude is not None
            spinning = plain.mean(moved["rates"].spinning(given.rates), "trapezoid")
            return np.asarray((plain.turning(given.attitude) - spinning) * of)
        assert given.position is not None
        assert given.attitude is not None
        assert given.velocity is not None
        v = moved["velocity"].velocity(given.velocity)
        if given.velocity.frame in conventions.BODIES:
            v = np.einsum("wkij,wkj->wki", moved["attitude"].attitude(given.attitude), v)
        return np.asarray((plain.travel(given.position) - plain.mean(v, "trapezoid")) * of)

    lags = np.zeros(len(blocks))
    grid = np.arange(-FARTHEST + STEP, FARTHEST, STEP)
    costs = [float((left(np.r_[lag, lags[1:]]) ** 2).sum()) for lag in grid]
    lags[0] = grid[int(np.argmin(costs))]
    if lags[0] in (grid[0], grid[-1]):
        return []
    h = 0.2 * STEP
    r = left(lags)
    for _ in range(6):
        J = np.stack([(left(lags + step) - left(lags - step)) / (2.0 * h) for step in h * np.eye(len(lags))])
        step = _solved(J, r)
        lags = np.clip(lags + np.clip(step, -STEP, STEP), -FARTHEST, FARTHEST)
        r = left(lags)
        if np.abs(step).max() < 1e-4:
            break
    whole = plain.motion(given)[0 if rows.start == 0 else 1]
    if np.sqrt((r**2).sum(axis=1).mean()) > UNEXPLAINED * whole:
        return []
    return [
        Offset(
            block,
            float(lag),
            float(lag - NORMAL_95 * error),
            float(lag + NORMAL_95 * error),
            _step(logs, given, block),
        )
        for block, lag, error in zip(blocks, lags, _errors(J, r), strict=True)
        if NORMAL_95 * error < WIDEST and abs(lag) < FARTHEST
    ]


def _solved(J: Array, r: Array) -> Array:
    """Return the Gauss-Newton step of k lags, (k,); 0 for a lag whose slopes vanish.

    Args:
        J: Slopes of the residuals over each lag, (k, W, c) for W windows and c components.
        r: Residuals, (W, c).
    """
    A = J.reshape(len(J), -1).T
    return np.asarray(np.linalg.lstsq(A, -r.ravel(), rcond=1e-3)[0])


def _errors(J: Array, r: Array) -> Array:
    """Return the standard errors of k lags, (k,), with residuals that are correlated over a few windows.

    Args:
        J: Slopes of the residuals over each lag, (k, W, c) for W windows and c components.
        r: Residuals, (W, c).
    """
    H = np.einsum("kwc,lwc->kl", J, J)
    scores = np.einsum("kwc,wc->wk", J, r)
    S = scores.T @ scores
    for lag in range(1, LAGS + 1):
        weight = 1.0 - lag / (LAGS + 1.0)
        cross = scores[lag:].T @ scores[:-lag]
        S += weight * (cross + cross.T)
    independent = H * (r**2).mean()  # short logs: at least the error for white noise of this size
    if not np.linalg.eigvalsh(H)[0] > 1e-12 * np.trace(H):
        return np.full(len(H), np.inf)
    inverse = np.linalg.inv(H)
    variances = [np.diag(inverse @ each @ inverse) for each in (S, independent)]
    return np.sqrt(np.maximum(*variances))


def _step(logs: Sequence[SessionLog], given: LogMap, block: str) -> float:
    """Return the median step of a sensor's samples [s]."""
    first = measured(getattr(given, block))[0]
    return float(np.median([log.channel(first).step for log in logs]))


ACCELERATED = 0.5
"""Time over which a change of velocity is taken [s]."""
MOST_WINDOWS = 1500
TOGETHER = 128
"""Number of windows processed together; rows of a long log between them are skipped."""
LONGEST_DELAY, EARLIEST = 1.5, -0.7
"""Range of the delays of the motion [s]; it precedes the commands only if clocks disagree."""
DELAY_STEP = 0.02
DELAYS: Array = np.arange(EARLIEST, LONGEST_DELAY + 0.5 * DELAY_STEP, DELAY_STEP)
LEAST_OF_EACH = 3
"""Minimum number of windows for each coefficient."""
EXPLAINS = 0.05
"""Minimum share of the acceleration that the commands explain at the best delay."""
CHI2 = 3.84
"""95 % quantile of chi-square with one degree of freedom."""


@dataclass(frozen=True)
class _Piece:
    """Windows of an uninterrupted part of a log, for D delays of n thrusters.

    Attributes:
        change: Change of the velocity over each of W windows, (W, 6).
        fixed: Integrals over a window of k regressors of the acceleration, all except the commands, (W, k).
        drive: Integrals of the commands, and of their signed squares, at each of the delays, (D, W, 2 n).
    """

    change: Array
    fixed: Array
    drive: Array


def command_delay(
    logs: Sequence[SessionLog], times: Sequence[Array], dt: float, given: LogMap
) -> Offset | None:
    """Return the estimated delay of the motion relative to the commands, including the thrusters' lag.

    Args:
        logs: The sessions.
        times: Of each session, the times at which all channels have values [s].
        dt: Sample time [s].
        given: The map that the data follow, with at least velocity or rates.

    Returns:
        The delay; None if the log does not show it.  Then it has no velocities or is too short, the commands
        explain no acceleration, or the interval is too wide.
    """
    axes = _axes(given)
    rows = sum(map(len, times))
    stride = max(1, round(ACCELERATED / dt) // 4, rows // MOST_WINDOWS)
    pieces = [
        piece for log, t in zip(logs, times, strict=True) for piece in _pieces(log, t, dt, given, stride)
    ]
    count = sum(len(piece.change) for piece in pieces)
    if (
        not axes
        or not pieces
        or count < LEAST_OF_EACH * (pieces[0].fixed.shape[1] + pieces[0].drive.shape[2])
    ):
        return None
    y = np.concatenate([piece.change for piece in pieces])[:, axes]
    Z = np.concatenate([piece.fixed for piece in pieces])
    return _profiled(y, Z, lambda k: np.concatenate([piece.drive[k] for piece in pieces]), DELAYS, dt)


def _axes(given: LogMap) -> list[int]:
    """Return the numbers from 0 to 5 of the axes whose velocity is measured."""
    turned = given.velocity is not None and given.velocity.frame not in conventions.BODIES
    along = given.velocity is not None and (given.attitude is not None or not turned)
    return [*(range(3) if along else ()), *(range(3, 6) if given.rates is not None else ())]


def _pieces(log: SessionLog, t: Array, dt: float, given: LogMap, stride: int) -> Iterator[_Piece]:
    """Yield the windows of each uninterrupted part of a session that is long enough for every delay.

    Args:
        log: Session of the log.
        t: Times of its rows [s].
        dt: Sample time [s].
        given: Map that the data follow.
        stride: Number of rows from the start of one window to that of the next.
    """
    m = max(2, round(ACCELERATED / dt))
    edges = np.r_[0, np.flatnonzero(np.diff(t) > GAP * dt) + 1, len(t)]
    for start, stop in pairwise(edges):
        at = t[start:stop]
        if len(at) < m or not at[-1] - at[0] > LONGEST_DELAY - EARLIEST + 2.0 * ACCELERATED:
            continue
        inside = (at > at[0] + LONGEST_DELAY) & (at < at[-1] + EARLIEST - ACCELERATED)
        every = np.flatnonzero(inside)[::stride]
        before, after = round(LONGEST_DELAY / dt) + 2, m + round(-EARLIEST / dt) + 2
        for first in np.split(every, range(TOGETHER, len(every), TOGETHER)):
            if len(first):
                near = np.unique(np.clip(first[:, None] + np.arange(-before, after), 0, len(at) - 1))
                yield _piece(log, at[near], dt, given, np.searchsorted(near, first), m)


def _piece(log: SessionLog, at: Array, dt: float, given: LogMap, first: Rows, m: int) -> _Piece:
    """Build windows of m rows that start at some rows.

    Args:
        log: Session of the log.
        at: Times of rows [s].
        dt: Sample time [s].
        given: Map that the data follow.
        first: Numbers of the rows in `at` at which the windows start.
        m: Number of rows of a window.
    """
    values = np.nan_to_num(motion(log, at, given))
    nu = values[:, 6:]
    steady = _beside(nu, values[:, 3], values[:, 4])
    areas = np.vstack([np.zeros(steady.shape[1]), np.cumsum(0.5 * dt * (steady[1:] + steady[:-1]), axis=0)])
    drive = _driven(log, at, dt, given, first, m)
    return _Piece(nu[first + m] - nu[first], areas[first + m] - areas[first], drive)


def _beside(nu: Array, phi: Array, theta: Array) -> Array:
    """Return 25 regressors of the acceleration other than thrust at N rows, (N, 25).

    These are linear and quadratic damping, products of velocities, weight, and a constant.

    Args:
        nu: Body velocities, (N, 6) [m/s, rad/s].
        phi: Roll [rad], (N,).
        theta: Pitch [rad], (N,).
    """
    u, v, w, p, q, r = nu.T
    turning = np.stack([v * r, w * q, u * r, w * p, u * q, v * p, q * r, p * r, p * q], axis=1)
    weight = np.stack([np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)], axis=1)
    return np.column_stack([nu, np.abs(nu) * nu, turning, weight, np.ones(len(nu))])


def _driven(log: SessionLog, at: Array, dt: float, given: LogMap, first: Rows, m: int) -> Array:
    """Return integrals of commands over windows, for each of D delays, (D, W, 2 n) for n thrusters.

    The first n are of the commands, the others of their signed squares.

    Args:
        log: Session of the log.
        at: Times of rows [s].
        dt: Sample time [s].
        given: Map that the data follow.
        first: Numbers of the rows in `at` at which the W windows start.
        m: Number of rows of a window.
    """
    drive, _ = conventions.commands(log, given.commands, at, dt, given.mixer)
    drive = np.column_stack([drive, np.abs(drive) * drive])
    summed = np.zeros((drive.shape[1], len(drive) + 1))
    np.cumsum(drive.T * dt, axis=1, out=summed[:, 1:])
    grid = np.r_[at, at[-1] + dt]

    def until(t: Array) -> Array:
        return np.stack([np.interp(t, grid, each) for each in summed], axis=1)

    return np.stack([until(at[first + m] - delay) - until(at[first] - delay) for delay in DELAYS])


def _profiled(y: Array, Z: Array, drive: Callable[[int], Array], delays: Array, dt: float) -> Offset | None:
    """Average the delays of all axes, weighted by their intervals; the interval widens if they disagree.

    Args:
        y: Change of the velocity on each of A axes over each of W windows, (W, A).
        Z: Regressors other than the commands, (W, k).
        drive: Function from the number of a delay to the commands at that delay, (W, 2 n).
        delays: Tested delays [s], (D,).
        dt: Sample time [s].

    Returns:
        The delay; None if no axis shows it or the interval is too wide.
    """
    basis = _basis(Z)

    def beside(values: Array) -> Array:
        return np.asarray(values - basis @ (basis.T @ values))

    y = beside(y)
    left = np.stack([_left(y, beside(drive(k))) for k in range(len(delays))])
    share = 1.0 - (Z.shape[1] + drive(0).shape[1]) / len(y)
    every = [
        _axis(y[:, i], left[:, i], beside(drive(int(np.argmin(left[:, i])))), delays, share)
        for i in range(y.shape[1])
    ]
    found = np.array([one for one in every if one is not None]).reshape(-1, 2)
    if not len(found):
        return None
    weights = found[:, 1] ** -2.0
    middle = float(found[:, 0] @ weights / weights.sum())
    chi2 = float(
        ((found[:, 0] - middle) ** 2 * weights).sum() / max(len(found) - 1, 1)
    )  # Birge's ratio, squared
    half = NORMAL_95 * float(np.sqrt(max(chi2, 1.0) / weights.sum()))
    return Offset("commands", middle, middle - half, middle + half, dt) if half < WIDEST else None


def _axis(y: Array, left: Array, drive: Array, delays: Array, share: float) -> tuple[float, float] | None:
    """Return the maximum-likelihood delay of one axis, and its standard error from the profile.

    Args:
        y: Change of the velocity over each of W windows, with all regressors except the commands projected
            out, (W,).
        left: Residual sum of squares at each of D delays, (D,).
        drive: Commands at the best delay, projected likewise, (W, 2 n).
        delays: Tested delays [s], (D,).
        share: Residual degrees of freedom as a share of W.

    Returns:
        Delay and standard error [s]; None if the commands explain hardly anything, or if the best delay is at
        an end of the range.
    """
    best = int(np.argmin(left))
    if not left[best] < (1.0 - EXPLAINS) * (y @ y) or best in (0, len(delays) - 1):
        return None
    own = _basis(drive)
    size = _effective(y - own @ (own.T @ y)) * share
    above = size * np.log(left / left[best]) - CHI2
    low, high = _crossing(delays, above, best, -1), _crossing(delays, above, best, 1)
    if low <= delays[0] or high >= delays[-1]:
        return None
    a, b, _ = np.polyfit(delays[best - 1 : best + 2], left[best - 1 : best + 2], 2)
    middle = -b / (2.0 * a) if a > 0.0 else delays[best]
    return float(np.clip(middle, delays[best - 1], delays[best + 1])), float((high - low) / (2.0 * NORMAL_95))


def _left(y: Array, drive: Array) -> Array:
    """Return the residual sum of squares of each of A axes that the commands do not explain, (A,).

    Args:
        y: Changes of the velocity over W windows, (W, A).
        drive: Commands, (W, 2 n).
    """
    size = np.linalg.norm(drive, axis=0)
    unit = drive[:, size > 0.0] / size[size > 0.0]
    values, vectors = np.linalg.eigh(unit.T @ unit)
    kept = values > 1e-9 * values.max(initial=0.0)
    told = (vectors[:, kept].T @ (unit.T @ y)) ** 2 / values[kept, None]
    return np.asarray((y**2).sum(axis=0) - told.sum(axis=0))


def _basis(columns: Array) -> Array:
    """Return an orthonormal basis of the span of columns, each normalised; dependent ones are dropped."""
    size = np.linalg.norm(columns, axis=0)
    U, s, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return np.asarray(U[:, s > 1e-6 * s.max(initial=0.0)])


def _effective(r: Array) -> float:
    """Return the effective number of independent values of a correlated series."""
    r = r - r.mean()
    power = np.abs(np.fft.rfft(r, 2 * len(r))) ** 2
    correlation = np.fft.irfft(power)[: len(r)]
    correlation /= correlation[0]
    ends = np.flatnonzero(correlation < 0.0)
    first = int(ends[0]) if len(ends) else len(r)
    return float(len(r) / (1.0 + 2.0 * correlation[1:first].sum()))


def _crossing(delays: Array, above: Array, best: int, way: int) -> float:
    """Return the delay at which the profile crosses the limit on one side of its optimum [s].

    Args:
        delays: Tested delays [s], (D,).
        above: Profile less the limit at each delay, (D,); positive beyond the interval.
        best: Number of the delay at the optimum.
        way: Direction of the search: -1 to shorter delays, 1 to longer ones.
    """
    k = best
    while 0 < k < len(delays) - 1 and above[k] <= 0.0:
        k += way
    if above[k] <= 0.0:
        return float(delays[k])
    share = above[k - way] / (above[k - way] - above[k])
    return float(delays[k - way] + share * (delays[k] - delays[k - way]))
