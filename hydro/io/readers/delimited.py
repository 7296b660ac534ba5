"""Reader of text tables: CSV with commas, semicolons or tabs."""

from __future__ import annotations

import csv as quoting
import re
from collections.abc import Iterator
from pathlib import Path

import polars as pl

from hydro.core.errors import DataError, shown
from hydro.io.readers import cells
from hydro.io.readers.expansion import Expansion
from hydro.io.readers.messages import Options, Selection

EMPTY = ("", "na", "NA", "n/a", "N/A", "null", "NULL", "None", "-")
"""Cells that loggers write for a missing value. NaN is kept: a controller may write it for a motor."""
_SEPARATORS = (",", ";", "\t")
_RECEIVED, _STAMP = "%time", "field.header.stamp"
"""Columns of `rostopic echo -p`, in nanoseconds."""
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_CELL = 16
"""Memory of a text cell in a table, including an empty one [bytes]."""
_CONTROL = re.compile(rb"[\x01-\x08\x0b\x0e-\x1f\x7f]")


def is_text(head: bytes) -> bool:
    """Return whether the first bytes `head` of a file are text; NUL bytes are ignored."""
    if head.startswith(_UTF16):
        return True
    return bool(head.strip(b"\0 \r\n\t")) and not _CONTROL.search(head)


def csv(path: Path, selection: Selection, options: Options) -> pl.DataFrame:
    """Return all columns of a CSV as text, so that an error can name the row of an invalid number.

    Tables of `rostopic echo -p` get the columns `time` and `receive_time` [s], like those of a bag.
    """
    return parse_csv(path.read_bytes(), options)


def parse_csv(content: bytes, options: Options) -> pl.DataFrame:
    """Return the table in the bytes of a CSV, with all columns as text; repairs are noted in `options`.

    Args:
        content: Bytes of the file.
        options: Name of the file for errors; receives the notes.

    Raises:
        DataError: The text is not a table, names a column twice, or expands to too many cells.
    """
    name = options.name
    text = _text(content, options)
    first, start = _first_line(text)
    separator = max(_SEPARATORS, key=re.sub(r'"[^"]*"', "", first).count)
    names, end = _header(text, start, separator)
    if len(names) < 2 or not all(character.isprintable() or character == "\t" for character in first):
        raise DataError(f"{name}: not a table: its first line should name columns, separated by commas")
    if twice := sorted({column for column in names if names.count(column) > 1}):
        raise DataError(f"{name}: column {shown(twice[0])} appears twice: rename or drop one")
    text = _without_torn_row(text, end, len(names), separator, options)
    Expansion(name, len(content)).add(_CELL * len(names) * (text.count("\n", end) + 1))
    plain = separator.join(f"c{place}" for place in range(len(names)))
    try:
        frame = pl.read_csv(
            f"{plain}\n{text[end:]}".encode(),
            separator=separator,
            comment_prefix="#",
            infer_schema=False,
            null_values=list(EMPTY),
        )
    except (pl.exceptions.PolarsError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(
            f"{name}: not a table of comma-separated values ({reason}): check its lines"
        ) from error
    frame = frame.rename(dict(zip(frame.columns, names, strict=True)))
    if separator != ",":
        frame = cells.with_points(frame, options.notes)
    return _with_times(cells.without_units(frame, options.notes))


def _text(content: bytes, options: Options) -> str:
    """Decode a file, without NUL bytes and with line feeds at the ends of lines."""
    if content.startswith(_UTF16):
        text = content.decode("utf-16", errors="replace")
    else:
        if nuls := content.count(b"\0"):
            content = content.replace(b"\0", b"")
            options.notes.append(f"{nuls:,} NUL bytes are left out; a logger writes them when it loses power")
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise DataError(
                f"{options.name}: not UTF-8 text (byte {error.start}): save the log as UTF-8, or as Parquet"
            ) from error
    return text.replace("\r", "\n") if "\r" in text and "\n" not in text else text


def _without_torn_row(text: str, start: int, columns: int, separator: str, options: Options) -> str:
    """Return a table's text without a truncated last row.

    Such a row has too few cells and no line feed, because its writer was interrupted.

    Args:
        text: Text of the file.
        start: Index of the first row in the text.
        columns: Number of columns.
        separator: Separator of cells.
        options: Gets a note if a row is removed.
    """
    begin = max(text.rfind("\n") + 1, start)
    row = text[begin:]
    if not row.strip() or row.startswith("#") or '"' in row or columns <= row.count(separator) + 1:
        return text
    options.notes.append(
        f"the last row is cut off after {row.count(separator) + 1} of {columns} cells and is left out"
    )
    return text[:begin]


def _lines(text: str, start: int = 0) -> Iterator[tuple[str, int]]:
    """Yield each line with its line feed, and its index in the text, from `start` on."""
    while start < len(text):
        end = text.find("\n", start) + 1 or len(text)
        yield text[start:end], start
        start = end


def _first_line(text: str) -> tuple[str, int]:
    """Return the first line that is neither empty nor a comment, and its index in the text."""
    for line, start in _lines(text):
        if line.strip() and not line.startswith("#"):
            return line.strip("\r\n"), start
    return "", len(text)


def _header(text: str, start: int, separator: str) -> tuple[list[str], int]:
    """Return the column names, and the index of the first row; a quoted name may contain separators."""
    end = start

    def lines() -> Iterator[str]:
        nonlocal end
        for line, begun in _lines(text, start):
            end = begun + len(line)
            yield line

    try:
        found = next(quoting.reader(lines(), delimiter=separator, skipinitialspace=True), [])
    except quoting.Error:
        return [], end
    return [part.strip().strip('"') for part in found], end


def _with_times(frame: pl.DataFrame) -> pl.DataFrame:
    """Return the table of `rostopic echo -p` with its clocks in seconds, or any other table unchanged."""
    if _RECEIVED not in frame.columns or {"time", "receive_time"} & set(frame.columns):
        return frame
    seconds = {
        name: frame[name].cast(pl.Int64, strict=False).cast(pl.Float64) * 1e-9
        for name in (_RECEIVED, _STAMP)
        if name in frame.columns
    }
    received = seconds[_RECEIVED]
    stamped = seconds.get(_STAMP, received)
    time = stamped.zip_with((stamped > 0.0).fill_null(False), received)
    return frame.with_columns(time.alias("time"), received.alias("receive_time"))
