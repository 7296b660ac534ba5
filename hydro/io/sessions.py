"""Sessions of a log: their rows and times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask, Rows
from hydro.core.errors import DataError
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.logmap import (
    LogMap,
    Time,
    beside,
    blocks_of,
    columns_of,
    command,
    measured,
    named,
    sensors_of,
)
from hydro.io.files import shown
from hydro.io.log import NOT_A_NUMBER, Log, column, numbers, refuse, require, stripped, unset
from hydro.io.readers.tables import CLOCKS, TIME, Numbers, Table, Tables

A_DAY = 86400.0
"""Pause or jump of a clock after which a new session begins in any case [s]; no dive has such a pause."""
LEAST_ROWS = 20
"""Minimum number of rows between falls of the clock for each stretch to be a session."""
_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9, "iso": 1e9}


@dataclass(frozen=True)
class _Part:
    """Rows of a table that belong to one session.

    Attributes:
        name: Name of the session.
        t: Times since the start of the session [s], (n,).
        rows: Indices of the rows in the table, (n,).
        cut: Reason for the preceding cut of the session.
        repeated: Number of rows that were left out because they repeat the row before.
    """

    name: str
    t: Array
    rows: Rows
    cut: str
    repeated: int


def sessions(log: Log, meaning: LogMap) -> list[SessionLog]:
    """Return the sessions of a log in order of start, with the numeric columns that the map names.

    Args:
        log: The log.
        meaning: Map of its columns.

    Raises:
        DataError: A column is missing or is not numeric, or time goes backwards.
    """
    plain = meaning.time.column == TIME and meaning.time.unit != "iso" and meaning.session.column is None
    if isinstance(log.table, Tables) and plain:
        return _topic_sessions(log, log.table, meaning)
    columns = {name: numbers(log, name, where) for where, name in named_columns(meaning)}
    ticks, rows, per_second = clock(log, meaning.time)
    if not len(rows):
        raise DataError(f"{log.name}: column {shown(meaning.time.column)} holds no time: set time.column")
    parts = list(_labelled_sessions(log, meaning, ticks, rows, per_second, columns))
    owned: list[dict[str, Array]] = [{} for _ in parts]
    for key in list(columns):
        values = columns.pop(key)  # so that no column of a long log is held twice for longer than this
        for own, part in zip(owned, parts, strict=True):
            own[key] = values[part.rows]
    none = {name: said for name in _command_columns(meaning) if (said := unset(log, name)).any()}
    silent = [{name: said[part.rows] for name, said in none.items()} for part in parts]
    return [
        SessionLog(part.name, part.t, own, unset=off, cut=part.cut, repeated=part.repeated)
        for own, part, off in zip(owned, parts, silent, strict=True)
    ]


def _topic_sessions(log: Log, tables: Tables, meaning: LogMap) -> list[SessionLog]:
    """Return the sessions of messages on one clock; columns of a sensor share rows and are read on demand."""
    for where, name in named_columns(meaning):
        require(log, name, where)
        if name in CLOCKS:
            raise DataError(
                f"{log.name}: {where} names {name}, which is the log's clock: name a measured column there"
            )
    every = tables.times()
    if not len(every):
        raise DataError(f"{log.name}: column {shown(meaning.time.column)} holds no time: set time.column")
    per_second = _PER_SECOND[meaning.time.unit]
    t = (every - every[0]) / per_second
    starts = np.union1d(_starts(t, meaning), np.searchsorted(every, tables.begins))
    names = _titles(meaning.session.name or "log", len(starts))
    begun, limits = t[starts], [*every[starts].tolist(), np.inf]
    clocks: list[dict[str, Array]] = [{} for _ in names]
    owned: list[dict[str, tuple[Table, int, int]]] = [{} for _ in names]
    for table, columns in tables.together(_sensor_columns(meaning)):
        own = (table.time - every[0]) / per_second
        edges = np.searchsorted(table.time, limits).tolist()
        for number, (start, stop) in enumerate(pairwise(edges)):
            clocks[number] |= dict.fromkeys(columns, own[start:stop] - begun[number])
            owned[number] |= dict.fromkeys(columns, (table, start, stop))
    cuts = ["", *(_jump(float(t[k] - t[k - 1])) for k in starts[1:].tolist())]
    silent = [
        {name: own[name][0].unset(name, *own[name][1:]) for name in _command_columns(meaning)}
        for own in owned
    ]
    parts = zip(names, owned, clocks, silent, cuts, strict=True)
    return [
        SessionLog(name, np.empty(0), Numbers(own), clock, off, cut) for name, own, clock, off, cut in parts
    ]


def _command_columns(meaning: LogMap) -> list[str]:
    """Return the columns of the commands."""
    return columns_of(meaning.commands)


def _sensor_columns(meaning: LogMap) -> list[list[str]]:
    """Return the columns of each sensor that are read row by row: values and conditions of validity."""
    return [[*columns_of(block), *beside(block)] for block in sensors_of(meaning).values()]


def named_columns(meaning: LogMap) -> Iterator[tuple[str, str]]:
    """Yield every numeric column that a map names, as a pair of block (`velocity`) and column."""
    for where, block in blocks_of(meaning).items():
        yield from ((where, source.column) for source in measured(block))
        yield from ((where, name) for name in beside(block))
    yield from (("commands", command(source).column) for source in meaning.commands.columns)
    yield from (("commands", name) for name in beside(meaning.commands))
    if meaning.voltage is not None:
        yield from (
            ("voltage", name) for name in (named(meaning.voltage.column).column, *beside(meaning.voltage))
        )


def clock(log: Log, time: Time) -> tuple[NDArray[Any], Rows, float]:
    """Return the times of a log as integers or floats, in ticks of its clock.

    Integers stay integers: nanoseconds since 1970 have more digits than a double.

    Args:
        log: The log.
        time: Column and unit of the time, from the map.

    Returns:
        Ticks of the n rows with a time (n,), the indices of these rows (n,), and the ticks per second.
    """
    values, per_second = column(log, time.column, "time.column"), _PER_SECOND[time.unit]
    if isinstance(values.dtype, pl.Duration):
        values, per_second = values.dt.total_nanoseconds(), _PER_SECOND["ns"]
    elif values.dtype.is_temporal() or time.unit == "iso":
        values, per_second = _timestamps(log, time.column, values), _PER_SECOND["ns"]
    elif values.dtype == pl.String:
        text = stripped(values)
        whole = text.cast(pl.Int64, strict=False)
        values = whole if whole.null_count() == text.null_count() else text.cast(pl.Float64, strict=False)
        remedy = 'correct the log, or set time.unit to "iso" if these are timestamps'
        refuse(log, time.column, text, values, "numbers", remedy)
    if values.dtype.is_float():
        values = values.fill_nan(None)
    rows = values.is_not_null().arg_true().to_numpy().astype(np.int64)
    return values.drop_nulls().to_numpy(), rows, per_second


def _timestamps(log: Log, name: str, values: pl.Series) -> pl.Series:
    """Return the times of a column of ISO texts or timestamps in nanoseconds since 1970."""
    if values.dtype == pl.String:
        text = stripped(values)
        text = text.set(text.is_in(NOT_A_NUMBER), None)
        zoned = text.str.replace("T", " ", literal=True).str.replace(r"[Zz]$", "+00:00")
        zoned = zoned.str.replace(r":(\d\d),(\d)", ":$1.$2")
        zoned = zoned.str.replace(r"([+-]\d\d):(\d\d)$", "$1$2")
        plain = zoned.str.contains(r"[+-]\d\d\d\d$").fill_null(True)
        universal = zoned.zip_with(plain, zoned + "+0000")
        values = universal.str.to_datetime("%Y-%m-%d %H:%M:%S%.f%z", time_unit="ns", strict=False)
        example = "ISO timestamps such as 2025-06-01T12:00:00.25Z"
        refuse(log, name, text, values, example, "correct the log or set time.unit")
    elif not isinstance(values.dtype, pl.Datetime):
        raise DataError(f"{log.name}: column {shown(name)} is {values.dtype}, not timestamps: set time.unit")
    return values.dt.epoch("ns")


def _labelled_sessions(
    log: Log,
    meaning: LogMap,
    ticks: NDArray[Any],
    rows: Rows,
    per_second: float,
    columns: Mapping[str, Array],
) -> Iterator[_Part]:
    """Yield the rows of each session.

    Args:
        log: The log.
        meaning: Map of the log.
        ticks: Times of the rows, in ticks of the clock (n,).
        rows: Indices of the rows with a time (n,).
        per_second: Ticks per second.
        columns: Numeric columns by name.
    """
    for name, members in _labelled(log, meaning, rows):
        t = (ticks[members] - ticks[members[0]]) / per_second
        again = _restarts(t, rows[members], columns)
        if not len(again):
            _check_order(log, meaning.time.column, name, t, rows[members])
        starts = np.union1d(_starts(t, meaning), again)
        pieces = np.split(np.arange(len(t)), starts[1:])
        for title, piece in zip(_titles(name, len(pieces)), pieces, strict=True):
            cut = _jump(float(t[piece[0]] - t[piece[0] - 1])) if piece[0] else ""
            own, taken = t[piece] - t[piece[0]], rows[members[piece]]
            repeats = _repeats(own, taken, columns)
            yield _Part(title, own[~repeats], taken[~repeats], cut, int(repeats.sum()))


def _repeats(t: Array, rows: Rows, columns: Mapping[str, Array]) -> Mask:
    """Return the rows that repeat the row before with its time (n,), as a recorder that writes twice does.

    There are none if any two rows with one time differ: these are messages of several sensors, or a clock
    with coarse ticks.

    Args:
        t: Times of the rows (n,) [s].
        rows: Indices of the rows (n,) in the columns.
        columns: Numeric columns by name.
    """
    same = np.r_[False, np.diff(t) == 0.0]
    now, last = rows[same], rows[np.flatnonzero(same) - 1]
    filled = np.zeros(len(now), bool)
    for values in columns.values():
        if not np.array_equal(values[now], values[last], equal_nan=True):
            return np.zeros(len(t), bool)
        filled |= np.isfinite(values[now])
    return same if filled.all() else np.zeros(len(t), bool)


def _restarts(t: Array, rows: Rows, columns: Mapping[str, Array]) -> Rows:
    """Return the rows where a clock restarts: each fall of time, if the parts between are alike.

    Parts of a few rows belong to an unsorted log.  Parts with different columns are several sensors one after
    another, to be sorted by time.
    """
    falls = np.flatnonzero(np.diff(t) < 0.0) + 1
    pieces = np.split(rows, falls)
    if not len(falls) or min(map(len, pieces)) < LEAST_ROWS:
        return np.empty(0, np.int64)
    held = [{name for name, values in columns.items() if np.isfinite(values[own]).any()} for own in pieces]
    return falls if all(each == held[0] for each in held) else np.empty(0, np.int64)


def _starts(t: Array, meaning: LogMap) -> Rows:
    """Return the indices at which sessions begin: the first, and after each pause longer than allowed.

    Args:
        t: Times of a log (n,) [s].
        meaning: Map of the log, with the longest pause within a session.
    """
    longest = min(meaning.session.gap or np.inf, A_DAY)
    found: Rows = np.r_[0, np.flatnonzero(np.diff(t) > longest) + 1]
    return found


def _jump(step: float) -> str:
    """Return the reason, in words, for a session that begins `step` [s] after the row before."""
    if step < 0.0:
        return f"the clock goes back by {-step:.4g} s and begins again"
    if step > A_DAY:
        return f"the clock jumps forward by {step / A_DAY:,.1f} days"
    return ""


def _titles(name: str, count: int) -> list[str]:
    """Return the names of `count` sessions with one label: the label itself, or numbered."""
    return [f"{name}-{number}" for number in range(1, count + 1)] if count > 1 else [name]


def _labelled(log: Log, meaning: LogMap, rows: Rows) -> Iterator[tuple[str, Rows]]:
    """Yield name and members of each labelled session, as indices into `rows`, in order of start."""
    if meaning.session.column is None:
        yield meaning.session.name or "log", np.arange(len(rows))
        return
    values = column(log, meaning.session.column, "session.column").cast(pl.String).gather(rows)
    unnamed = values.is_null() | values.is_in(["", *NOT_A_NUMBER])
    if unnamed.any():
        first = log.row(int(rows[unnamed.arg_true()[0]]))
        raise DataError(
            f"{log.name}: column {shown(meaning.session.column)} names no session in {unnamed.sum()} of "
            f"{len(values)} rows (first: {first}): fill it or drop these rows"
        )
    for name in values.unique(maintain_order=True):
        yield name, (values == name).arg_true().to_numpy().astype(np.int64)


def _check_order(log: Log, name: str, session: str, t: Array, rows: Rows) -> None:
    """Check that the time of a session does not fall; repeated times are messages of several sensors."""
    back = np.flatnonzero(np.diff(t) < 0.0) + 1
    if len(back):
        first, by = log.row(int(rows[back[0]])), t[back[0] - 1] - t[back[0]]
        raise DataError(
            f"{log.name}: column {shown(name)} goes backwards within session {shown(session)} in {len(back)} "
            f"of {len(t)} rows (first: {first}, by {by:g} s): sort the log by time, or name a session.column "
            "that separates its parts"
        )
