"""One log, with its map, from one or several files of a dive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.guessing.aliases import guess
from hydro.core.guessing.refining import refined
from hydro.core.logs.logmap import LogMap, Session
from hydro.io.files import shown
from hydro.io.joining import joined
from hydro.io.log import Log, LogFile, Reading, together, values
from hydro.io.log_import import declared, guessed, refined_map
from hydro.io.readers.tables import CLOCKS, Tables
from hydro.io.sessions import clock

Progress = Callable[[LogFile], AbstractContextManager[Reading | None]]
"""Context of reading a file; it yields a callback of progress, or None."""
LARGE = 50_000_000
"""Minimum size of a file whose reading shows progress [bytes]."""


def silent(file: LogFile) -> AbstractContextManager[Reading | None]:
    """Return a `with` block that reports no progress while a file is read; it gives None."""
    return nullcontext()


def _headers(files: Sequence[LogFile], progress: Progress) -> list[Log]:
    """Return a log with all columns of each file; see `LogFile.header`."""
    each = []
    for file in files:
        with progress(file) as told:
            each.append(file.header(told))
    return each


def _combined(logs: Sequence[Log]) -> Log:
    """Return the columns of all logs as one log."""
    return together(logs, pl.concat([log.frame for log in logs], how="diagonal_relaxed"))


def gather(
    files: Sequence[LogFile],
    map_: str | Path | LogMap | None,
    progress: Progress = silent,
    preset: str | None = None,
    thrusters: int | None = None,
) -> tuple[Log, LogMap]:
    """Read the files of a dive as one log, and return the log with its map.

    The `[[table]]`s of a map assign the files (see `joining`).  Without them, files whose times overlap are
    merged by time; other files are sessions, named after their files.

    Args:
        files: Files in any order.
        map_: Map, path of a map file, or None to guess the map from the column names.
        progress: Function that takes a file and returns a `with` block, which gets a function that is called
            with the fraction of the file that has been read, or None.
        preset: Naming scheme of the columns for a guess; by default any.
        thrusters: Number of thrusters of the vehicle, for a guess, if known.

    Returns:
        One log with the columns of the map, and the map with a session name.

    Raises:
        DataError: A file cannot be read, or the map is invalid or does not fit it.
    """
    name = files[0].stem
    if map_ is not None:
        return _read(files, declared(map_, name), [], progress)
    headers = _headers(files, progress)
    blocks, meaning = guessed(_combined(headers), name, preset, thrusters)
    log, read = _read(files, meaning, headers, progress)
    found, notes = refined_map(log, blocks, name)
    return replace(log, notes=(*log.notes, *notes)), msgspec.structs.replace(found, session=read.session)


def drafted(
    files: Sequence[LogFile],
    progress: Progress = silent,
    preset: str | None = None,
    thrusters: int | None = None,
) -> tuple[list[str], dict[str, dict[str, Any]]]:
    """Return the columns of files, and the blocks of a map that their names and values suggest.

    Args:
        files: Files in any order.
        progress: Context that reports the progress of each file.
        preset: Naming scheme of the columns for a guess; by default any.
        thrusters: Number of thrusters of the vehicle, if known.

    Returns:
        Names of all columns; and the guessed blocks of the map, such as `velocity`, by name, each with its
        keys and values.

    Raises:
        DataError: A file cannot be read.
    """
    headers = _headers(files, progress)
    known = _combined(headers)
    blocks = guess(known.table.columns, known.texts(), preset, thrusters)
    wanted = {*CLOCKS, *texts_of(blocks)}
    parts = []
    for file, header_ in zip(files, headers, strict=True):
        with progress(file) as told:
            parts.append(header_ if file.reader.messages is None else file.read(wanted, told))
    found, _ = refined(blocks, lambda column: _first_values(parts, column))
    return list(known.table.columns), found


def _first_values(logs: Sequence[Log], column: str) -> Array | None:
    """Return a column as numbers from the first log that has it; None if none does."""
    return next((found for log in logs if (found := values(log, column)) is not None), None)


def _read(
    files: Sequence[LogFile], meaning: LogMap, headers: Sequence[Log], progress: Progress
) -> tuple[Log, LogMap]:
    """Read those columns of files that a map names; return them as one log with its map."""
    words = [*texts_of(msgspec.to_builtins(meaning))]
    wanted = {*CLOCKS, *words, *(word.partition(".")[2] for word in words if meaning.table)}
    logs = []
    for place, file in enumerate(files):
        if headers and file.reader.messages is None:  # a table was read whole for its columns
            logs.append(headers[place])
            continue
        with progress(file) as told:
            logs.append(file.read(wanted, told))
    if meaning.table:
        return joined(logs, meaning)
    if len(logs) == 1:
        return logs[0], meaning
    return merged(logs, [file.stem for file in files], meaning)


def merged(logs: Sequence[Log], names: Sequence[str], meaning: LogMap) -> tuple[Log, LogMap]:
    """Return several logs as one, with one session for each group of logs whose times overlap.

    Args:
        logs: The logs; they are not changed.
        names: Session name of each log.
        meaning: Map of the columns of all logs.

    Returns:
        A new log with all rows in order of time and a column of session names, and a copy of the map that
        names this column.

    Raises:
        DataError: A log has no time, or its time goes backwards.
    """
    try:
        parts = [_timed(log, meaning) for log in logs]
    except DataError as error:
        raise DataError(f"{error}; where files have clocks of their own, give each a [[table]]") from error
    shared = {*CLOCKS, meaning.time.column, meaning.session.column}
    measured = [set(log.table.columns) & {*texts_of(msgspec.to_builtins(meaning))} - shared for log in logs]
    groups = _groups([t for _, t in parts], measured)
    column = "session" if not any("session" in log.table.columns for log in logs) else "session of file"
    rows = []
    for group in groups:
        frame = pl.concat([parts[place][0] for place in group], how="diagonal_relaxed")
        order = np.argsort(np.concatenate([parts[place][1] for place in group]), kind="stable")
        times = np.concatenate([parts[place][1] for place in group])[order]
        title = _title(names, groups, group)
        rows.append(frame[order].with_columns(_numbered(title, times, _restarts(logs, group)).alias(column)))
    frame = pl.concat(rows, how="diagonal_relaxed")
    if meaning.session.column is None:
        session = Session(column=column, gap=meaning.session.gap)
        meaning = msgspec.structs.replace(meaning, session=session)
    return together(logs, frame), meaning


def _restarts(logs: Sequence[Log], group: Sequence[int]) -> Array:
    """Return the times at which a clock restarts in a group of logs [s].

    Args:
        logs: All logs.
        group: Indices of the logs of the group.
    """
    found = [log.table.begins for log in (logs[place] for place in group) if isinstance(log.table, Tables)]
    return np.unique(np.concatenate([np.empty(0), *found]))


def _numbered(title: str, times: Array, begins: Array) -> pl.Series:
    """Return the session name of each row: the title, with a number if a clock restarts.

    Args:
        title: Name of the recording.
        times: Times of the rows (n,) [s].
        begins: Times at which a clock restarts [s].
    """
    if not len(begins):
        return pl.repeat(title, len(times), eager=True)
    titles = [f"{title}-{number}" for number in range(1, len(begins) + 2)]
    return pl.Series(titles).gather(np.searchsorted(begins, times, side="right"))


def texts_of(value: Any) -> Iterator[str]:
    """Yield all texts in nested mappings and sequences, such as the names of columns in a block of a map."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from texts_of(part)
    elif isinstance(value, Sequence):
        for part in value:
            yield from texts_of(part)


def _timed(log: Log, meaning: LogMap) -> tuple[pl.DataFrame, Array]:
    """Return the rows of a log that have a time, and their times [s]."""
    ticks, rows, per_second = clock(log, meaning.time)
    if not len(rows):
        raise DataError(f"{log.name}: column {shown(meaning.time.column)} holds no time: set time.column")
    t = np.asarray(ticks / per_second, np.float64)
    if meaning.session.column is None and (back := np.flatnonzero(np.diff(t) < 0.0)).size:
        raise DataError(
            f"{log.name}: column {shown(meaning.time.column)} goes backwards in {len(back)} of {len(t)} rows "
            f"(first: {log.row(int(rows[back[0] + 1]))}): sort the log by time, or name a session.column"
        )
    return log.frame[rows], t


def _groups(times: Sequence[Array], measured: Sequence[set[str]]) -> list[list[int]]:
    """Group logs that belong to one recording; return indices, sorted by start time.

    Args:
        times: Times of each log [s].
        measured: Columns with measurements of each log.
    """
    spans = [(float(np.min(t)), float(np.max(t))) for t in times]
    groups: list[list[int]] = []
    for place in sorted(range(len(times)), key=lambda place: spans[place]):
        joined = [
            group
            for group in groups
            if any(_same_recording(spans, measured, place, other) for other in group)
        ]
        rest = [group for group in groups if group not in joined]
        groups = [*rest, sorted([place, *(other for group in joined for other in group)])]
    return sorted(groups, key=lambda group: min(spans[place] for place in group))


def _same_recording(
    spans: Sequence[tuple[float, float]], measured: Sequence[set[str]], a: int, b: int
) -> bool:
    """Return whether the logs with indices `a` and `b` belong to one recording.

    Their times must overlap.  Two logs with the same columns are consecutive parts, which overlap only a
    little.  If they overlap completely, they are two runs whose clocks start at 0, and so two recordings.

    Args:
        spans: First and last time of each log [s].
        measured: Columns with measurements of each log.
        a: Index of one log.
        b: Index of the other log.
    """
    overlap = min(spans[a][1], spans[b][1]) - max(spans[a][0], spans[b][0])
    shorter = min(spans[place][1] - spans[place][0] for place in (a, b))
    return overlap >= 0.0 and not (measured[a] & measured[b] and overlap > 0.5 * shorter)


def _title(names: Sequence[str], groups: Sequence[Sequence[int]], group: Sequence[int]) -> str:
    """Return the session name of a group of files: that of its first file, numbered if it is not unique.

    Args:
        names: Name of each file.
        groups: Indices of the files of all groups.
        group: Indices of the files of this group.
    """
    title = names[group[0]]
    alike = [other for other in groups if names[other[0]] == title]
    return title if len(alike) == 1 else f"{title}-{alike.index(group) + 1}"
