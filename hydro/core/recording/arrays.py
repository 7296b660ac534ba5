"""Raw table (an imported log with one row per sample time) as arrays, validated once, for identification."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import POSE, VELOCITY, Array, Mask, Rows, checked_commands
from hydro.core.errors import DataError
from hydro.core.local_polynomials import savitzky_golay
from hydro.core.recording.filling import filled, steady
from hydro.core.recording.segments import resumes, sample_time, segments
from hydro.core.recording.supply import effective_commands, supply_voltage
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import euler_from_quaternion, quaternion_from_euler

CUBIC_REACH = 0.24
"""Half-width of the local cubic of `smoothed` [s]."""
Number = TypeVar("Number", bound=np.generic)
HORIZONTAL = (("x", "y"), ("u", "v"))
"""Channels that show horizontal motion, as alternatives."""
LEAST_NOISE = 1e-4
LEAST_SAMPLES = 5
MOSTLY = 0.5  # share of sampled rows above which a row without a sample is a dropout, not a slower sensor
UNSEEN = np.repeat([0.1, 0.1, 0.3, 0.3], 3)
"""Assumed noise of a channel without samples [m, rad, m/s, rad/s]; no likelihood includes it."""
STRAIGHT = 0.02
"""Second difference of a row, relative to the RMS of all, below which three rows lie on a straight line."""
DRAWN_ROWS = 0.4  # minimum share of such rows in an interpolated channel
LEAST_CORNERS = 12  # minimum number of corners of the lines
CORNER_ROWS = 2  # maximum rows of a corner
UNSTEADY = 0.25  # maximum relative variation of the distance of corners, unless the lines are exact
MOST = 0.8  # minimum share of corners, or of rows between them, that satisfy these limits
ROUNDING = 4.0 * float(np.finfo(np.float32).eps)
"""Second difference of a straight line, relative to the channel's maximum, that rounding explains."""


@dataclass(frozen=True)
class Recording:
    """Raw table (an imported log: one clock, SI units, NED and FRD frames) as float64 arrays of N rows.

    Where a sensor has no sample, eta and nu are filled: the values are initial guesses, not measurements.

    Attributes:
        t: Times as logged [s], (N,); they ascend within a segment only.
        eta: Pose x y z phi theta psi, NED, (N, 6); angles as logged, they may jump by a turn.
        nu: Velocity as the log gives it, body frame, (N, 6).
        commands: Effective commands (`recording.supply`) of n thrusters, (N, n); row k is held on [t_k,
            t_k+1).
        segments: Uninterrupted runs of rows [start, stop), (S, 2).
        after_gap: Mask of the segments that continue a session after a gap, (S,).
        session: Number of each segment's session, (S,).
        dt: Sample time [s].
        seen: Mask of the values of pose and velocity that are samples, (N, 12); None if all values are.
        sigma: Standard deviation of the noise of channels with pseudo-observations (`recording.heavy_tails`),
            (12,), NaN for other channels; None without such channels.
        doubt: Standard deviation of values that a model filled into channels without samples, (12,); None if
            no model filled any.
    """

    t: Array
    eta: Array
    nu: Array
    commands: Array
    segments: Rows
    after_gap: NDArray[np.bool_]
    session: Rows
    dt: float
    seen: Mask | None = None
    sigma: Array | None = None
    doubt: Array | None = None

    @property
    def rows(self) -> int:
        """Number of rows N."""
        return len(self.t)

    @cached_property
    def sampled(self) -> frozenset[str]:
        """Names of the channels of pose and velocity that have samples, such as `x` or `u`; a property."""
        some = np.arange(12) if self.seen is None else np.flatnonzero(self.seen.any(axis=0))
        return frozenset((POSE + VELOCITY)[channel] for channel in some.tolist())

    def shows(self, alternatives: Iterable[Iterable[str]]) -> bool:
        """Return whether, of several groups of channels, at least one group has samples in every channel.

        Args:
            alternatives: Groups of names of channels, such as `x` or `u`.
        """
        return any(self.sampled.issuperset(channels) for channels in alternatives)

    @property
    def track(self) -> Array:
        """Positions x y z [m] and times [s], (N, 4)."""
        return np.column_stack([self.eta[:, :3], self.t])


def recording(vehicle: Vehicle, raw: pl.DataFrame) -> Recording:
    """Return a raw table as a `Recording`, with the effective commands of a vehicle's thrusters.

    Args:
        vehicle: Vehicle whose thrusters the commands drive.
        raw: Raw table: `session`, `t`, pose, velocity and the commands `cmd_1 ... cmd_n`.

    Raises:
        DataError: A column is missing or not finite, the commands do not fit the thrusters, or time does not
            ascend at one rate.
    """
    commands = checked_commands(raw.columns, len(vehicle.thruster), vehicle.name)
    supply = supply_voltage(vehicle, raw)
    needed = ("session", "t", *POSE, *VELOCITY, *commands)
    missing = [name for name in needed if name not in raw.columns]
    if missing:
        raise DataError(f"the log has no column {missing[0]}; a raw table needs {', '.join(needed)}")
    numbers = np.ascontiguousarray(raw.select(needed[1:]).to_numpy().astype(np.float64))
    seen = _samples(raw)
    wrong = ~np.isfinite(numbers)
    if seen is not None:
        wrong[:, 1:13] &= seen
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise DataError(f"{needed[1 + column]} is not finite in row {row}; see `hydro check`")
    bounds = segments(raw)
    if seen is not None:
        numbers[:, 1:13] = filled(numbers[:, 1:13], bounds, sample_time(raw))
    after_gap = resumes(raw, bounds)
    return Recording(
        t=np.ascontiguousarray(numbers[:, 0]),
        eta=np.ascontiguousarray(numbers[:, 1:7]),
        nu=np.ascontiguousarray(numbers[:, 7:13]),
        commands=effective_commands(vehicle, np.ascontiguousarray(numbers[:, 13:]), supply),
        segments=bounds,
        after_gap=after_gap,
        session=np.cumsum(~after_gap, dtype=np.int64) - 1,
        dt=sample_time(raw),
        seen=seen,
    )


def _samples(raw: pl.DataFrame) -> Mask | None:
    """Return which values of pose and velocity are samples, (N, 12); None if all are."""
    motion = raw.select(*POSE, *VELOCITY)
    if not sum(motion.null_count().row(0)):
        return None
    return np.ascontiguousarray(motion.select(pl.all().is_not_null()).to_numpy())


def smoothed(record: Recording) -> tuple[Array, Array]:
    """Return pose and velocity smoothed by local cubic polynomials over half a second, without delay.

    The attitude is smoothed as a quaternion, so that the vehicle may loop: roll and heading jump by half a
    turn at the vertical.

    Args:
        record: Recording of N rows; it is not changed.

    Returns:
        eta and nu, (N, 6) each; segments of fewer than five rows unchanged.
    """
    eta, nu = record.eta.copy(), record.nu.copy()
    widest = max(2 * round(CUBIC_REACH / record.dt) + 1, 5)
    for start, stop in record.segments:
        width = min(widest, (stop - start - 1) // 2 * 2 + 1)
        if width >= 5:
            quaternion = steady(quaternion_from_euler(*eta[start:stop, 3:].T))
            calm = savitzky_golay(np.hstack([eta[start:stop, :3], quaternion]), width, 3)
            eta[start:stop, :3] = calm[:, :3]
            eta[start:stop, 3:] = euler_from_quaternion(calm[:, 3:])
            nu[start:stop] = savitzky_golay(nu[start:stop], width, 3)
    return eta, nu


def noise(record: Recording) -> Array:
    """Return the estimated standard deviation of the white noise of each channel, pose then velocity, (12,).

    The estimate uses fourth differences.  In them motion nearly cancels, and white noise of variance s^2 has
    the variance 70 s^2.  Their median size is robust to a few jumps.  A channel interpolated between the
    samples of a slower sensor is judged at the spacing of these samples.  The minimum is 1e-4 (m, rad, m/s,
    rad/s), for simulated logs without noise.  A channel with nulls is judged by its samples; one with fewer
    than five in every segment gets UNSEEN.

    Raises:
        DataError: No segment has five rows.
    """
    if record.seen is None:
        found = np.array([_noise(parts) for parts in channels(record)])
    else:
        enough = (max(map(len, parts)) >= LEAST_SAMPLES for parts in samples(record))
        each = zip(samples(record), enough, UNSEEN, strict=True)
        found = np.array([_noise(parts) if known else size for parts, known, size in each])
    if record.sigma is not None:
        found = np.where(np.isfinite(record.sigma), record.sigma, found)
    sigma: Array = np.maximum(found, LEAST_NOISE)
    return sigma


def drawn(record: Recording, of: slice = slice(None)) -> bool:
    """Return whether a channel holds values that were interpolated between a sensor's samples.

    The noise of an interpolated channel is not white from row to row, even if its size is known.

    Args:
        record: The recording.
        of: Slice of the 12 channels (pose, then velocity) to check; by default all.
    """
    if record.seen is not None and not record.seen[:, of].all():
        return True
    return any(_apart(parts) > 1 for parts in list(channels(record))[of])


def channels(record: Recording) -> Iterator[list[Array]]:
    """Yield each of the 12 channels of a recording, pose then velocity, as a list of arrays, one per segment.

    Every array holds all rows of its segment, (n,).  Angles are unwrapped.
    """
    channels = np.hstack([record.eta, record.nu])
    for start, stop in record.segments:
        channels[start:stop, 3:6] = np.unwrap(channels[start:stop, 3:6], axis=0)
    for column in channels.T:
        yield [column[start:stop] for start, stop in record.segments]


def samples(record: Recording) -> Iterator[list[Array]]:
    """Yield the samples of each of the 12 channels, pose then velocity, as a list of arrays, one per segment.

    Values that were filled between samples are left out, so arrays of one segment may differ in length.
    """
    for i, parts in enumerate(channels(record)):
        if record.seen is None:
            yield parts
        else:
            bounds = zip(parts, record.segments, strict=True)
            yield [part[record.seen[start:stop, i]] for part, (start, stop) in bounds]


def evenly_spaced(parts: Sequence[NDArray[Number]], record: Recording, channel: int) -> list[NDArray[Number]]:
    """Return values at the samples of one channel in evenly spaced runs, split where samples are missing.

    Args:
        parts: Values at the samples of the channel, one array per segment.
        record: The recording.
        channel: Number of the channel, 0 to 5 pose, 6 to 11 velocity.

    Returns:
        One array per run.  A channel with samples in few rows is not split: one array per segment.
    """
    if record.seen is None or record.seen[:, channel].mean() <= MOSTLY:
        return list(parts)
    runs = []
    for part, (start, stop) in zip(parts, record.segments, strict=True):
        rows = np.flatnonzero(record.seen[start:stop, channel])
        runs += np.split(part, np.flatnonzero(np.diff(rows) > 1) + 1)
    return runs


def _apart(parts: Sequence[Array]) -> int:
    """Return the rows from one sample of a channel to the next; 1 if every row is a sample.

    Interpolated lines bend only at the samples, for one or two rows, and at a steady pace or with exact lines
    between.  Smooth motion bends for many consecutive rows.  A jump of thrust bends a velocity for one row,
    but the motion continues along a curve, and at no steady pace.
    """
    bends = np.concatenate([np.diff(part, 2) for part in parts])
    bent = np.abs(bends) >= STRAIGHT * np.sqrt(np.mean(bends**2)) if bends.size else np.ones(0, bool)
    corners = int(np.count_nonzero(bent[1:] & ~bent[:-1]))  # one at each sample of the slower sensor
    if corners < LEAST_CORNERS or float(np.mean(bent)) > 1.0 - DRAWN_ROWS:
        return 1
    begin, end = np.flatnonzero(np.diff(bent, prepend=False, append=False)).reshape(-1, 2).T
    short = float(np.mean(end - begin <= CORNER_ROWS))
    steps = np.diff(begin)
    steady = float(np.mean(np.abs(steps - np.median(steps)) <= np.maximum(1.0, UNSTEADY * np.median(steps))))
    size = ROUNDING * max(float(np.abs(part).max()) for part in parts if part.size)
    exact = float(np.mean(np.abs(bends[~bent]) <= size))
    return round(len(bent) / corners) if short >= MOST and max(steady, exact) >= MOST else 1


def _noise(parts: Sequence[Array]) -> float:
    """Return the noise of one channel, given by segments."""
    apart, sizes = _apart(parts), list[float]()
    for first in range(apart):  # the rows at the samples, or nearest to them
        differences = [np.diff(part[first::apart], 4) for part in parts if len(part) > first]
        if sum(part.size for part in differences):
            sizes.append(float(np.median(np.abs(np.concatenate(differences)))))
    if not sizes:
        raise DataError("no session has five rows without a gap; record longer sessions")
    return max(sizes) / (0.6745 * float(np.sqrt(70.0)))
