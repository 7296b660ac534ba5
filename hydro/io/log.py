"""Logs in any format that a reader knows, and their columns as numbers."""

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
from hydro.io.files import Source, explained, name_of, refuse_device, shown
from hydro.io.logmap import listed
from hydro.io.readers import collect, registry
from hydro.io.readers.messages import Options, Selection
from hydro.io.readers.tables import Tables

NOT_A_NUMBER = ("nan", "NaN", "NAN")
"""What a cell of text says that holds no number."""
Reading = Callable[[float], None]
"""What is called with the share of a file that is read."""


@dataclass(frozen=True)
class Log:
    """A log as it stands.

    Attributes:
        name: What error lines call it.
        table: Its columns: of a CSV all text, of other tables typed; of messages those of each topic.
        digest: `sha256:` and the hash of its bytes.
        more: Lists the columns that it has besides, which nobody wanted; that takes a pass over the log.
        notes: What its reader has to say, a line each.
        files: `digest` of every file that it was made of, where there are several.
    """

    name: str
    table: pl.DataFrame | Tables
    digest: str
    more: Callable[[], Sequence[str]] = tuple
    notes: tuple[str, ...] = ()
    files: tuple[str, ...] = ()

    @cached_property
    def frame(self) -> pl.DataFrame:
        """Its columns in one table: of messages a row for each, which takes memory for all of them."""
        return self.table.wide() if isinstance(self.table, Tables) else self.table

    @property
    def names(self) -> list[str]:
        """All its columns, also those that were not read."""
        return list(dict.fromkeys((*self.table.columns, *self.more())))

    def row(self, index: int) -> str:
        """What error lines call a row: of a CSV from 1 below its header, of other tables from 0 as in polars.

        Args:
            index: from 0.
        """
        csv = isinstance(self.table, pl.DataFrame) and set(self.table.dtypes) <= {pl.String}
        return f"row {index + 1}" if csv else f"row {index}"

    def texts(self) -> frozenset[str]:
        """Columns whose first entry is neither a number nor a time of a typed column."""
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
    """A file, or a ROS 2 recording's folder, with the reader that it needs.

    Attributes:
        name: What error lines call it.
        path: Where it is.
        reader: What reads it.
        definitions: Folder with `.msg` files, or None.
    """

    name: str
    path: Path
    reader: registry.Reader
    definitions: Path | None = None

    @property
    def stem(self) -> str:
        """What a session of it is called."""
        return self.path.stem if self.name != "stdin" else self.name

    @property
    def parts(self) -> list[Path]:
        """The files that it consists of."""
        return (
            sorted(each for each in self.path.rglob("*") if each.is_file())
            if self.path.is_dir()
            else [self.path]
        )

    @property
    def size(self) -> int:
        """Its bytes."""
        return sum(part.stat().st_size for part in self.parts)

    def topics(self, progress: Reading | None = None) -> tuple[list[collect.Listed], list[str]]:
        """What a log of messages has, and what its reader says; none of a table."""
        options = self._options(progress)
        if self.reader.messages is None:
            return [], []
        return registry.topics(self.path, self.reader, options), options.notes

    def header(self, progress: Reading | None = None) -> Log:
        """The log's columns: of messages without rows, of a table with them.

        Raises:
            DataError: the file cannot be read, or has no messages.
        """
        if self.reader.messages is None:
            return self.read(None, progress)
        found, _ = self.topics(progress)
        names = dict.fromkeys(collect.columns(found))
        if not any(entry.fields for entry in found):
            raise DataError(f"{self.name}: no message with numbers in this {self.reader.name}: see --topics")
        return Log(self.name, pl.DataFrame(schema=dict.fromkeys(names, pl.Float64)), "")

    def read(self, wanted: Iterable[str] | None = None, progress: Reading | None = None) -> Log:
        """The log, of messages with the wanted columns alone.

        Args:
            wanted: Columns; all by default. A table is read whole.
            progress: Called with the share of the file that is read.

        Raises:
            DataError: the file cannot be read, is no log, has no rows, or names a column twice.
        """
        options = self._options(progress)
        selection = Selection(None if wanted is None else frozenset(wanted))
        found = registry.read(self.path, self.reader, selection, options)
        if found.height == 0 and (wanted is None or self.reader.messages is None):
            raise DataError(f"{self.name}: no rows below the names of its columns: give a log with data")
        return Log(self.name, found, self._digest(), self._names, tuple(options.notes))

    def _names(self) -> Sequence[str]:
        """Its columns, for hints; none of a file that is gone by now."""
        if self.reader.messages is None or not self.path.exists():
            return ()
        return self.header().frame.columns

    def _options(self, progress: Reading | None) -> Options:
        options = Options(self.name, self.definitions)
        if progress is not None:
            options.progress = progress
        return options

    def _digest(self) -> str:
        """The hash of its bytes; of a folder, of all files in it by name."""
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
    """A log ready to be read; a stream is put into a temporary file first.

    Raises:
        DataError: the path cannot be read or is a device, nothing came in, or no reader knows the format.
        UsageError: the stream is a terminal.
    """
    name = name_of(source)
    with tempfile.TemporaryDirectory() as folder:
        try:
            refuse_device(source)
            path = Path(source) if isinstance(source, str | Path) else _spooled(source, Path(folder))
            if path.is_file() and not path.stat().st_size:
                raise DataError(
                    f"{name}: empty, not a single byte: did the command that should have written it fail?"
                )
            if not path.is_file() and not path.is_dir():
                with path.open("rb") as pipe:
                    path = _spooled(pipe, Path(folder))
            reader = registry.reader_of(path, name)
        except OSError as error:
            raise explained(name, error) from error
        yield LogFile(name, path, reader, definitions)


def _spooled(stream: BinaryIO, folder: Path) -> Path:
    """The bytes of a stream in a file, for readers that go back and forth."""
    path = folder / "stream"
    with path.open("wb") as file:
        shutil.copyfileobj(stream, file)
    return path


def read(source: Source, wanted: Iterable[str] | None = None, *, definitions: Path | None = None) -> Log:
    """Read a log in any format that its first bytes tell.

    Args:
        source: File, folder of a ROS 2 recording, or binary stream.
        wanted: Of a log of messages, the columns to read; all by default.
        definitions: Folder with `.msg` files for ROS messages that the log does not describe.

    Raises:
        DataError: the file cannot be read, is no log, has no rows, or names a column twice.
        UsageError: the stream is a terminal.
    """
    with opened(source, definitions) as file:
        return file.read(wanted)


def together(logs: Sequence[Log], frame: pl.DataFrame) -> Log:
    """A log of several, under the name of the first; its digest does not depend on their order.

    Args:
        logs: What it was made of, at least one.
        frame: The columns of all.
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
    """A column of the log.

    Args:
        log: The log.
        name: What the map calls the column.
        where: The place in the map, for the error line.

    Raises:
        DataError: there is no such column.
    """
    require(log, name, where)
    return log.frame[name]


def require(log: Log, name: str, where: str) -> None:
    """Refuse a log without a column; arguments as those of `column`.

    Raises:
        DataError: there is no such column.
    """
    if name not in log.table.columns:
        near = difflib.get_close_matches(name, [each for each in log.names if each != name], 1)
        hint = f"did you mean {shown(near[0])}?" if near else f"it has {listed(log.names)}"
        raise DataError(
            f"{log.name}: no column is called {shown(name) or repr(name)}, as the map says in {where}: {hint}"
        )


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
    elif isinstance(values.dtype, pl.Duration):
        values = seconds(values)
    elif not (values.dtype.is_numeric() or values.dtype == pl.Boolean):
        raise DataError(
            f"{log.name}: column {shown(name)} must be numbers, but is {values.dtype}: convert it"
        )
    found = values.cast(pl.Float64).fill_null(np.nan).to_numpy()
    return np.where(np.isfinite(found), found, np.nan)


def values(log: Log, name: str) -> Array | None:
    """Return a column as numbers in the order of the log, NaN in empty cells; None without numbers."""
    if name not in log.table.columns:
        return None
    if isinstance(log.table, Tables):
        return log.table.values(name)
    try:
        return numbers(log, name, "guess")
    except DataError:
        return None


def unset(log: Log, name: str) -> Mask:
    """Return the rows in which a column says NaN, (n,); empty cells say nothing."""
    values = column(log, name, "commands")
    if values.dtype == pl.String:
        return stripped(values).is_in(NOT_A_NUMBER).fill_null(False).to_numpy()
    if not values.dtype.is_float():
        return np.zeros(len(values), bool)
    return values.is_nan().fill_null(False).to_numpy()


def numeric(values: pl.Series) -> bool:
    """Whether a column holds numbers, as text or typed, in its first entry at least."""
    if values.dtype != pl.String:
        return values.dtype.is_numeric() or values.dtype in (pl.Boolean, pl.Duration)
    first = stripped(values.drop_nulls().head(1))
    return bool(first.len()) and not first.cast(pl.Float64, strict=False).null_count()


def seconds(values: pl.Series) -> pl.Series:
    """Return a column of durations in seconds."""
    return values.dt.total_nanoseconds().cast(pl.Float64) * 1e-9


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
            f"{verb} not (first: {log.row(int(bad[0]))}, {text[int(bad[0])]!r}): {remedy}"
        )
