"""Schema files: definitions of all columns of all tables, and the checks of a table.

A schema is a Frictionless Table Schema (v2) file in `schemas/`, with some additional keys.

Keys of a field:

* `arrowType`: accepted storage types, the widest last;
* `unit`, `frame`, and `source`: an equation, a paper, or the part of hydro that computes the column.  They
  are part of the digest in footers, so a source keeps its name when code moves;
* `repeat`: a field named `cmd_{n}` with `"repeat": "n"` represents the columns `cmd_1 ... cmd_n`; all fields
  with the same letter repeat equally often;
* `optional`: the column, or all repeated columns, may be absent.  A field that is not `required` may be null.

Keys of a table:

* `extends`: table whose fields come first;
* `series`: the `key` columns name a recording.  Its rows are contiguous, and `time` increases along them.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import msgspec
import numpy as np
import polars as pl

from hydro.core.errors import DataError
from hydro.io.files import shown
from hydro.io.schema_field import Field, Part, Rows, broken

_PACKAGED = Path(__file__).resolve().parents[1] / "_schemas"
FOLDER = _PACKAGED if _PACKAGED.is_dir() else Path(__file__).resolve().parents[2] / "schemas"
"""Folder of the schema files: in an installed package, or in a checkout."""

KINDS = (
    "raw",
    "labels",
    "split",
    "blocks",
    "features",
    "model",
    "metrics",
    "replay",
    "commands",
    "comparison",
    "diagnosis",
    "ladder",
    "leftover",
    "growth",
    "history",
    "sessions",
    "covariance",
    "bands",
    "run",
    "curves",
    "evaluations",
    "episodes",
    "policy",
)
"""Kinds of table that hydro reads and writes."""

VERSIONS = {
    "raw": 3, "labels": 3, "split": 3, "commands": 2, "curves": 2, "evaluations": 2, "episodes": 2
}  # fmt: skip
"""Number of versions of a kind's schema, if there are several.

A later version, in a file such as `raw-2.json`, allows nulls or columns that an earlier one does not.  Every
table is checked by, and written with, the first version that allows it.  So its bytes do not change when a
version is added.  A later version extends the same version of its parent, if the parent has as many.
"""


class Series(Part, frozen=True):
    """Rule for time series in a table.

    Attributes:
        key: Columns whose values name a series; its rows are contiguous.
        time: Column that increases within a series.
    """

    key: tuple[str, ...]
    time: str


class _File(Part, frozen=True):
    """Schema file as parsed."""

    schema: str = msgspec.field(name="$schema")
    name: str
    title: str
    description: str
    fields: tuple[Field, ...]
    fields_match: str = "equal"
    missing_values: tuple[str, ...] = ()
    extends: str | None = None
    primary_key: tuple[str, ...] = ()
    series: Series | None = None


@dataclass(frozen=True)
class Schema:
    """Rules for one kind of table, including the fields of the table that it extends.

    Attributes:
        kind: Name of the kind.
        title: Title of the kind.
        description: Description of the kind.
        fields: Rules of the columns.
        primary_key: Columns whose values together are different in every row.
        series: Rule for time series; None for other tables.
    """

    kind: str
    title: str
    description: str
    fields: tuple[Field, ...]
    primary_key: tuple[str, ...]
    series: Series | None

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the rules, which does not depend on the layout of the schema file."""
        content = (self.kind, self.fields, self.primary_key, self.series)
        return "sha256:" + hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()

    def columns(self, names: Iterable[str]) -> dict[str, Field]:
        """Return the fields (rules of columns) of a table by column name, in the schema's order.

        Args:
            names: Columns of the table; a repeated field occurs as often as its columns are among them.
        """
        names = set(names)
        times: dict[str, int] = {}
        for field in self.fields:
            if field.repeat is not None:
                least = times.get(field.repeat, 0 if field.optional else 1)
                times[field.repeat] = max(least, _repeats(field, names))
        columns: dict[str, Field] = {}
        for field in self.fields:
            if field.repeat is not None:
                repeated = (field.column(number) for number in range(1, times[field.repeat] + 1))
                columns.update((column.name, column) for column in repeated)
            elif not field.optional or field.name in names:
                columns[field.name] = field
        return columns

    def conform(self, frame: pl.DataFrame) -> pl.DataFrame:
        """Return a copy of a table with the columns of this schema in its order, each in an accepted type.

        No value is lost: an all-null column gets its type, integers become wider or floats, and an optional
        missing column is filled with nulls.  Other violations stay for `check` to refuse.  Unknown columns
        come last.

        Args:
            frame: Table; it may be empty, or have no columns.
        """
        given, rows = frame.schema, frame.height
        types = {
            name: _accepted(field, given[name]) if name in given else field.widest
            for name, field in self.columns(given).items()
            if name in given or rows == 0 or not field.constraints.required
        }
        extra = {name: dtype for name, dtype in given.items() if name not in types}
        if rows == 0:
            return pl.DataFrame(schema=types | extra)
        made = [
            pl.col(name).cast(dtype) if name in given else pl.lit(None, dtype).alias(name)
            for name, dtype in types.items()
        ]
        return frame.select(*made, *extra)

    def check(self, frame: pl.DataFrame, source: str) -> pl.DataFrame:
        """Check a table against this schema: columns, types, finite values, bounds, order of time.

        Args:
            frame: The table.
            source: Name in error messages, usually the file's name.

        Returns:
            The same table with its columns in the schema's order; no value is copied or changed.

        Raises:
            DataError: A rule is broken; the message has the first rule, the count and the first row from 0.
        """
        types = dict(frame.schema)
        self.check_columns({name: storage_type(dtype) for name, dtype in types.items()}, source)
        columns = self.columns(types)
        coded = [name for name in columns if types[name] in (pl.Categorical, pl.Enum)]
        frame = frame.select(list(columns)).cast(dict.fromkeys(coded, pl.String))
        if frame.height == 0:
            raise DataError(f"{source}: no rows: a {self.kind} table needs at least one")
        for name, field in columns.items():
            for rule, bad in broken(field, frame[name]):
                self._refuse(frame, source, f"{field.label} must be {rule}", bad)
        if self.series is not None:
            self._check_series(frame, source)
        elif self.primary_key:
            self._refuse(
                frame,
                source,
                f"{', '.join(self.primary_key)} must be unique",
                _repeated(frame, self.primary_key),
            )
        return frame

    def check_columns(self, types: Mapping[str, str], source: str) -> None:
        """Check column names and storage types (such as `float32`) against this schema.

        Args:
            types: Storage type of each column.
            source: Name in error messages.

        Raises:
            DataError: Columns are missing, unknown, or of the wrong type.
        """
        columns = self.columns(types)
        missing = [field.label for name, field in columns.items() if name not in types]
        if missing:
            raise DataError(
                f"{source}: {_columns(missing)} missing: a {self.kind} table needs {_pronoun(missing)}"
            )
        extra = [name for name in types if name not in columns]
        if extra:
            raise DataError(
                f"{source}: {_columns(extra)} not part of a {self.kind} table: drop {_pronoun(extra)}"
            )
        for name, field in columns.items():
            if types[name] not in field.arrow_type:
                accepted = " or ".join(field.arrow_type)
                raise DataError(
                    f"{source}: {field.label} must be {accepted}, but is {types[name]}: convert the column"
                )

    def _check_series(self, frame: pl.DataFrame, source: str) -> None:
        """Check that each recording is contiguous and its time increases."""
        assert self.series is not None
        key, time = self.series.key, self.series.time
        label = next(field.label for field in self.fields if field.name == time)
        place = " and ".join(key)
        runs = [np.diff(frame[name].rle_id().to_numpy(), prepend=-1) for name in key]
        starts = np.flatnonzero(np.any(runs, axis=0))
        again = starts[_repeated(frame.select(key)[starts], key)]
        self._refuse(frame, source, f"rows of one {place} must be together", again)
        step = np.diff(frame[time].to_numpy())
        step[starts[1:] - 1] = 1.0
        self._refuse(frame, source, f"{label} must be unique within a {place}", np.flatnonzero(step == 0) + 1)
        self._refuse(
            frame, source, f"{label} must be increasing within a {place}", np.flatnonzero(step < 0) + 1
        )

    def _refuse(self, frame: pl.DataFrame, source: str, rule: str, bad: Rows) -> None:
        """Raise an error that states `rule`, if there are rows `bad` that break it."""
        if bad.size == 0:
            return
        first = int(bad[0])
        where = [f"row {first}"]
        if self.series is not None:
            where += [f"{name} {shown(str(frame[name][first]))}" for name in self.series.key]
        verb = "is" if bad.size == 1 else "are"
        count = f"{bad.size} of {frame.height} rows {verb} not"
        raise DataError(f"{source}: {rule}: {count} (first: {', '.join(where)})")


@cache
def load(kind: str, version: int = 1) -> Schema:
    """Return the schema of a kind of table, read from its file.

    Raises:
        DataError: There is no such kind.
    """
    if kind not in KINDS:
        raise DataError(f"{kind}: no such kind of table: the kinds are {', '.join(KINDS)}")
    name = kind if version == 1 else f"{kind}-{version}"
    file = msgspec.json.decode((FOLDER / f"{name}.json").read_bytes(), type=_File)
    parent = load(file.extends, min(version, VERSIONS.get(file.extends, 1))) if file.extends else None
    return Schema(
        kind=kind,
        title=file.title,
        description=file.description,
        fields=(*(parent.fields if parent else ()), *file.fields),
        primary_key=file.primary_key or (parent.primary_key if parent else ()),
        series=file.series or (parent.series if parent else None),
    )


def suited(kind: str, frame: pl.DataFrame) -> Schema:
    """Return the first version of a kind's schema that allows the nulls and columns of a table.

    If no version does, return the first one, whose check then gives the error.

    Args:
        kind: Kind of table, such as `raw`.
        frame: The table; not changed.

    Raises:
        DataError: There is no such kind.
    """
    empty = {name for name in frame.columns if frame[name].null_count()}
    admitting = [
        rules
        for rules in versions(kind)
        if not any(
            field.constraints.required and name in empty
            for name, field in rules.columns(frame.columns).items()
        )
    ]
    return with_columns(admitting or [load(kind)], frame.columns)


def versions(kind: str) -> list[Schema]:
    """Return the schemas of all versions of a kind of table, the first version first.

    Raises:
        DataError: There is no such kind.
    """
    return [load(kind, version) for version in range(1, VERSIONS.get(kind, 1) + 1)]


def with_columns(rules: list[Schema], names: Iterable[str]) -> Schema:
    """Return the version of a schema that leaves the fewest columns of a table unknown.

    Of equal ones, the first.

    Args:
        rules: Versions of the schema.
        names: Columns of the table.
    """
    given = set(names)
    return min(rules, key=lambda one: len(given - one.columns(given).keys()))


def fitting(wanted: Iterable[str], columns: Mapping[str, str]) -> str:
    """Return the kind of table, one of `wanted`, whose columns differ least from the given columns.

    Args:
        wanted: Kinds of table.
        columns: Storage type of each given column.
    """

    def unlike(kind: str) -> int:
        return min(len(rules.columns(columns).keys() ^ columns.keys()) for rules in versions(kind))

    return min(wanted, key=unlike)


def storage_type(dtype: pl.DataType) -> str:
    """Return the name of a polars type in schema files, such as `float32` or `list<int64>`."""
    if isinstance(dtype, pl.List):
        return f"list<{storage_type(dtype.inner)}>"  # type: ignore[arg-type]
    return "string" if dtype in (pl.String, pl.Categorical, pl.Enum) else str(dtype).lower()


def _accepted(field: Field, dtype: pl.DataType) -> pl.DataType:
    """Return the type that holds all values of `dtype` in this field, or `dtype` if none does."""
    if dtype in (pl.Categorical, pl.Enum):
        return pl.String()
    fits = storage_type(dtype) in field.arrow_type or not _widens(dtype, field.widest)
    return dtype if fits else field.widest


def _widens(dtype: pl.DataType, to: pl.DataType) -> bool:
    """Return whether every value of the type `dtype` is also a value of the type `to`."""
    if isinstance(dtype, pl.List) and isinstance(to, pl.List):
        return _widens(_inner(dtype), _inner(to))
    whole = dtype.is_integer() and dtype != pl.UInt64
    return dtype == pl.Null or (whole and to in (pl.Int64, pl.Float64))


def _inner(dtype: pl.List) -> pl.DataType:
    """Return the type of a list's entries."""
    return dtype.inner() if isinstance(dtype.inner, type) else dtype.inner


def _repeats(field: Field, names: set[str]) -> int:
    """Return the number of columns in `names` that belong to a repeated field."""
    pattern = re.escape(field.name).replace(re.escape(f"{{{field.repeat}}}"), "[1-9][0-9]*")
    return sum(re.fullmatch(pattern, name) is not None for name in names)


def _columns(names: list[str]) -> str:
    """Return `column a is` or `columns a, b are`, with at most eight of the names."""
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    named = ", ".join(shown(name) for name in names[:8]) + more
    return f"column {named} is" if len(names) == 1 else f"columns {named} are"


def _pronoun(names: list[str]) -> str:
    return "it" if len(names) == 1 else "them"


def _repeated(frame: pl.DataFrame, key: tuple[str, ...]) -> Rows:
    """Return the rows whose `key` occurred in an earlier row."""
    return np.flatnonzero(~frame.select(pl.struct(key).is_first_distinct()).to_series().to_numpy())
