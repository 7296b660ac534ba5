"""Rows that repeat the last one in every channel: the logger got nothing new, and wrote what it had.

A sensor slower than the log, or all of them, repeats too, but at a rate: how many fall into a stretch hardly
varies.  Rows that are lost at chance vary as chance does.
"""

from __future__ import annotations

import numpy as np
import polars as pl

from hydro.core.columns import COMMAND, POSE, VELOCITY, Array, Mask
from hydro.core.recording.arrays import Recording

LEAST, MOST = 20, 0.5
"""Number of such rows, and part of the log up to which, to be lost ones."""
AT_CHANCE = 0.4
"""Variance of their number in a stretch, over that of rows lost at chance."""
STRETCH = 3  # of them, in the mean
LONGEST = 10  # rows; what stands still for longer is a frozen sensor or a vehicle at rest
ALIVE = 0.9
"""Part of the other rows in which one channel at least must take a value of its own."""


def repeated_rows(record: Recording) -> Mask:
    """Rows that repeat the last one for want of anything new, (N,)."""
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
    """The table without samples of pose and velocity in repeated rows.

    Commands that are repeated as well go on a straight line: left as they are, all would come late.

    Args:
        raw: Raw table.
        record: The same as arrays.
        repeated: Rows that repeat the last one, (N,).
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
    """Whether commands (N, n) are repeated with the motion: there always, elsewhere hardly ever."""
    same = np.append(False, (np.diff(commands, axis=0) == 0.0).all(axis=1))
    same[record.segments[:, 0]] = False
    return bool(same[repeated].all() and same[~repeated].mean() <= 1.0 - ALIVE)


def _along(record: Recording, repeated: Mask, column: Array) -> Array:
    """A column (N,) with repeated rows on a straight line between the others of their segment."""
    out = column.copy()
    for start, stop in record.segments:
        rows, again = np.arange(stop - start), repeated[start:stop]
        out[start:stop][again] = np.interp(rows[again], rows[~again], column[start:stop][~again])
    return out


def _alive(fresh: Array) -> bool:
    """Whether a channel has a value of its own in nearly every row; coarse steps repeat anyway."""
    return any(len(np.unique(values)) >= ALIVE * len(values) for values in fresh.T)
