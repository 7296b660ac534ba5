"""ArduPilot's DataFlash logs as text: the `.log` that Mission Planner and mavlogdump write from a `.bin`."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hydro.io.readers.ardupilot import CUT_SHORT, NO_DATA, messages_of, quiet
from hydro.io.readers.messages import Item, Options, Selection

_TAIL = 1 << 16
"""Number of bytes at the end of a log that contain its last line."""
_FIRST = re.compile(rb"^FMT, ?128, ?\d+, ?FMT,", re.MULTILINE)


def begins(head: bytes) -> bool:
    """Return whether a file's first bytes `head` are the format description of DataFlash text."""
    return _FIRST.search(head) is not None


def dataflash_text(path: Path, selection: Selection, options: Options) -> Iterator[Item]:
    """Yield the messages of a DataFlash text log, each with topic and time, as from a `.bin`."""
    os.environ.setdefault("MAVLINK_DIALECT", "ardupilotmega")
    from pymavlink.DFReader import DFReader_text

    said = io.StringIO()
    with quiet(said):
        reader = DFReader_text(os.fspath(path))
    types = {name for name in reader.counts if name not in NO_DATA and selection.takes_type(name)}
    try:
        yield from messages_of(reader, types, said, selection, options)
    finally:
        reader.filehandle.close()
    if _cut_short(path, reader):
        options.notes.append(CUT_SHORT)


def _cut_short(path: Path, reader: Any) -> bool:
    """Check whether the last line of a log has fewer values than its message type."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - _TAIL, 0))
        last = file.read().rstrip(b"\n").rpartition(b"\n")[2].decode(errors="replace")
    known = reader.formats.get(last.partition(",")[0])
    return known is None or last.count(",") < len(known.columns)
