"""One or several files of one dive as one log, and the map that reads it."""

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
from hydro.io.log_import import declared, guessed, looked_at
from hydro.io.readers.tables import CLOCKS, Tables
from hydro.io.sessions import clock

Progress = Callable[[LogFile], AbstractContextManager[Reading | None]]
"""While a file is read: what is called with the share that is, if anything."""
LARGE = 50_000_000
"""Bytes of a file whose reading takes long enough to show progress."""


def silent(file: LogFile) -> AbstractContextManager[Reading | None]:
    """No progress."""
    return nullcontext()


def _headers(files: Sequence[LogFile], progress: Progress) -> list[Log]:
    """The columns of each file."""
    each = []
    for file in files:
        with progress(file) as told:
            each.append(file.header(told))
    return each


def _beside(logs: Sequence[Log]) -> Log:
    """The columns of all logs."""
    return together(logs, pl.concat([log.frame for log in logs], how="diagonal_relaxed"))


def gather(
    files: Sequence[LogFile],
    map_: str | Path | LogMap | None,
    progress: Progress = silent,
    preset: str | None = None,
    thrusters: int | None = None,
) -> tuple[Log, LogMap]:
    """The log that some files are, with the columns that a map names, and that map.

    Where the map has a `[[table]]` it says what belongs together (see `joining`).  Without one, files whose
    times overlap are merged by time; those that do not are sessions, named by their files.

    Args:
        files: The files, in any order.
        map_: A map, its file, or None to guess it from the columns' names.
        progress: Gives what is told how far each file is read.
        preset: Whose names a guess takes the columns to have; by default those of any.
        thrusters: How many the vehicle has, for a guess, if that is known.

    Raises:
        DataError: a file cannot be read, or the map is none or does not fit it.
    """
    name = files[0].stem
    if map_ is not None:
        return _read(files, declared(map_, name), [], progress)
    headers = _headers(files, progress)
    blocks, meaning = guessed(_beside(headers), name, preset, thrusters)
    log, read = _read(files, meaning, headers, progress)
    found, notes = looked_at(log, blocks, name)
    return replace(log, notes=(*log.notes, *notes)), msgspec.structs.replace(found, session=read.session)


def drafted(
    files: Sequence[LogFile],
    progress: Progress = silent,
    preset: str | None = None,
    thrusters: int | None = None,
) -> tuple[list[str], dict[str, dict[str, Any]]]:
    """Return the columns of some files, and the blocks of a map that their names and numbers suggest.

    Args:
        files: The files, in any order.
        progress: Gives what is told how far each file is read.
        preset: Whose names a guess takes the columns to have; by default those of any.
        thrusters: How many the vehicle has, if that is known.

    Raises:
        DataError: a file cannot be read.
    """
    headers = _headers(files, progress)
    known = _beside(headers)
    blocks = guess(known.table.columns, known.texts(), preset, thrusters)
    wanted = {*CLOCKS, *_texts(blocks)}
    parts = []
    for file, header_ in zip(files, headers, strict=True):
        with progress(file) as told:
            parts.append(header_ if file.reader.messages is None else file.read(wanted, told))
    found, _ = refined(blocks, lambda column: _first(parts, column))
    return list(known.table.columns), found


def _first(logs: Sequence[Log], column: str) -> Array | None:
    """Return the numbers of a column of the first log that has it."""
    return next((found for log in logs if (found := values(log, column)) is not None), None)


def _read(
    files: Sequence[LogFile], meaning: LogMap, headers: Sequence[Log], progress: Progress
) -> tuple[Log, LogMap]:
    """Read the columns of a map from some files, and return them as one log with the map that reads it."""
    words = [*_texts(msgspec.to_builtins(meaning))]
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
    """Several logs in one, in order of time, and the map with a session for each group that overlaps.

    Args:
        logs: The logs.
        names: What a session of each alone is called.
        meaning: What the columns of all of them mean.

    Raises:
        DataError: a log has no time, or its time goes backwards.
    """
    try:
        parts = [_timed(log, meaning) for log in logs]
    except DataError as error:
        raise DataError(f"{error}; where files have clocks of their own, give each a [[table]]") from error
    shared = {*CLOCKS, meaning.time.column, meaning.session.column}
    measured = [set(log.table.columns) & {*_texts(msgspec.to_builtins(meaning))} - shared for log in logs]
    groups = _groups([t for _, t in parts], measured)
    column = "session" if not any("session" in log.table.columns for log in logs) else "session of file"
    rows = []
    for group in groups:
        frame = pl.concat([parts[place][0] for place in group], how="diagonal_relaxed")
        order = np.argsort(np.concatenate([parts[place][1] for place in group]), kind="stable")
        times = np.concatenate([parts[place][1] for place in group])[order]
        title = _title(names, groups, group)
        rows.append(frame[order].with_columns(_numbered(title, times, _begins(logs, group)).alias(column)))
    frame = pl.concat(rows, how="diagonal_relaxed")
    if meaning.session.column is None:
        session = Session(column=column, gap=meaning.session.gap)
        meaning = msgspec.structs.replace(meaning, session=session)
    return together(logs, frame), meaning


def _begins(logs: Sequence[Log], group: Sequence[int]) -> Array:
    """Return the times at which a clock begins again in one of some logs [s]."""
    found = [log.table.begins for log in (logs[place] for place in group) if isinstance(log.table, Tables)]
    return np.unique(np.concatenate([np.empty(0), *found]))


def _numbered(title: str, times: Array, begins: Array) -> pl.Series:
    """Return the session of each row: the title alone, or numbered where a clock begins again."""
    if not len(begins):
        return pl.repeat(title, len(times), eager=True)
    titles = [f"{title}-{number}" for number in range(1, len(begins) + 2)]
    return pl.Series(titles).gather(np.searchsorted(begins, times, side="right"))


def _texts(value: Any) -> Iterator[str]:
    """Every text in a map: its columns, and words that no column is called."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _texts(part)
    elif isinstance(value, Sequence):
        for part in value:
            yield from _texts(part)


def _timed(log: Log, meaning: LogMap) -> tuple[pl.DataFrame, Array]:
    """The rows of a log that have a time, and their times [s]."""
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
    """Which logs are of one recording, each group and all of them in order of their beginning."""
    spans = [(float(np.min(t)), float(np.max(t))) for t in times]
    groups: list[list[int]] = []
    for place in sorted(range(len(times)), key=lambda place: spans[place]):
        joined = [group for group in groups if any(_one(spans, measured, place, other) for other in group)]
        rest = [group for group in groups if group not in joined]
        groups = [*rest, sorted([place, *(other for group in joined for other in group)])]
    return sorted(groups, key=lambda group: min(spans[place] for place in group))


def _one(spans: Sequence[tuple[float, float]], measured: Sequence[set[str]], a: int, b: int) -> bool:
    """Whether two logs are of one recording.

    Their times overlap.  Where both have the same columns, one goes on where the other ended, and they
    overlap a little at most: two runs whose clocks begin at 0 do so wholly, and are two recordings.
    """
    overlap = min(spans[a][1], spans[b][1]) - max(spans[a][0], spans[b][0])
    shorter = min(spans[place][1] - spans[place][0] for place in (a, b))
    return overlap >= 0.0 and not (measured[a] & measured[b] and overlap > 0.5 * shorter)


def _title(names: Sequence[str], groups: Sequence[Sequence[int]], group: Sequence[int]) -> str:
    """What the session of a group of files is called: by the first; numbered where two are called alike."""
    title = names[group[0]]
    alike = [other for other in groups if names[other[0]] == title]
    return title if len(alike) == 1 else f"{title}-{alike.index(group) + 1}"
