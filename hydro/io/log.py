"""Logs in CSV and Parquet, and their columns as numbers."""

from __future__ import annotations

import difflib
import hashlib
from dataclasses import dataclass

import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.io.files import Source, name_of, read_bytes, shown
from hydro.io.logmap import listed

EMPTY = ("", "nan", "NaN", "NAN", "na", "NA", "n/a", "N/A", "null", "NULL", "None", "-")
"""What loggers write into a cell that holds nothing."""
_SEPARATORS = (",", ";", "\t")


@dataclass(frozen=True)
class Log:
    """A log as it stands.

    Attributes:
        name: What error lines call it.
        frame: Its columns: of a CSV all text, of a Parquet file typed.
        digest: `sha256:` and the hash of its bytes.
    """

    name: str
    frame: pl.DataFrame
    digest: str

    def texts(self) -> frozenset[str]:
        """Columns whose first entry is neither a number nor a time of a typed column."""
        found = []
        for name in self.frame.columns:
            if self.frame.schema[name] == pl.String:
                first = self.frame[name].drop_nulls().head(1).str.strip_chars()
                if first.len() and first.cast(pl.Float64, strict=False).null_count():
                    found.append(name)
        return frozenset(found)


def read(source: Source) -> Log:
    """Read a log: Parquet by its first bytes, else CSV with commas, semicolons or tabs and a line of names.

    Raises:
        DataError: the file cannot be read, is no table, has no rows, or names a column twice.
    """
    name = name_of(source)
    content = read_bytes(source)
    frame = _parquet(content, name) if content.startswith(b"PAR1") else _csv(content, name)
    if frame.height == 0:
        raise DataError(f"{name}: no rows below the names of its columns: give a log with data")
    return Log(name, frame, f"sha256:{hashlib.sha256(content).hexdigest()}")


def _csv(content: bytes, name: str) -> pl.DataFrame:
    """All columns of a CSV as text, so that what is no number can be reported with its place."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(
            f"{name}: not UTF-8 text (byte {error.start}): save the log as UTF-8, or as Parquet"
        ) from error
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    separator = max(_SEPARATORS, key=first.count)
    names = [part.strip().strip('"') for part in first.split(separator)]
    if len(names) < 2 or not all(character.isprintable() or character == "\t" for character in first):
        raise DataError(f"{name}: not a table: its first line should name columns, separated by commas")
    if twice := sorted({column for column in names if names.count(column) > 1}):
        raise DataError(f"{name}: column {shown(twice[0])} appears twice: rename or drop one")
    try:
        frame = pl.read_csv(
            text.encode(),
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
    return frame.rename(dict(zip(frame.columns, names, strict=True)))


def _parquet(content: bytes, name: str) -> pl.DataFrame:
    try:
        return pl.read_parquet(content)
    except (pl.exceptions.PolarsError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(f"{name}: this Parquet file is damaged ({reason}): write or copy it again") from error


def column(log: Log, name: str, where: str) -> pl.Series:
    """A column of the log.

    Args:
        log: The log.
        name: What the map calls the column.
        where: The place in the map, for the error line.

    Raises:
        DataError: there is no such column.
    """
    if name not in log.frame.columns:
        near = difflib.get_close_matches(name, log.frame.columns, 1)
        hint = f"did you mean {shown(near[0])}?" if near else f"it has {listed(log.frame.columns)}"
        raise DataError(
            f"{log.name}: no column is called {shown(name) or repr(name)}, as the map says in {where}: {hint}"
        )
    return log.frame[name]


def numbers(log: Log, name: str, where: str) -> Array:
    """A column as numbers, NaN where a cell is empty.

    Args:
        log: The log.
        name: What the map calls the column.
        where: The place in the map, for the error line.

    Raises:
        DataError: there is no such column, or a cell holds what is no number.
    """
    values = column(log, name, where)
    if values.dtype == pl.String:
        text = stripped(values)
        values = text.cast(pl.Float64, strict=False)
        refuse(log, name, text, values, "numbers", f"correct the log or name another column in {where}")
    elif not (values.dtype.is_numeric() or values.dtype == pl.Boolean):
        raise DataError(
            f"{log.name}: column {shown(name)} must be numbers, but is {values.dtype}: convert it"
        )
    found = values.cast(pl.Float64).fill_null(np.nan).to_numpy()
    return np.where(np.isfinite(found), found, np.nan)


def stripped(values: pl.Series) -> pl.Series:
    """Text without spaces around it; nothing where nothing is left."""
    return values.str.strip_chars().replace("", None)


def refuse(log: Log, name: str, text: pl.Series, read: pl.Series, expected: str, remedy: str) -> None:
    """Refuse a column of text some of whose entries could not be read.

    Raises:
        DataError: an entry of `text` is nothing in `read`.
    """
    bad = (read.is_null() & text.is_not_null()).arg_true()
    if bad.len():
        verb = "is" if bad.len() == 1 else "are"
        raise DataError(
            f"{log.name}: column {shown(name)} must be {expected}, but {bad.len()} of {len(text)} rows "
            f"{verb} not (first: row {bad[0]}, {text[int(bad[0])]!r}): {remedy}"
        )
