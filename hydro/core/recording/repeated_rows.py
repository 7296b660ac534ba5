"""Detection of rows that repeat the row before in every channel because the logger received nothing new.

A sensor slower than the log repeats too, but at a fixed rate, so the number of repeats in a stretch hardly
varies.  The number of rows lost at random varies as expected for random events.
"""

from __future__ import annotations

import numpy as np
import polars as pl

from hydro.core.columns import COMMAND, POSE, VELOCITY, Array, Mask
from hydro.core.recording.arrays import Recording

LEAST, MOST = 20, 0.5
"""Minimum number of such rows, and maximum share of the log, for lost rows."""
AT_CHANCE = 0.4
"""Minimum variance of their number in a stretch, relative to random loss."""
STRETCH = 3  # mean number of repeats in a stretch
LONGEST = 10  # rows; a longer standstill is a frozen sensor or a vehicle at rest
ALIVE = 0.9
"""Minimum share of the other rows in which at least one channel has a distinct value."""


def repeated_rows(record: Recording) -> Mask:
    """Return a mask of the rows, (N,), that repeat the row before because the logger received nothing new.

    The mask is false everywhere if the repeats are as regular as those of a slow sensor.
    """
    motion, none = np.hstack([record.eta, record.nu]), np.zeros(record.rows, bool)
    same, repeated = (np.diff(motion, axis=0) == 0.0).all(axis=1), none.copy()
    for start, stop in record.segments:
        edges = np.flatnonzero(np.diff(same[start : stop - 1], prepend=False, append=False))
        for begin, end in edges.reshape(-1, 2):
            repeated[start + 1 + begin : start + 1 + end] = end - begin < LONGEST
    share = float(np.mean(repeated))
    if repeated.sum() < LEAST or share > MOST or not _alive(motion[~repeated]):
        return none
    stretch = round(STRETCH / share)
    counts = repeated[: len(repeated) // stretch * stretch].reshape(-1, stretch).sum(axis=1)
    return repeated if np.var(counts) > AT_CHANCE * stretch * share * (1.0 - share) else none


def without_repeats(raw: pl.DataFrame, record: Recording, repeated: Mask) -> pl.DataFrame:
    """Return a copy of a raw table with nulls for pose and velocity in repeated rows.

    If the commands repeat in the same rows, they are interpolated, since repeated commands would be late.

    Args:
        raw: Raw table of N rows.
        record: The table as arrays.
        repeated: Mask of the rows that repeat the row before, (N,), from `repeated_rows`.
    """
    columns = [pl.when(pl.Series(~repeated)).then(pl.col(name)).alias(name) for name in (*POSE, *VELOCITY)]
    names = [name for name in raw.columns if name.startswith(COMMAND)]
    commands = raw.select(names).to_numpy()
    if _held(commands, record, repeated):
        raw = raw.with_columns(
            pl.Series(n, _along(record, repeated, c)) for n, c in zip(names, commands.T, strict=True)
        )
    return raw.with_columns(columns)


def _held(commands: Array, record: Recording, repeated: Mask) -> bool:
    """Return whether commands (N, n) are repeated together with the motion, and hardly ever elsewhere."""
    same = np.append(False, (np.diff(commands, axis=0) == 0.0).all(axis=1))
    same[record.segments[:, 0]] = False
    return bool(same[repeated].all() and same[~repeated].mean() <= 1.0 - ALIVE)


def _along(record: Recording, repeated: Mask, column: Array) -> Array:
    """Return a column (N,) with repeated rows interpolated between the others of their segment."""
    out = column.copy()
    for start, stop in record.segments:
        rows, again = np.arange(stop - start), repeated[start:stop]
        out[start:stop][again] = np.interp(rows[again], rows[~again], column[start:stop][~again])
    return out


def _alive(fresh: Array) -> bool:
    """Return whether a channel has distinct values in nearly every row; quantised channels repeat anyway."""
    return any(len(np.unique(values)) >= ALIVE * len(values) for values in fresh.T)
