"""Logs in any readable format, and their columns as numbers."""

from __future__ import annotations

import difflib
import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np
import polars as pl

from hydro.core.columns import Array, Mask
from hydro.core.errors import DataError
from hydro.io import pipe
from hydro.io.files import Source, explained, name_of, refuse_device, shown
from hydro.io.logmap import listed
from hydro.io.readers import collect, registry
from hydro.io.readers.messages import Options, Selection
from hydro.io.readers.tables import Tables

NOT_A_NUMBER = ("nan", "NaN", "NAN")
"""Texts of a cell that mean NaN."""
Reading = Callable[[float], None]
"""Callback of progress, with the share of a file that has been read."""


@dataclass(frozen=True)
class Log:
    """Log as read from a file, with columns not yet converted to numbers.

    Attributes:
        name: Name of the log in error messages.
        table: Columns: text from a CSV, typed from other tables; of a log of messages, the columns of each
            topic.
        digest: `sha256:` and the hash of the file's bytes.
        more: Function that lists the columns that were not read, which takes a pass over the file.
        notes: Notes of the reader, a line each.
        files: `digest` of every file, if the log was made of several.
    """

    name: str
    table: pl.DataFrame | Tables
    digest: str
    more: Callable[[], Sequence[str]] = tuple
    notes: tuple[str, ...] = ()
    files: tuple[str, ...] = ()

    @cached_property
    def frame(self) -> pl.DataFrame:
        """All columns as one table; a log of messages gets a row for each message, all in memory."""
        return self.table.wide() if isinstance(self.table, Tables) else self.table

    @property
    def names(self) -> list[str]:
        """Names of all columns, including those that were not read."""
        return list(dict.fromkeys((*self.table.columns, *self.more())))

    def row(self, index: int) -> str:
        """Return words for a row in errors, such as `row 3`: in a CSV from 1 after the header, else from 0.

        Args:
            index: Row from 0.
        """
        csv = isinstance(self.table, pl.DataFrame) and set(self.table.dtypes) <= {pl.String}
        return f"row {index + 1}" if csv else f"row {index}"

    def texts(self) -> frozenset[str]:
        """Return the names of the columns whose first entry is text and not a number."""
        found: list[str] = []
        if isinstance(self.table, Tables):
            return frozenset(found)
        for name in self.frame.columns:
            if self.frame.schema[name] == pl.String:
                first = self.frame[name].drop_nulls().head(1).str.strip_chars()
                if first.len() and first.cast(pl.Float64, strict=False).null_count():
                    found.append(name)
        return frozenset(found)


@dataclass(frozen=True)
class LogFile:
    """File of a log, or folder of a ROS 2 recording, with its reader.

    Attributes:
        name: Name of the file in error messages.
        path: Path of the file.
        reader: Reader of its format.
        definitions: Folder with `.msg` files, or None.
    """

    name: str
    path: Path
    reader: registry.Reader
    definitions: Path | None = None

    @property
    def stem(self) -> str:
        """Session name for this file: the file's name without suffix."""
        return self.path.stem if self.name != "stdin" else self.name

    @property
    def parts(self) -> list[Path]:
        """Paths of all files that the log consists of."""
        return (
            sorted(each for each in self.path.rglob("*") if each.is_file())
            if self.path.is_dir()
            else [self.path]
        )

    @property
    def size(self) -> int:
        """Size of all files of the log [bytes]."""
        return sum(part.stat().st_size for part in self.parts)

    def topics(self, progress: Reading | None = None) -> tuple[list[collect.Listed], list[str]]:
        """Return a summary of each topic of a log of messages, and the reader's notes, a line each.

        Both lists are empty for a table.

        Args:
            progress: Called with the fraction of the file that has been read.
        """
        options = self._options(progress)
        if self.reader.messages is None:
            return [], []
        return registry.topics(self.path, self.reader, options), options.notes

    def header(self, progress: Reading | None = None) -> Log:
        """Return the log with the names of all columns; rows are read only from a table, not from messages.

        Args:
            progress: Called with the fraction of the file that has been read.

        Raises:
            DataError: The file cannot be read, or has no messages.
        """
        if self.reader.messages is None:
            return self.read(None, progress)
        found, _ = self.topics(progress)
        names = dict.fromkeys(collect.columns(found))
        if not any(entry.fields for entry in found):
            raise DataError(f"{self.name}: no message with numbers in this {self.reader.name}: see --topics")
        return Log(self.name, pl.DataFrame(schema=dict.fromkeys(names, pl.Float64)), "")

    def read(self, wanted: Iterable[str] | None = None, progress: Reading | None = None) -> Log:
        """Return the content of the log; from messages, only the wanted columns.

        Args:
            wanted: Names of columns; None for all. A table is read whole.
            progress: Called with the fraction of the file that has been read.

        Raises:
            DataError: The file cannot be read, is not a log, has no rows, or names a column twice.
        """
        options = self._options(progress)
        selection = Selection(None if wanted is None else frozenset(wanted))
        found = registry.read(self.path, self.reader, selection, options)
        if found.height == 0 and (wanted is None or self.reader.messages is None):
            raise DataError(f"{self.name}: no rows after the header: give a log with data")
        return Log(self.name, found, self._digest(), self._names, tuple(options.notes))

    def _names(self) -> Sequence[str]:
        """Return all columns, for hints in error messages; none if the file no longer exists."""
        if self.reader.messages is None or not self.path.exists():
            return ()
        return self.header().frame.columns

    def _options(self, progress: Reading | None) -> Options:
        options = Options(self.name, self.definitions)
        if progress is not None:
            options.progress = progress
        return options

    def _digest(self) -> str:
        """Return the hash of a file's bytes; for a folder, of all its files with their names."""
        whole = hashlib.sha256()
        try:
            for part in self.parts:
                with part.open("rb") as file:
                    each = hashlib.file_digest(file, "sha256")
                if len(self.parts) == 1 and not self.path.is_dir():
                    return f"sha256:{each.hexdigest()}"
                whole.update(f"{part.relative_to(self.path)} {each.hexdigest()}\n".encode())
        except OSError as error:
            raise explained(self.name, error) from error
        return f"sha256:{whole.hexdigest()}"


@contextmanager
def opened(source: Source, definitions: Path | None = None) -> Iterator[LogFile]:
    """Open a log for reading within a `with` block, which gets a `LogFile`.

    A stream is copied into a temporary file first.

    Args:
        source: File, folder of a ROS 2 recording, or binary stream.
        definitions: Folder with `.msg` files for ROS messages that the log does not describe.

    Raises:
        DataError: The path cannot be read or is a device, it is empty, or no reader knows the format.
        UsageError: The stream is a terminal.
    """
    name = name_of(source)
    with tempfile.TemporaryDirectory() as folder:
        try:
            refuse_device(source)
            path = Path(source) if isinstance(source, str | Path) else _spooled(source, Path(folder))
            if path.is_file() and not path.stat().st_size:
                raise DataError(f"{name}: empty file: did the command that should have written it fail?")
            if not path.is_file() and not path.is_dir():
                with pipe.opened(path) as stream:
                    path = _spooled(stream, Path(folder))
            reader = registry.reader_of(path, name)
        except OSError as error:
            raise explained(name, error) from error
        yield LogFile(name, path, reader, definitions)


def _spooled(stream: BinaryIO, folder: Path) -> Path:
    """Copy the bytes of a stream into a file, for readers that seek."""
    path = folder / "stream"
    with path.open("wb") as file:
        shutil.copyfileobj(stream, file)
    return path


def read(source: Source, wanted: Iterable[str] | None = None, *, definitions: Path | None = None) -> Log:
    """Return a log, read in any format that its first bytes identify.

    Args:
        source: File, folder of a ROS 2 recording, or binary stream.
        wanted: Columns to read of a log of messages; all by default.
        definitions: Folder with `.msg` files for ROS messages that the log does not describe.

    Raises:
        DataError: The file cannot be read, is not a log, has no rows, or names a column twice.
        UsageError: The stream is a terminal.
    """
    with opened(source, definitions) as file:
        return file.read(wanted)


def together(logs: Sequence[Log], frame: pl.DataFrame) -> Log:
    """Return a new log that represents several logs, named after the first; its digest ignores their order.

    Args:
        logs: The logs, at least one.
        frame: Columns of the new log, made from those of `logs`.
    """
    if len(logs) == 1:
        return replace(logs[0], table=frame)
    digest = hashlib.sha256("".join(sorted(log.digest for log in logs)).encode()).hexdigest()
    return Log(
        name=f"{logs[0].name} and {len(logs) - 1} more",
        table=frame,
        digest=f"sha256:{digest}",
        more=lambda: [name for log in logs for name in log.more()],
        notes=tuple(f"{log.name}: {note}" for log in logs for note in log.notes),
        files=tuple(log.digest for log in logs),
    )


def column(log: Log, name: str, where: str) -> pl.Series:
    """Return one column of the log as read, not converted to numbers.

    Args:
        log: The log.
        name: Name of the column in the map.
        where: Path in the map that names the column, for the error message.

    Raises:
        DataError: There is no such column.
    """
    require(log, name, where)
    return log.frame[name]


def require(log: Log, name: str, where: str) -> None:
    """Check that a log has a column.

    Args:
        log: The log.
        name: Name of the column in the map.
        where: Path in the map that names the column, for the error message.

    Raises:
        DataError: There is no such column.
    """
    if name not in log.table.columns:
        near = difflib.get_close_matches(name, [each for each in log.names if each != name], 1)
        hint = f"did you mean {shown(near[0])}?" if near else f"it has {listed(log.names)}"
        raise DataError(
            f"{log.name}: no column is called {shown(name) or repr(name)}, which the map names in {where}: "
            f"{hint}"
        )


def numbers(log: Log, name: str, where: str) -> Array:
    """Return a column as numbers (n,), NaN where a cell is empty.

    Args:
        log: The log.
        name: Name of the column in the map.
        where: Path in the map that names the column, for the error message.

    Raises:
        DataError: There is no such column, or a cell is not a number.
    """
    values = column(log, name, where)
    if values.dtype == pl.String:
        text = stripped(values)
        values = text.cast(pl.Float64, strict=False)
        refuse(log, name, text, values, "numbers", f"correct the log or name another column in {where}")
    elif isinstance(values.dtype, pl.Duration):
        values = seconds(values)
    elif not (values.dtype.is_numeric() or values.dtype == pl.Boolean):
        raise DataError(
            f"{log.name}: column {shown(name)} must be numbers, but is {values.dtype}: convert it"
        )
    found = values.cast(pl.Float64).fill_null(np.nan).to_numpy()
    return np.where(np.isfinite(found), found, np.nan)


def values(log: Log, name: str) -> Array | None:
    """Return a column as numbers in the order of the log, (n,), with NaN in empty cells.

    Args:
        log: The log.
        name: Name of the column.

    Returns:
        The numbers; None if there is no such column, or a cell is not a number.
    """
    if name not in log.table.columns:
        return None
    if isinstance(log.table, Tables):
        return log.table.values(name)
    try:
        return numbers(log, name, "guess")
    except DataError:
        return None


def unset(log: Log, name: str) -> Mask:
    """Return a mask, (n,), of the rows in which a column is an explicit NaN; empty cells do not count."""
    values = column(log, name, "commands")
    if values.dtype == pl.String:
        return stripped(values).is_in(NOT_A_NUMBER).fill_null(False).to_numpy()
    if not values.dtype.is_float():
        return np.zeros(len(values), bool)
    return values.is_nan().fill_null(False).to_numpy()


def numeric(values: pl.Series) -> bool:
    """Return whether a column holds numbers, as text or as a numeric type.

    Of text, the first entry decides.
    """
    if values.dtype != pl.String:
        return values.dtype.is_numeric() or values.dtype in (pl.Boolean, pl.Duration)
    first = stripped(values.drop_nulls().head(1))
    return bool(first.len()) and not first.cast(pl.Float64, strict=False).null_count()


def seconds(values: pl.Series) -> pl.Series:
    """Return a column of polars durations as numbers of seconds."""
    return values.dt.total_nanoseconds().cast(pl.Float64) * 1e-9


def stripped(values: pl.Series) -> pl.Series:
    """Return a column of text without surrounding spaces; an empty text becomes null."""
    return values.str.strip_chars().replace("", None)


def refuse(log: Log, name: str, text: pl.Series, read: pl.Series, expected: str, remedy: str) -> None:
    """Raise an error if entries of a text column could not be converted.

    Args:
        log: The log.
        name: Name of the column.
        text: Column as text.
        read: Converted column, null where the conversion failed.
        expected: Kind of entry that is expected, for the message.
        remedy: What the user can do, for the message.

    Raises:
        DataError: An entry of `text` is null in `read`.
    """
    bad = (read.is_null() & text.is_not_null()).arg_true()
    if bad.len():
        verb = "is" if bad.len() == 1 else "are"
        raise DataError(
            f"{log.name}: column {shown(name)} must be {expected}, but {bad.len()} of {len(text)} rows "
            f"{verb} not (first: {log.row(int(bad[0]))}, {text[int(bad[0])]!r}): {remedy}"
        )
