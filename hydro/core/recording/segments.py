"""Segments: uninterrupted runs of rows of one session, sampled at one constant rate.

A step above 1.5 sample times is a gap and starts a new segment; every other step may differ from the sample
time by 1 %.  Filters, lags and differences never reach across the end of a segment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import Array, Rows
from hydro.core.errors import DataError

GAP = 1.5  # in sample times
JITTER = 0.01  # of a sample time
STEPS = (1e-5, 10.0)
"""Plausible sample times of a recording of motion [s]; beyond them, t is in another unit."""


def sample_time(frame: pl.DataFrame) -> float:
    """Return the sample time dt [s]: the median step of `t` within sessions, rounded to a nanosecond.

    Args:
        frame: A table with `session` and `t` [s].

    Raises:
        DataError: The table is empty, a session's rows are scattered or its time does not ascend, no session
            has two rows, or the time is not in seconds.
    """
    return _clock(frame)[2]


def sessions(frame: pl.DataFrame) -> pl.DataFrame:
    """Return a table of the sessions of a recording, in order.

    Args:
        frame: A table with `session` and `t` [s].

    Returns:
        Columns `session`, `rows` and `sample_time` [s]; the last is that of the whole recording.

    Raises:
        DataError: The table is empty, a session's rows are scattered or its time does not ascend, no session
            has two rows, or the time is not in seconds.
    """
    listed = frame.group_by("session", maintain_order=True).agg(rows=pl.len().cast(pl.Int64))
    return listed.with_columns(sample_time=pl.lit(sample_time(frame)))


class Clock(NamedTuple):
    """Clock of the rows of a recording: number of rows, sample time and segments without gaps.

    Attributes:
        rows: Number of rows.
        dt: Sample time [s].
        bounds: First row of each segment and the row after its last, shape (S, 2).
    """

    rows: int
    dt: float
    bounds: Rows


def clock(frame: pl.DataFrame) -> Clock:
    """Return the clock of one session, or of a whole recording: number of rows, sample time and segments.

    Args:
        frame: A table with `session` and `t` [s].

    Raises:
        DataError: The table is empty, time does not ascend or is not in seconds, or a step is neither the
            sample time within 1 % nor a gap.
    """
    return Clock(frame.height, sample_time(frame), segments(frame))


def common_sample_time(clocks: Mapping[str, Clock]) -> float:
    """Return the median of the sample times of separate sessions [s].

    Args:
        clocks: Clock of each session, by its name.

    Raises:
        DataError: The sample time of a session differs from the median by more than 1 %.
    """
    each = np.array([clock.dt for clock in clocks.values()])
    dt = float(np.sort(each)[len(each) // 2])
    odd = np.flatnonzero(np.abs(each - dt) > JITTER * dt)
    if odd.size:
        first = f"{list(clocks)[odd[0]]}, every {each[odd[0]]:g} s"
        raise DataError(
            f"{odd.size} of {len(each)} sessions are not sampled every {dt:g} s (first: {first}): resample "
            "them to one rate, or keep each rate in a folder of its own"
        )
    return dt


def segments(frame: pl.DataFrame) -> Rows:
    """Return the first row of each segment and the row after its last, shape (S, 2), in row order.

    Args:
        frame: A table with `session` and `t` [s].

    Raises:
        DataError: The table is empty, time does not ascend or is not in seconds, or a step is neither the
            sample time within 1 % nor a gap.
    """
    sessions, steps, dt = _clock(frame)
    gap = steps > GAP * dt
    odd = ~sessions & ~gap & (np.abs(steps - dt) > JITTER * dt)
    if odd.any():
        row = int(np.flatnonzero(odd)[0]) + 1
        raise DataError(
            f"t [s] must step by {dt:g} s within 1 %, or by a gap above {GAP:g} times that: {odd.sum()} of "
            f"{frame.height} rows do not (first: {_place(frame, row)}, step {steps[row - 1]:g} s); "
            "resample the log to one constant rate, as `hydro import` does"
        )
    cuts = np.flatnonzero(sessions | gap) + 1
    edges = np.concatenate(([0], cuts, [frame.height]))
    return np.ascontiguousarray(np.stack([edges[:-1], edges[1:]], axis=1), dtype=np.int64)


def resumes(frame: pl.DataFrame, bounds: Rows) -> NDArray[np.bool_]:
    """Return a mask, (S,), of the segments that continue a session after a gap.

    False: the segment starts one.

    Args:
        frame: A table with `session`.
        bounds: First row of each segment and the row after its last, (S, 2).
    """
    names = frame["session"]
    first, before = bounds[:, 0], np.maximum(bounds[:, 0] - 1, 0)
    same = (names.gather(first) == names.gather(before)).to_numpy()
    return np.asarray(same & (first > 0))


def require_samples(raw: pl.DataFrame, columns: Sequence[str]) -> None:
    """Raise an error if any of the given columns of a raw table has a row without a sample.

    Args:
        raw: Raw table.
        columns: Columns that must have a sample in every row.

    Raises:
        DataError: One of the columns has nulls.
    """
    rare = [name for name in columns if name in raw.columns and raw[name].null_count()]
    if rare:
        counts = ", ".join(f"{name} {raw.height - raw[name].null_count():,}" for name in rare)
        raise DataError(
            f"this needs the whole motion in every row, but of {raw.height:,} rows samples are in: {counts}; "
            "import the log with `hydro import --fill`, which draws lines between them"
        )


def gaps(frame: pl.DataFrame) -> str:
    """Return one sentence with the number of gaps in time and the first one's place; empty text without gaps.

    Args:
        frame: A table with `session` and `t` [s].

    Raises:
        DataError: The table is empty, time does not ascend or is not in seconds, or a step is neither the
            sample time within 1 % nor a gap.
    """
    bounds = segments(frame)
    after = bounds[resumes(frame, bounds), 0]
    if not after.size:
        return ""
    row = int(after[0])
    before, then = frame["t"].cast(pl.Float64).gather([row - 1, row])
    return (
        f"{after.size} {'gap' if after.size == 1 else 'gaps'} in t, each begins a new segment "
        f"(first: {_place(frame, row)}, from {before:.10g} to {then:.10g} s)"
    )


def _clock(frame: pl.DataFrame) -> tuple[NDArray[np.bool_], Array, float]:
    """Return for each step between rows whether the session changes and its length [s]; and dt [s]."""
    if frame.height == 0:
        raise DataError("the table has no rows; give at least one session")
    names = frame["session"]
    changes = (names != names.shift(1))[1:].to_numpy()
    steps = np.diff(frame["t"].to_numpy().astype(np.float64, copy=False))
    _check_contiguous(names, changes)
    _check_rising(frame, changes, steps)
    within = steps[~changes]
    if within.size == 0:
        raise DataError("no session has two rows: the sample time is unknown; give sessions, not single rows")
    dt = round(float(np.median(within)), 9)
    if not STEPS[0] <= dt <= STEPS[1]:
        raise DataError(
            f"t [s] steps by {dt:g} s: no motion is seen in steps beyond {STEPS[0]:g} to {STEPS[1]:g} s; "
            "is t in seconds?"
        )
    return changes, steps, dt


def _check_contiguous(names: pl.Series, changes: NDArray[np.bool_]) -> None:
    starts = names.gather(np.concatenate(([0], np.flatnonzero(changes) + 1)))
    scattered = starts.filter(starts.is_duplicated())
    if scattered.len():
        raise DataError(
            f"session {scattered[0]} is not one run of rows: rows of another session lie between; "
            "sort the table by session and t"
        )


def _check_rising(frame: pl.DataFrame, changes: NDArray[np.bool_], steps: Array) -> None:
    falling = ~changes & ~(steps > 0.0)
    if falling.any():
        row = int(np.flatnonzero(falling)[0]) + 1
        raise DataError(
            f"t [s] must rise within a session: {falling.sum()} of {frame.height} rows do not "
            f"(first: {_place(frame, row)}); remove repeated rows or sort them by time"
        )


def _place(frame: pl.DataFrame, row: int) -> str:
    return f"row {row}, session {frame['session'][row]}"
