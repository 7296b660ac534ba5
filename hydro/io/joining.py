"""One log from several files of a recording, each with its own clock: all rows in order of time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PurePath

import msgspec
import numpy as np
import polars as pl

from hydro.core.errors import DataError
from hydro.core.logs.logmap import LogMap, Session, Table, Time
from hydro.io.files import shown
from hydro.io.log import Log, together
from hydro.io.sessions import clock, named_columns

TIME, SESSION = "time of the row", "session of the file"
"""Columns of the joined log: nanoseconds since any epoch, and the text that matched `{session}`."""


def joined(logs: Sequence[Log], meaning: LogMap) -> tuple[Log, LogMap]:
    """Return several logs joined to one, with the columns that a map names, and a map for the joined log.

    In each row only the columns of the row's own file have values; rows are in order of time.

    Args:
        logs: Logs in any order; they are not changed.
        meaning: Map, whose `[[table]]`s assign a clock to each file.

    Raises:
        DataError: A file fits no table or several, a table has no file, or a column is in no file or several.
    """
    wanted = {name for _, name in named_columns(meaning)}
    where: dict[str, Table] = {}
    parts = []
    for log in logs:
        table, session = _place(log, meaning)
        columns = _columns(log, table, wanted)
        for name in columns:
            if where.setdefault(name, table) is not table:
                raise DataError(
                    f"column {shown(name)} is in {where[name].files} and in {table.files}: give these tables "
                    "a name, and call it NAME.COLUMN"
                )
        ticks, rows, per_second = clock(log, Time(table.time, table.unit))
        if np.issubdtype(ticks.dtype, np.integer):
            ticks = ticks * round(1e9 / per_second)
        else:
            ticks = np.round(ticks * (1e9 / per_second)).astype(np.int64)
        frame = log.frame.select(pl.col(own).alias(name) for name, own in columns.items())
        head = pl.DataFrame({SESSION: pl.repeat(session, len(rows), eager=True), TIME: ticks})
        parts.append(pl.concat([head, frame[rows.tolist()]], how="horizontal"))
    _require_all(meaning, logs, wanted, where)
    frame = pl.concat(parts, how="diagonal_relaxed").sort(TIME, maintain_order=True)
    time = Time(TIME, "ns", meaning.time.longest_step)
    read = msgspec.structs.replace(meaning, time=time, session=Session(SESSION, gap=meaning.session.gap))
    return together(logs, frame), read


def _place(log: Log, meaning: LogMap) -> tuple[Table, str]:
    """Return the table of the map whose name pattern matches a file, and the name of the file's session.

    Raises:
        DataError: No table or several tables match.
    """
    found = []
    name = PurePath(log.name).name
    for table in meaning.table:
        pieces = re.split(r"(\{session\}|\*)", table.files)
        groups = {"{session}": "(?P<session>.+)", "*": ".*"}
        if match := re.fullmatch("".join(groups.get(each, re.escape(each)) for each in pieces), name):
            found.append((table, match.groupdict().get("session") or meaning.session.name or "log"))
    if len(found) == 1:
        return found[0]
    patterns = ", ".join(table.files for table in meaning.table)
    many = "several" if found else "none"
    raise DataError(
        f"{log.name}: fits {many} of the map's tables ({patterns}): correct table.files, or leave it out"
    )


def _columns(log: Log, table: Table, wanted: set[str]) -> dict[str, str]:
    """Return the columns of a file by their names in the map, for those of `wanted` that the file has."""
    prefix = f"{table.name}." if table.name is not None else ""
    return {prefix + own: own for own in log.frame.columns if prefix + own in wanted}


def _require_all(meaning: LogMap, logs: Sequence[Log], wanted: set[str], where: dict[str, Table]) -> None:
    """Check that each table of the map has a file, and each named column is in a file.

    Args:
        meaning: Map of the log.
        logs: The files.
        wanted: Names of columns in the map.
        where: Table of each column that was found.

    Raises:
        DataError: A table has no file, or a column is in no file.
    """
    there = {_place(log, meaning)[0] for log in logs}
    for table in meaning.table:
        if table not in there:
            raise DataError(f"no file matches {table.files} of a [[table]] of the map: give it too")
    if missing := sorted(wanted - where.keys()):
        raise DataError(
            f"no file has the column {', '.join(map(shown, missing))} of the map; columns of a table "
            "with a name are called NAME.COLUMN"
        )
