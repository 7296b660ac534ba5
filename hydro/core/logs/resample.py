"""Resampling of a log's channels to one clock, each from its own samples and never across a gap.

A channel holds the times and values of one column, without its empty cells, so that sensors of different
rates can share a table.  A silence longer than a channel's longest step is a gap.  Rows exist only where
every channel has data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.errors import DataError

USUAL_STEPS = 5.0
"""Number of median steps above which a channel's silence is a gap, unless the map sets it."""
ROUND = 0.01
"""Relative distance within which a rate is rounded to a whole number: clocks jitter and drift."""
HELD_EARLY = 0.01
"""Share of a sample time by which a command may follow its row: times are rounded."""


@dataclass(frozen=True)
class Channel:
    """Samples of one quantity.

    Attributes:
        t: Times [s], shape (n,), strictly rising.
        values: Values of the samples, (n,), finite.
    """

    t: Array
    values: Array

    @property
    def step(self) -> float:
        """Median time between samples [s]; infinite for fewer than two samples."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf


def channel(t: Array, values: Array) -> Channel:
    """Return the samples of a column: its cells with a number, of equal times only the first.

    Args:
        t: Times [s], shape (n,), not falling.
        values: Cells of the column, shape (n,), NaN where a cell is empty.
    """
    there = np.isfinite(values)
    if not there.all():
        t, values = t[there], values[there]
    new = t[1:] > t[:-1]
    if not new.all():
        new = np.r_[True, new]
        t, values = t[new], values[new]
    return Channel(t, values)


def sample_time(steps: Sequence[float]) -> float:
    """Return the sample time that suits most channels [s]: the lower median of their median steps.

    A value near a whole number of rows per second is rounded to that number.

    Args:
        steps: Median step of each channel [s]; infinite for fewer than two samples.

    Raises:
        DataError: No channel has two samples.
    """
    steps = sorted(step for step in steps if np.isfinite(step))
    if not steps:
        raise DataError("no column has two samples in one session: the rate is unknown; give longer sessions")
    dt = steps[(len(steps) - 1) // 2]
    whole = round(1.0 / dt)
    return 1.0 / whole if whole and abs(whole * dt - 1.0) < ROUND else round(dt, 9)


def spans(each: Channel, longest: float | None = None) -> Array:
    """Return the first and last time of each uninterrupted span of a channel, shape (k, 2) [s].

    Args:
        each: The channel.
        longest: Longest step within a span [s]; by default five median steps of this channel.
    """
    if not len(each.t):
        return np.empty((0, 2))
    limit = longest if longest is not None else USUAL_STEPS * each.step
    cuts = np.flatnonzero(np.diff(each.t) > limit)
    return np.stack([each.t[np.r_[0, cuts + 1]], each.t[np.r_[cuts, len(each.t) - 1]]], axis=1)


def common(stretches: Sequence[Array]) -> Array:
    """Return the first and last time of each span in which all channels have data, ascending, (k, 2) [s].

    Args:
        stretches: For each channel, first and last time of each of its spans, from `spans`.
    """
    shared = stretches[0]
    for other in stretches[1:]:
        start = np.maximum(shared[:, None, 0], other[None, :, 0])
        stop = np.minimum(shared[:, None, 1], other[None, :, 1])
        shared = np.stack([start, stop], axis=-1)[stop >= start]
    return shared[np.argsort(shared[:, 0])]


def rows(shared: Array, dt: float) -> Array:
    """Return the times of a session's rows [s]: multiples of `dt` from the first common time, within spans.

    All spans share one grid, so a step is either `dt` or a gap of a whole number of rows.  A span with a
    single row is dropped, because it carries no information on the motion.

    Args:
        shared: First and last time of each span in which all channels have data [s], (k, 2).
        dt: Sample time [s].
    """
    if not len(shared):
        return np.empty(0)
    start, slack = shared[0, 0], 1e-6 * dt
    kept = []
    for first, last in shared:
        begin = int(np.ceil((first - start - slack) / dt))
        end = int(np.floor((last - start + slack) / dt))
        if end > begin:
            kept.append(np.arange(begin, end + 1))
    steps: NDArray[np.int64] = np.sort(np.concatenate(kept)) if kept else np.empty(0, np.int64)
    steps = steps[np.diff(steps, prepend=steps[:1] - 1) > 0]
    return np.asarray(start + steps * dt, np.float64)


def interpolated(each: Channel, at: Array) -> Array:
    """Return the values of a channel at times `at` [s], interpolated linearly, in the shape of `at`."""
    return np.interp(at, each.t, each.values)


def held(each: Channel, at: Array, dt: float) -> Array:
    """Return the last value at or before each time (zero-order hold), an array like `at`.

    Args:
        each: The channel; its first sample is not later than the first of `at`.
        at: Times [s].
        dt: Sample time [s]; a value up to a hundredth of it later than a time still counts.
    """
    latest = np.searchsorted(each.t, at + HELD_EARLY * dt, side="right") - 1
    return np.asarray(each.values[np.maximum(latest, 0)])


def averaged(each: Channel, at: Array, dt: float) -> Array:
    """Return the mean of the held values over [t, t + dt) at each time t, an array like `at`.

    A row's command acts until the next row.  A command shortly after the row's time, due to jitter, would be
    a whole row late if sampled at that time alone.  The mean preserves the impulse of the thrust.

    Args:
        each: The channel; its first sample is not later than the first of `at`.
        at: Times [s].
        dt: Sample time [s]; a value up to a hundredth of it later than a time still counts.
    """
    out, slack = held(each, at, dt), HELD_EARLY * dt
    first = np.searchsorted(each.t, at + slack, side="right")
    inside = np.searchsorted(each.t, at + dt - slack, side="left") > first
    sums = np.concatenate([[0.0], np.cumsum(np.diff(each.t) * each.values[:-1])])

    def integral(t: Array) -> Array:
        sample = np.maximum(np.searchsorted(each.t, t, side="right") - 1, 0)
        return np.asarray(sums[sample] + (t - each.t[sample]) * each.values[sample])

    begin = np.maximum(at[inside], each.t[0])
    out[inside] = (integral(at[inside] + dt) - integral(begin)) / (at[inside] + dt - begin)
    return out


def unwrapped(each: Channel, period: float) -> Channel:
    """Return a copy of an angle's channel without jumps by a whole turn.

    Args:
        each: The channel.
        period: A whole turn in the channel's unit.
    """
    return Channel(each.t, np.unwrap(each.values, period=period))


def same_sign(quaternions: Sequence[Channel]) -> list[Channel]:
    """Return the four channels of a quaternion at their common times, without jumps from q to -q.

    Both are the same rotation, but an interpolated value between q and -q is not a rotation.
    """
    shared = quaternions[0].t
    if not all(np.array_equal(shared, other.t) for other in quaternions[1:]):
        for other in quaternions[1:]:
            shared = np.intersect1d(shared, other.t)
        quaternions = [Channel(shared, each.values[np.isin(each.t, shared)]) for each in quaternions]
    cosines = np.zeros(max(len(shared) - 1, 0))
    for each in quaternions:
        cosines += each.values[1:] * each.values[:-1]
    turned = cosines < 0.0
    if not turned.any():
        return list(quaternions)
    signs = np.concatenate(([1.0], np.cumprod(np.where(turned, -1.0, 1.0))))
    return [Channel(shared, signs * each.values) for each in quaternions]
