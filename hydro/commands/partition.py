"""Command `partition`: convert a table of sessions to a folder with one file for each session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hydro.commands.places import SESSIONS
from hydro.commands.recordings import MaxExpanded
from hydro.commands.shell import STREAM, message, read

KINDS = ("raw", "labels", "split")
"""Kinds of table with sessions that can be partitioned."""

Table = Annotated[
    str,
    typer.Argument(
        metavar="TABLE",
        show_default=False,
        help="Raw, labels or split table; nothing or - is stdin.",
    ),
]
Folder = Annotated[
    Path,
    typer.Option("--output", "-o", metavar="DIR", show_default=False, help="Folder of sessions."),
    SESSIONS,
]


def partition(output: Folder, table: Table = STREAM, max_expanded: MaxExpanded = None) -> None:
    """Split a table into one file for each session.

    Each session becomes DIR/session=NAME/part.parquet. A folder of sessions is given to other commands as a
    table is, and sessions may be added to it one dive after another. hydro labels reads one session of it at
    a time, polars and DuckDB only the columns and sessions that a query asks for. A session that DIR has
    already is refused unless it is the same.

        hydro partition dive-1.parquet -o dives
        hydro partition dive-2.parquet -o dives
        hydro labels dives -o labels
    """
    from hydro.core.errors import DataError, shown
    from hydro.io import partitions, provenance
    from hydro.io import table as tables

    source = read(table, *KINDS)
    parts = source.frame.partition_by("session", maintain_order=True)
    named = {str(part["session"][0]): part for part in parts}
    there = set(partitions.sessions(output)) & named.keys()
    for session in sorted(there):
        kept = tables.read(partitions.place(output, session)).provenance.content
        if kept != provenance.content_hash(named[session]):
            raise DataError(
                f"{output}: has another session {shown(session)} already: name another folder, or call it "
                "otherwise"
            )
    new = {
        partitions.place(output, session): tables.make(source.kind, part, stage="partition", inputs=[source])
        for session, part in named.items()
        if session not in there
    }
    tables.write_all(new)
    message(f"hydro: {output}: {len(named)} sessions, {len(partitions.sessions(output))} in all")


COMMANDS = {partition: "hydro partition datasets/stonefish/sample.parquet -o dives"}
