"""Dataset: a folder of Parquet files, one for each session: `session=NAME/part.parquet`.

This is the layout of hive partitions in polars, DuckDB and Spark.  Every part is a complete table with all
its columns and its footer.  Its only session is the one that the folder names.  Characters other than
letters, digits and `-_.~` are percent-encoded in the folder's name.  A folder has no order, so sessions are
sorted by name.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from urllib.parse import quote, unquote

import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

from hydro.core.errors import DataError
from hydro.io import parquet, provenance, schema
from hydro.io.files import explained, shown
from hydro.io.provenance import Provenance

KEY, FILE = "session=", "part.parquet"
LAYOUT = f"{KEY}NAME/{FILE}"


@dataclass(frozen=True)
class Part:
    """One session of a dataset, read from the metadata of its file without any row.

    Attributes:
        session: Name of the session.
        path: File of the session.
        kind: Kind of table.
        columns: Storage type of each column, by column name.
        rows: Number of rows.
        nulls: Columns with nulls.
        record: Provenance in the footer; None for a table that hydro did not write.
    """

    session: str
    path: Path
    kind: str
    columns: Mapping[str, str]
    rows: int
    nulls: frozenset[str]
    record: Provenance | None


@dataclass(frozen=True)
class Dataset:
    """Sessions of one kind of table with the same columns, in one folder.

    Attributes:
        folder: Folder of the sessions.
        parts: Parts sorted by session.
    """

    folder: Path
    parts: tuple[Part, ...]

    @property
    def kind(self) -> str:
        """Kind of table of all parts."""
        return self.parts[0].kind

    @cached_property
    def vehicle(self) -> str | None:
        """Text of the vehicle file in the footers; None if they have none.

        Raises:
            DataError: Sessions have different vehicles.
        """
        texts = {part.record.vehicle: part.session for part in self.parts if part.record is not None}
        texts.pop(None, None)
        if len(texts) > 1:
            one, other = sorted(texts.values())[:2]
            raise DataError(
                f"{shown(str(self.folder))}: sessions {shown(one)} and {shown(other)} carry different "
                "vehicles in their footers: add --vehicle FILE, or keep each vehicle in a folder of its own"
            )
        return next(iter(texts), None)

    def scan(self) -> pl.LazyFrame:
        """Return all rows of all sessions as a lazy frame; rows and columns are read only as needed."""
        return scan(*(part.path for part in self.parts))


def scan(*paths: Path) -> pl.LazyFrame:
    """Return a lazy frame of all rows of the files at `paths`; rows and columns are read only as needed."""
    return pl.scan_parquet(list(paths), hive_partitioning=False, glob=False)


def is_dataset(place: object) -> bool:
    """Return whether a path is a folder with the layout of a dataset."""
    return isinstance(place, str | Path) and any(_folders(Path(place)))


def place(folder: str | Path, session: str) -> Path:
    """Return the path of the file of a session in a dataset's folder, whether it exists or not."""
    return Path(folder) / f"{KEY}{quote(session, safe='')}" / FILE


def sessions(folder: str | Path) -> list[str]:
    """Return the sorted names of the sessions in a dataset's folder; empty if there is no folder."""
    return sorted(unquote(each.name.removeprefix(KEY)) for each in _folders(Path(folder)))


def opened(folder: str | Path, kinds: Sequence[str] = ()) -> Dataset:
    """Return the dataset in a folder, from the metadata of its files; no row is read.

    Args:
        folder: Folder of the sessions.
        kinds: Accepted kinds of table; () accepts any.

    Raises:
        DataError: The folder has no session, or a file is missing, damaged, of another kind, breaks its
            schema, or has other columns than the files before.
    """
    home, name = Path(folder), shown(os.fspath(folder))
    if not home.is_dir():
        raise DataError(f"{name}: no such folder: check the path")
    found = sessions(home)
    if not found:
        raise DataError(f"{name}: no sessions in this folder: a dataset has a file {LAYOUT} for each")
    parts = tuple(_part(each, place(home, each), tuple(kinds) or schema.KINDS) for each in found)
    for part in parts[1:]:
        _require_alike(name, parts[0], part)
    return Dataset(home, parts)


def _folders(home: Path) -> list[Path]:
    """Return the folders of a dataset's sessions."""
    try:
        return [each for each in home.glob(f"{KEY}*") if each.is_dir()]
    except OSError as error:
        raise explained(shown(str(home)), error) from error


def _part(session: str, path: Path, kinds: tuple[str, ...]) -> Part:
    """Read the metadata of a part's file."""
    name = shown(str(path))
    try:
        file = pq.ParquetFile(path)
    except UnicodeDecodeError as error:
        raise DataError(f"{name}: column names must be UTF-8 text: rename them ({error})") from error
    except (FileNotFoundError, IsADirectoryError) as error:
        raise DataError(f"{name}: no such file, but its folder is there: a part is called {FILE}") from error
    except pa.ArrowException as error:
        raise parquet.damaged(name, error) from error
    except OSError as error:
        raise explained(name, error) if error.errno else parquet.damaged(name, error) from error
    with file:
        columns = parquet.columns(file, name)
        footer = (file.metadata.metadata or {}).get(provenance.FOOTER_KEY)
        record = provenance.from_json(footer, name) if footer is not None else None
        kind = record.kind if record is not None else schema.fitting(kinds, columns)
        if kind not in kinds:
            needed = " or ".join(kinds)
            raise DataError(f"{name}: a {shown(kind)} table, but this needs {needed}: give others")
        schema.with_columns(schema.versions(kind), columns).check_columns(columns, name)
        if "session" not in columns:
            raise DataError(f"{name}: a {kind} table has no sessions: give the file, not a folder of them")
        with pa.memory_map(str(path)) as mapped:
            parquet.count(file, memoryview(mapped.read_buffer()).cast("B"), name)
        return Part(session, path, kind, columns, file.metadata.num_rows, _nulls(file.metadata), record)


def _nulls(metadata: pq.FileMetaData) -> frozenset[str]:
    """Return the columns that may have nulls: by their statistics, or because they have no statistics."""
    found = set[str]()
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        for index in range(group.num_columns):
            column = group.column(index)
            counted = column.statistics
            if counted is None or not counted.has_null_count or counted.null_count:
                found.add(column.path_in_schema.split(".")[0])
    return frozenset(found)


def _require_alike(folder: str, first: Part, other: Part) -> None:
    """Check that a part has the kind and columns of the first."""
    names = f"sessions {shown(first.session)} and {shown(other.session)}"
    if other.kind != first.kind:
        raise DataError(
            f"{folder}: {names} are a {first.kind} and a {other.kind} table: keep one kind in a folder"
        )
    differing = [
        f"{shown(name)} ({first.columns.get(name, 'none')}, {other.columns.get(name, 'none')})"
        for name in {**first.columns, **other.columns}
        if first.columns.get(name) != other.columns.get(name)
    ]
    if differing:
        more = f" and {len(differing) - 3} more" if len(differing) > 3 else ""
        raise DataError(
            f"{folder}: {names} have different columns: {', '.join(differing[:3])}{more}: import them "
            "alike, or keep them in separate folders"
        )
