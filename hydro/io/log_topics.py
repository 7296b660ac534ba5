"""Contents of a log in plain text, for `hydro import LOG --topics`."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

from hydro.io.log import LogFile, Reading, numeric
from hydro.io.readers.collect import Listed

_INDEX = re.compile(r"^(.*)\[(\d+)\]((?:\.[^\[\]]*)?)$")
_EPOCH = 946_684_800.0  # clocks above the year 2000 count from 1970 [s]


def lines(file: LogFile, progress: Reading | None = None) -> Iterator[str]:
    """Yield lines of text on the contents of a log: each topic with its numeric fields, or a table's columns.

    A topic has its type, number of messages, rate [Hz] and span [s].

    Args:
        file: The log.
        progress: Called with the share of the file that has been read.

    Raises:
        DataError: The file cannot be read.
    """
    if file.reader.messages is None:
        yield from _table_lines(file)
        return
    listed, notes = file.topics(progress)
    begun = min((each.first for each in listed), default=0.0)
    count = sum(each.count for each in listed)
    yield f"{file.name}: {file.reader.name}, {count:,} messages in {len(listed)} topics{_since(begun)}"
    read = sorted((each for each in listed if each.fields), key=lambda each: each.topic.name)
    rows = [_row(each, begun) for each in read]
    widths = [max(len(row[place]) for row in rows) for place in range(2)] if rows else []
    for each, row in zip(read, rows, strict=True):
        name, kind = (text.ljust(width) for text, width in zip(row[:2], widths, strict=True))
        yield f"{name}  {kind}  {row[2]}"
        skipped = f" (and {len(each.skipped)} not numeric)" if each.skipped else ""
        words = " ".join(ranges(each.fields)) + skipped
        yield from textwrap.wrap(
            words, 108, initial_indent="    ", subsequent_indent="    ", break_long_words=False
        )
    for each in listed:
        if not each.fields:
            why = each.topic.unread or "no numbers in it"
            yield f"not read: {each.topic.name}  {each.topic.kind}  {each.count:,} messages: {why}"
    yield from (f"note: {note}" for note in notes)


def _table_lines(file: LogFile) -> Iterator[str]:
    """Yield the columns of a table."""
    log = file.read()
    numbers = [name for name in log.frame.columns if numeric(log.frame[name])]
    others = [name for name in log.frame.columns if name not in numbers]
    yield f"{file.name}: {file.reader.name}, {log.frame.height:,} rows of {log.frame.width} columns"
    yield from textwrap.wrap(" ".join(numbers), 108, initial_indent="    ", subsequent_indent="    ")
    if others:
        yield f"no numbers: {' '.join(others)}"
    yield from (f"note: {note}" for note in log.notes)


def _row(each: Listed, begun: float) -> tuple[str, str, str]:
    """Return name, type and figures of a topic; `begun` is the start of the log [s]."""
    rate = "-" if math.isnan(each.rate) else f"{each.rate:.4g}"
    span = f"{each.first - begun:.1f} to {each.last - begun:.1f} s"
    return each.topic.name, each.topic.kind, f"{each.count:>9,}  {rate:>7} Hz  {span}"


def _since(begun: float) -> str:
    """Return the start date of a log as text; empty if its clock has no date."""
    if not _EPOCH < begun < 1e11:
        return ""
    return f", from {datetime.fromtimestamp(begun, UTC):%Y-%m-%d %H:%M:%S} UTC"


def ranges(paths: Iterable[str]) -> list[str]:
    """Return paths of fields, with elements of one array merged to one path, such as `channels[0..7]`."""
    found: dict[tuple[str, str], list[int]] = {}
    for path in paths:
        match = _INDEX.match(path)
        key, index = ((match[1], match[3]), int(match[2])) if match else ((path, ""), -1)
        found.setdefault(key, []).append(index)
    words = []
    for (name, rest), indices in found.items():
        if indices == [-1]:
            words.append(name)
        elif len(indices) == 1:
            words.append(f"{name}[{indices[0]}]{rest}")
        else:
            words.append(f"{name}[{min(indices)}..{max(indices)}]{rest}")
    return words
