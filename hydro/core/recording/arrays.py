"""A raw table as arrays: what identification reads of a recording, checked once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from hydro.core.columns import POSE, VELOCITY, Array, Mask, Rows, checked_commands
from hydro.core.errors import DataError
from hydro.core.recording.filling import filled, steady
from hydro.core.recording.segments import resumes, sample_time, segments
from hydro.core.recording.supply import effective_commands, supply_voltage
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import euler_from_quaternion, quaternion_from_euler

CUBIC_REACH = 0.24
"""Half-width of the cubic that `smoothed` lays through each measurement [s]."""
Number = TypeVar("Number", bound=np.generic)
HORIZONTAL = (("x", "y"), ("u", "v"))
"""Channels that show horizontal motion, alternatives to each other."""
LEAST_NOISE = 1e-4
LEAST_SAMPLES = 5
MOSTLY = (
    0.5  # share of the rows with a sample from which one without is a hole, not the pace of a slower sensor
)
UNSEEN = np.repeat([0.1, 0.1, 0.3, 0.3], 3)
"""What counts as noise of a channel without samples [m, rad, m/s, rad/s]; no likelihood has a term of it."""
STRAIGHT = 0.02
"""Bend of a row, over the root mean square of all, below which three rows lie on a straight line."""
DRAWN_ROWS = 0.4  # share of such rows from which a channel is one that was interpolated,
LEAST_CORNERS = 12  # if its lines meet so often at least,
CORNER_ROWS = 2  # in so few rows,
UNSTEADY = 0.25  # and at a pace steady to this share, or without any bend between,
MOST = 0.8  # at this share of corners, or of rows between them
ROUNDING = 4.0 * float(np.finfo(np.float32).eps)
"""Bend of a straight line, over the channel's greatest value, that rounding of the table explains."""


@dataclass(frozen=True)
class Recording:
    """A raw table in float64.

    Where a sensor gave nothing, eta and nu are filled: to begin from, not to compare with.

    Attributes:
        t: Times as logged [s], (N,); they rise within a segment only.
        eta: Pose x y z phi theta psi, NED, (N, 6); angles as logged, they may jump by a turn.
        nu: Velocity as the log gives it, body frame, (N, 6).
        commands: (N, n), effective ones (`recording.supply`); row k is held on [t_k, t_k+1).
        segments: Unbroken runs of rows [start, stop), (S, 2).
        after_gap: Which segments go on with a session after a gap, (S,).
        session: Number of each segment's session, (S,).
        dt: Sample time [s].
        seen: Which values of pose and velocity are samples, (N, 12); None where all are.
        sigma: Noise of channels that hold pseudo-observations (`recording.heavy_tails`), (12,), NaN of
            others; None where none does.
        doubt: Standard deviation of what fills channels without samples, (12,), where a model has done so.
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
        """Channels of pose and velocity that have samples."""
        some = np.arange(12) if self.seen is None else np.flatnonzero(self.seen.any(axis=0))
        return frozenset((POSE + VELOCITY)[channel] for channel in some.tolist())

    def shows(self, alternatives: Iterable[Iterable[str]]) -> bool:
        """Return whether every channel of one of the alternatives has samples."""
        return any(self.sampled.issuperset(channels) for channels in alternatives)

    @property
    def track(self) -> Array:
        """Positions x y z [m] and times [s], (N, 4)."""
        return np.column_stack([self.eta[:, :3], self.t])


def recording(vehicle: Vehicle, raw: pl.DataFrame) -> Recording:
    """Read a raw table for a vehicle.

    Raises:
        DataError: A column is missing or not finite, the commands do not fit the thrusters, or time does not
            rise at one rate.
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
    """Which values of pose and velocity are there, (N, 12); None where all are."""
    motion = raw.select(*POSE, *VELOCITY)
    if not sum(motion.null_count().row(0)):
        return None
    return np.ascontiguousarray(motion.select(pl.all().is_not_null()).to_numpy())


def smoothed(record: Recording) -> tuple[Array, Array]:
    """Pose and velocity through local cubics of half a second: without most of the noise, without delay.

    The attitude goes through its quaternion, so that a vehicle may loop and tumble: roll and heading jump by
    half a turn where it passes the vertical.

    Returns:
        eta and nu, (N, 6) each; segments of fewer than five rows as they are.
    """
    eta, nu = record.eta.copy(), record.nu.copy()
    widest = max(2 * round(CUBIC_REACH / record.dt) + 1, 5)
    for start, stop in record.segments:
        width = min(widest, (stop - start - 1) // 2 * 2 + 1)
        if width >= 5:
            quaternion = steady(quaternion_from_euler(*eta[start:stop, 3:].T))
            calm = scipy.signal.savgol_filter(np.hstack([eta[start:stop, :3], quaternion]), width, 3, axis=0)
            eta[start:stop, :3] = calm[:, :3]
            eta[start:stop, 3:] = euler_from_quaternion(calm[:, 3:])
            nu[start:stop] = scipy.signal.savgol_filter(nu[start:stop], width, 3, axis=0)
    return eta, nu


def noise(record: Recording) -> Array:
    """Standard deviation of the white noise on each channel, pose then velocity, shape (12,).

    From fourth differences, in which motion all but cancels and white noise of variance s^2 has 70 s^2; by
    their median size, so that a few jumps of a log do not count.  A channel that was drawn in straight lines
    between the samples of a slower sensor is judged by rows as far apart as those.  Never below 1e-4 (m, rad,
    m/s, rad/s), where a simulated log carries no noise at all.  Of a channel with nulls its samples alone are
    looked at; one with fewer than five in every segment counts as UNSEEN.

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
    """Whether any of these channels was drawn in straight lines between the samples of a slower sensor.

    Its noise is not white from row to row, however well its size is known; nor is it where rows without a
    sample were filled.
    """
    if record.seen is not None and not record.seen[:, of].all():
        return True
    return any(_apart(parts) > 1 for parts in list(channels(record))[of])


def channels(record: Recording) -> Iterator[list[Array]]:
    """Each channel segment by segment, pose then velocity, angles without jumps."""
    channels = np.hstack([record.eta, record.nu])
    for start, stop in record.segments:
        channels[start:stop, 3:6] = np.unwrap(channels[start:stop, 3:6], axis=0)
    for column in channels.T:
        yield [column[start:stop] for start, stop in record.segments]


def samples(record: Recording) -> Iterator[list[Array]]:
    """Each channel's samples segment by segment, without what was filled."""
    for i, parts in enumerate(channels(record)):
        if record.seen is None:
            yield parts
        else:
            bounds = zip(parts, record.segments, strict=True)
            yield [part[record.seen[start:stop, i]] for part, (start, stop) in bounds]


def evenly_spaced(parts: Sequence[NDArray[Number]], record: Recording, channel: int) -> list[NDArray[Number]]:
    """What stands at each sample of a channel, in runs: where few rows have no sample, those between holes.

    Args:
        parts: Segment by segment.
        record: The recording.
        channel: Number of the channel, pose then velocity.
    """
    if record.seen is None or record.seen[:, channel].mean() <= MOSTLY:
        return list(parts)
    runs = []
    for part, (start, stop) in zip(parts, record.segments, strict=True):
        rows = np.flatnonzero(record.seen[start:stop, channel])
        runs += np.split(part, np.flatnonzero(np.diff(rows) > 1) + 1)
    return runs


def _apart(parts: Sequence[Array]) -> int:
    """Rows from one sample of a channel to the next; 1 where every row is one.

    Lines between samples bend at these alone, a row or two long, and either at a steady pace or not at all
    between.  Smooth motion bends for many rows on end; and where thrusts without lag jump, which bend a
    velocity for one row, it goes on along a curve, at no steady pace.
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
    """The same of one channel, segment by segment."""
    apart, sizes = _apart(parts), list[float]()
    for first in range(apart):  # of the rows that fall on the samples, or nearest to them
        differences = [np.diff(part[first::apart], 4) for part in parts if len(part) > first]
        if sum(part.size for part in differences):
            sizes.append(float(np.median(np.abs(np.concatenate(differences)))))
    if not sizes:
        raise DataError("no session has five rows without a gap; record longer sessions")
    return max(sizes) / (0.6745 * float(np.sqrt(70.0)))
