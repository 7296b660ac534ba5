"""One column of a table in a schema file: its types, and the rules for its values."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np
import numpy.typing as npt
import polars as pl

Rows = npt.NDArray[np.intp]


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """Base class of the parts of a schema file; an unknown key is an error, since nothing would check it."""


_POLARS: dict[str, pl.DataType] = {
    "string": pl.String(),
    "boolean": pl.Boolean(),
    "int64": pl.Int64(),
    "float32": pl.Float32(),
    "float64": pl.Float64(),
}
_POLARS |= {f"list<{name}>": pl.List(dtype) for name, dtype in _POLARS.items()}
"""Polars types by their names in schema files."""


class Constraints(Part, frozen=True):
    """Rules for the values of a column; numbers must also be finite.

    Attributes:
        required: Whether nulls are forbidden.
        unique: Whether no value may occur twice.
        minimum: Least number; None for no limit.
        maximum: Greatest number; None for no limit.
        min_length: Least number of characters of a text; None for no limit.
        pattern: Regular expression that a text must match; None for none.
        enum: Allowed texts; None for all.
    """

    required: bool = False
    unique: bool = False
    minimum: float | None = None
    maximum: float | None = None
    min_length: int | None = None
    pattern: str | None = None
    enum: tuple[str, ...] | None = None


class Field(Part, frozen=True):
    """Rules of one column of a table, or of several numbered columns.

    Attributes:
        name: Name of the column; with `repeat` it contains the placeholder of the number.
        type: Type in the schema file.
        arrow_type: Accepted storage types, the widest last.
        description: Description of the column.
        unit: Unit; None for none.
        frame: Coordinate frame; None for none.
        source: Source of the definition; None for none.
        repeat: Placeholder of the number in the names of repeated columns; None for one column.
        optional: Whether the column may be absent.
        constraints: Rules for the values.
    """

    name: str
    type: str
    arrow_type: tuple[str, ...]
    description: str
    unit: str | None = None
    frame: str | None = None
    source: str | None = None
    repeat: str | None = None
    optional: bool = False
    constraints: Constraints = Constraints()

    def column(self, number: int) -> Field:
        """Return a copy of a repeated field for one of its columns, with `number` in its name."""
        assert self.repeat is not None
        name = self.name.replace(f"{{{self.repeat}}}", str(number))
        return msgspec.structs.replace(self, name=name, repeat=None)

    @property
    def widest(self) -> pl.DataType:
        """Polars type of the column that can hold most values: the last of the accepted types."""
        return _POLARS[self.arrow_type[-1]]

    @property
    def label(self) -> str:
        """Name of the column with its unit, for error messages."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def broken(field: Field, values: pl.Series) -> Iterator[tuple[str, Rows]]:
    """Yield each rule that a column breaks, with the indices of the rows that break the rule.

    Args:
        field: Rules of the column.
        values: The column.
    """
    rules = field.constraints
    if rules.required and values.null_count():
        yield "present", _rows(values.is_null())
    if values.dtype == pl.String:
        yield from _broken_texts(rules, values)
    elif values.dtype.is_numeric():
        yield from _broken_numbers(rules, values)
    elif isinstance(values.dtype, pl.List) and values.dtype.inner.is_float():
        yield "finite", np.flatnonzero([not numbers.is_finite().all() for numbers in values])
    if rules.unique and values.n_unique() < len(values):
        yield "unique", _rows(~values.is_first_distinct())


def _broken_numbers(rules: Constraints, values: pl.Series) -> Iterator[tuple[str, Rows]]:
    """Yield the broken rules of a column of numbers, each with the rows that break it."""
    numbers = (values.drop_nulls() if values.null_count() else values).to_numpy()
    if numbers.size == 0:
        return
    least, greatest = numbers.min(), numbers.max()  # a NaN anywhere makes both NaN
    if not (np.isfinite(least) and np.isfinite(greatest)):
        yield "finite", _rows(~values.is_finite())
    if rules.minimum is not None and least < rules.minimum:
        yield f"at least {rules.minimum:g}", _rows(values < rules.minimum)
    if rules.maximum is not None and greatest > rules.maximum:
        yield f"at most {rules.maximum:g}", _rows(values > rules.maximum)


def _broken_texts(rules: Constraints, values: pl.Series) -> Iterator[tuple[str, Rows]]:
    """Yield the broken rules of a column of texts, length, pattern and allowed values, with their rows."""
    if rules.min_length is not None:
        yield f"at least {rules.min_length} character long", _rows(values.str.len_chars() < rules.min_length)
    if rules.pattern is not None:
        yield f"like {rules.pattern}", _rows(~values.str.contains(f"^(?:{rules.pattern})$"))
    if rules.enum is not None:
        yield f"one of {', '.join(rules.enum)}", _rows(~values.is_in(rules.enum))


def _rows(broken: pl.Series) -> Rows:
    """Return the rows where a polars condition is true."""
    return np.flatnonzero((broken.fill_null(False) if broken.null_count() else broken).to_numpy())
