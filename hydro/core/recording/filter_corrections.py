"""Detection of channels that hold estimates of a Kalman filter, which jump when the filter gets a sample.

A vehicle's position cannot jump.  A filter's estimate does: at each sample it moves by a part of the
innovation.  Between two corrections it is the prediction of the filter's model, not a measurement.  Used as a
measurement, its smooth rows would look like a sensor without noise, and its steps like speeds of many m/s. So
only the rows right after the corrections are kept as samples.
"""

from __future__ import annotations

import numpy as np
import polars as pl

from hydro.core.columns import POSE, Array, Mask
from hydro.core.recording.arrays import LEAST_NOISE, Recording, samples
from hydro.core.recording.jumps import is_sparse

STEP = 20.0
"""Robust standard deviations of the row-to-row change above which a change is a step.  Noise causes none in
1e80 rows, and a hull at 50 Hz changes its speed by a few per cent between rows."""
AROUND = 5
"""Rows of the running median that a change is compared with."""
ALONE = 5.0
"""Ratio of a step to the changes in NEAR rows on either side: a fast motion changes them all."""
STAYS = 0.5
"""Share of a step that must persist NEAR rows before and after: an outlier returns."""
NEAR = 3
LEAST_STEPS = 20
LONGEST = 1.0
"""Maximum median time between steps for their rows to suffice as samples [s]: hulls respond in 0.1 to 1 s."""
ALIKE = 0.05
"""Share of equal neighbours above which a channel is held or quantised."""


def filter_corrections(record: Recording) -> dict[str, Mask]:
    """Return masks of the rows right after a filter's corrections, for each channel with estimates.

    A filter's correction by a sample shows as a jump of the channel.

    Args:
        record: The recording, with N rows.  Channels with unsampled rows are skipped, and so are all channels
            of a log too sparse to separate a jump from a fast motion.

    Returns:
        Masks, (N,), by name of the pose channel, such as `x`; empty if no channel has such jumps.
    """
    if is_sparse(record.dt):
        return {}
    found = {}
    for i, (name, parts) in enumerate(zip(POSE, samples(record), strict=False)):
        if record.seen is not None and not record.seen[:, i].all():
            continue
        after = np.zeros(record.rows, bool)
        for (start, stop), steps in zip(record.segments, _steps(parts), strict=True):
            after[start + 1 : stop] = steps
        gaps = np.diff(np.flatnonzero(after)) * record.dt
        if after.sum() >= LEAST_STEPS and np.median(gaps) <= LONGEST and np.median(gaps) > 2.0 * record.dt:
            found[name] = after
    return found


def without_predictions(raw: pl.DataFrame, corrected: dict[str, Mask]) -> pl.DataFrame:
    """Return a copy of the table with nulls where a channel holds a filter's predictions between corrections.

    Args:
        raw: Raw table of N rows.
        corrected: Mask of the rows to keep, (N,), by column, from `filter_corrections`.
    """
    return raw.with_columns(
        pl.when(pl.Series(after)).then(pl.col(name)).alias(name) for name, after in corrected.items()
    )


def _steps(parts: list[Array]) -> list[Mask]:
    """Return which row-to-row changes are persistent steps, (n - 1,) of each part."""
    changes = [np.diff(part) for part in parts]
    none = [np.zeros(len(change), bool) for change in changes]
    every = np.concatenate(changes)
    if not every.size or np.mean(every == 0.0) > ALIKE:
        return none
    beyond = [change - _running_median(change) for change in changes]
    usual = max(
        float(np.median(np.abs(np.concatenate(beyond)))) / 0.6745,
        LEAST_NOISE,
        _resolution(np.concatenate(parts)),
    )
    found = []
    for part, change, off in zip(parts, changes, beyond, strict=True):
        size = np.abs(off)
        stays = np.sign(off) * _stayed(part, change) > STAYS * size
        found.append((size > np.maximum(STEP * usual, ALONE * _around(size))) & stays)
    return found


def _resolution(values: Array) -> float:
    """Return the smallest difference of two values: the resolution of a sensor that rounds, else nearly 0."""
    apart = np.diff(np.unique(values))
    apart = apart[apart > LEAST_NOISE]
    return float(apart.min()) if apart.size else 0.0


def _around(size: Array) -> Array:
    """Return the maximum of the NEAR sizes on either side of each, without itself."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(size, NEAR), 2 * NEAR + 1)
    around: Array = np.delete(windows, NEAR, axis=1).max(axis=1)
    return around


def _running_median(change: Array) -> Array:
    """Return the running median of the changes, with repeated ends."""
    around = np.pad(change, AROUND // 2, mode="edge")
    if len(around) < AROUND:
        return change
    median: Array = np.median(np.lib.stride_tricks.sliding_window_view(around, AROUND), axis=1)
    return median


def _stayed(part: Array, change: Array) -> Array:
    """Return the persistent part of each change, between NEAR rows before and after; the smaller one.

    The trend of the rows is subtracted.
    """
    rows, last, on = np.arange(len(change)), len(part) - 1, (NEAR + 1) * _running_median(change)
    to = part[np.minimum(rows + 1 + NEAR, last)] - part[:-1] - on
    since = part[1:] - part[np.maximum(rows - NEAR, 0)] - on
    lesser: Array = np.where(np.abs(to) < np.abs(since), to, since)
    return lesser
