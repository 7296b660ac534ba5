"""The schema files: what every column of every table is, and the checks that hold a table to it.

A schema is a Frictionless Table Schema (v2) file in `schemas/`, with these keys beyond the standard.

Of a field:

* `arrowType`: the storage types accepted, the widest last;
* `unit`, `frame`, and `source`: an equation, a paper, or the part of hydro that a column comes from.  All of
  them are in the digest that footers carry, so that a source keeps its name when code moves;
* `repeat`: a field named `cmd_{n}` with `"repeat": "n"` stands for the columns `cmd_1 ... cmd_n`; all fields
  that repeat by the same letter come equally often;
* `optional`: the column, or all that repeat, may be absent.  A field that is not `required` may have nulls.

Of a table:

* `extends`: the table whose fields come first;
* `series`: the `key` columns name a recording, whose rows stand together and along which `time` increases.
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
"""Where the schema files are: inside an installed package, or beside it in a checkout."""

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
    "sessions",
    "covariance",
    "bands",
    "run",
    "curves",
    "evaluations",
    "episodes",
    "policy",
)
"""The kinds of table that hydro reads and writes."""

VERSIONS = {
    "raw": 3, "labels": 3, "split": 3, "commands": 2, "curves": 2, "evaluations": 2, "episodes": 2
}  # fmt: skip
"""How many versions of a kind's schema there are, where it is more than one.

A later one, in a file such as `raw-2.json`, admits nulls or columns that an earlier one refuses; every table
is held to, and written as, the first that admits it, so that a table's bytes do not change when a version is
added.  What a later version extends is of that version too, where it has as many.
"""


class Series(Part, frozen=True):
    """Rows of one recording share `key`, stand together, and `time` increases along them."""

    key: tuple[str, ...]
    time: str


class _File(Part, frozen=True):
    """A schema file as it stands."""

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
    """The schema of one kind of table, with what it extends already in place."""

    kind: str
    title: str
    description: str
    fields: tuple[Field, ...]
    primary_key: tuple[str, ...]
    series: Series | None

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the rules, independent of how the schema file is laid out."""
        content = (self.kind, self.fields, self.primary_key, self.series)
        return "sha256:" + hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()

    def columns(self, names: Iterable[str]) -> dict[str, Field]:
        """The fields by column name, in order, as often as the columns `names` repeat them."""
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
        """The same table with the columns of this schema in its order, each as a type that it accepts.

        No value is lost: a column without any value gets its type, whole numbers become wider ones or floats,
        and a column that need not be there is filled with nulls.  Whatever else breaks the schema stays as it
        is, for `check` to refuse; columns that the schema does not know come last.

        Args:
            frame: the table; it may be empty, or even have no columns.
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
        """Hold a table to this schema: columns, types, finite values, bounds, order of time.

        Args:
            frame: the table.
            source: what error lines call it, usually the file's name.

        Returns:
            The same table with its columns in the schema's order (no value is copied or changed).

        Raises:
            DataError: the first rule that is broken, how often, and the first row (rows count from 0).
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
                _again(frame, self.primary_key),
            )
        return frame

    def check_columns(self, types: Mapping[str, str], source: str) -> None:
        """Hold column names and storage types (such as `float32`) to this schema.

        Raises:
            DataError: columns are missing, are too many, or are stored as the wrong type.
        """
        columns = self.columns(types)
        missing = [field.label for name, field in columns.items() if name not in types]
        if missing:
            raise DataError(
                f"{source}: {_columns(missing)} missing: a {self.kind} table needs {_them(missing)}"
            )
        extra = [name for name in types if name not in columns]
        if extra:
            raise DataError(
                f"{source}: {_columns(extra)} not part of a {self.kind} table: drop {_them(extra)}"
            )
        for name, field in columns.items():
            if types[name] not in field.arrow_type:
                accepted = " or ".join(field.arrow_type)
                raise DataError(
                    f"{source}: {field.label} must be {accepted}, but is {types[name]}: convert the column"
                )

    def _check_series(self, frame: pl.DataFrame, source: str) -> None:
        """Each recording in one piece, its time increasing."""
        assert self.series is not None
        key, time = self.series.key, self.series.time
        label = next(field.label for field in self.fields if field.name == time)
        place = " and ".join(key)
        runs = [np.diff(frame[name].rle_id().to_numpy(), prepend=-1) for name in key]
        starts = np.flatnonzero(np.any(runs, axis=0))
        again = starts[_again(frame[starts], key)]
        self._refuse(frame, source, f"rows of one {place} must be together", again)
        step = np.diff(frame[time].to_numpy())
        step[starts[1:] - 1] = 1.0
        self._refuse(frame, source, f"{label} must be unique within a {place}", np.flatnonzero(step == 0) + 1)
        self._refuse(
            frame, source, f"{label} must be increasing within a {place}", np.flatnonzero(step < 0) + 1
        )

    def _refuse(self, frame: pl.DataFrame, source: str, rule: str, bad: Rows) -> None:
        """Raise the error line for the rows that break `rule`, if there are any."""
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
    """The schema of a kind of table, read from its file.

    Raises:
        DataError: there is no such kind.
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
    """The first version of a kind's schema that admits the nulls and columns of a table.

    The first of all where none does: what it refuses is what is said of the table.

    Raises:
        DataError: there is no such kind.
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
    """All versions of a kind's schema, the first one first.

    Raises:
        DataError: there is no such kind.
    """
    return [load(kind, version) for version in range(1, VERSIONS.get(kind, 1) + 1)]


def with_columns(rules: list[Schema], names: Iterable[str]) -> Schema:
    """The first of some versions of a schema that leaves the fewest columns of a table unknown."""
    given = set(names)
    return min(rules, key=lambda one: len(given - one.columns(given).keys()))


def fitting(wanted: Iterable[str], columns: Mapping[str, str]) -> str:
    """The kind, of those wanted, whose columns differ least from these."""

    def unlike(kind: str) -> int:
        return min(len(rules.columns(columns).keys() ^ columns.keys()) for rules in versions(kind))

    return min(wanted, key=unlike)


def storage_type(dtype: pl.DataType) -> str:
    """The name by which schema files call a polars type, such as `float32` or `list<int64>`."""
    if isinstance(dtype, pl.List):
        return f"list<{storage_type(dtype.inner)}>"  # type: ignore[arg-type]
    return "string" if dtype in (pl.String, pl.Categorical, pl.Enum) else str(dtype).lower()


def _accepted(field: Field, dtype: pl.DataType) -> pl.DataType:
    """The type that holds all values of `dtype` in this field; `dtype` itself where none does."""
    if dtype in (pl.Categorical, pl.Enum):
        return pl.String()
    fits = storage_type(dtype) in field.arrow_type or not _widens(dtype, field.widest)
    return dtype if fits else field.widest


def _widens(dtype: pl.DataType, to: pl.DataType) -> bool:
    """Whether every value of one type is a value of the other."""
    if isinstance(dtype, pl.List) and isinstance(to, pl.List):
        return _widens(_inner(dtype), _inner(to))
    whole = dtype.is_integer() and dtype != pl.UInt64
    return dtype == pl.Null or (whole and to in (pl.Int64, pl.Float64))


def _inner(dtype: pl.List) -> pl.DataType:
    """Type of a list's entries."""
    return dtype.inner() if isinstance(dtype.inner, type) else dtype.inner


def _repeats(field: Field, names: set[str]) -> int:
    """How many columns among `names` a repeated field accounts for."""
    pattern = re.escape(field.name).replace(re.escape(f"{{{field.repeat}}}"), "[1-9][0-9]*")
    return sum(re.fullmatch(pattern, name) is not None for name in names)


def _columns(names: list[str]) -> str:
    """`column a is`, or `columns a, b are`, of at most eight names."""
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    named = ", ".join(shown(name) for name in names[:8]) + more
    return f"column {named} is" if len(names) == 1 else f"columns {named} are"


def _them(names: list[str]) -> str:
    return "it" if len(names) == 1 else "them"


def _again(frame: pl.DataFrame, key: tuple[str, ...]) -> Rows:
    """Rows whose `key` another row had before."""
    return np.flatnonzero(~frame.select(pl.struct(key).is_first_distinct()).to_series().to_numpy())
