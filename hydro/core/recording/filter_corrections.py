"""Positions and angles of a filter that predicts between its sensor's samples and is corrected at each.

No vehicle changes its position at once.  A filter does: it predicts row by row, and where a sample comes it
moves by a part of what it was off.  What it writes between two corrections is its own model, no measurement.
Taken for one, its smooth rows would pass for a sensor without noise, and its steps for speeds of many m/s.
So only the rows right after the corrections are kept as samples.
"""

from __future__ import annotations

import numpy as np
import polars as pl

from hydro.core.columns import POSE, Array, Mask
from hydro.core.recording.arrays import LEAST_NOISE, Recording, samples
from hydro.core.recording.jumps import is_sparse

STEP = 20.0
"""Robust standard deviations of the change from row to row from which a change is a step: noise makes none in
1e80 rows, and a hull at 50 Hz changes its speed by a few per cent from row to row."""
AROUND = 5
"""Rows whose median change a change is held against."""
ALONE = 5.0
"""Times the changes of the NEAR rows to either side that a step must be: a quick motion changes them all."""
STAYS = 0.5
"""Part of a step that must be there NEAR rows before and after: an outlier comes and goes."""
NEAR = 3
LEAST_STEPS = 20
LONGEST = 1.0
"""Median time between steps up to which their rows suffice as samples [s]: hulls respond in 0.1 to 1."""
ALIKE = 0.05
"""Share of equal neighbours from which a channel is held or reads in steps of its own."""


def filter_corrections(record: Recording) -> dict[str, Mask]:
    """Return the rows right after a filter's corrections, of each position and angle that has them, (N,).

    Args:
        record: The recording.  Channels without a sample in every row are left alone, and so are all of a log
            that is too sparse to tell a step from a quick motion.
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
    """Return the table without what a filter predicted between its corrections."""
    return raw.with_columns(
        pl.when(pl.Series(after)).then(pl.col(name)).alias(name) for name, after in corrected.items()
    )


def _steps(parts: list[Array]) -> list[Mask]:
    """Return which changes from row to row are steps that stay, (n - 1,) of each part."""
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
    """Return the least difference of two values: the unit of a sensor that rounds, else next to nothing."""
    apart = np.diff(np.unique(values))
    apart = apart[apart > LEAST_NOISE]
    return float(apart.min()) if apart.size else 0.0


def _around(size: Array) -> Array:
    """Return the greatest of the NEAR sizes to either side of each, without itself."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(size, NEAR), 2 * NEAR + 1)
    around: Array = np.delete(windows, NEAR, axis=1).max(axis=1)
    return around


def _running_median(change: Array) -> Array:
    """Return the median of the changes around each, at the ends of those there are."""
    around = np.pad(change, AROUND // 2, mode="edge")
    if len(around) < AROUND:
        return change
    median: Array = np.median(np.lib.stride_tricks.sliding_window_view(around, AROUND), axis=1)
    return median


def _stayed(part: Array, change: Array) -> Array:
    """Return what is left of each change from NEAR rows before and to NEAR rows after it, the lesser of both.

    The way that the rows go on is taken off.
    """
    rows, last, on = np.arange(len(change)), len(part) - 1, (NEAR + 1) * _running_median(change)
    to = part[np.minimum(rows + 1 + NEAR, last)] - part[:-1] - on
    since = part[1:] - part[np.maximum(rows - NEAR, 0)] - on
    lesser: Array = np.where(np.abs(to) < np.abs(since), to, since)
    return lesser
