"""Base of all results: a headline around a polars table."""

from __future__ import annotations

import functools
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, overload

from hydro.api import printed

if TYPE_CHECKING:
    import numpy as np
    import polars as pl
    from numpy.typing import NDArray

    from hydro.report.result_axes import Axes

T = TypeVar("T")


@dataclass(frozen=True, eq=False, repr=False)
class Result(ABC):
    """Answer of a function of `hydro`: a headline around a polars table.

    Methods and attributes of a polars frame work on a result and refer to `table`: `.filter`, `.select`,
    `["column"]`, `len`, iteration over columns, `.columns`, `.to_dicts()` and so on. Only `plot` differs from
    that of a frame. Functions that require a polars frame, such as `frame.join` and `pl.concat`, take
    `table`.

    Two results are equal if all their values are; a missing number equals another.

    Attributes:
        table: The table, with the columns of its schema.
    """

    table: pl.DataFrame

    units: ClassVar[Mapping[str, str]] = {}
    """Units of the columns of `summary` whose unit is the same in all rows."""

    @property
    @abstractmethod
    def headline(self) -> str:
        """Result of the function in one or two sentences."""

    @abstractmethod
    def summary(self) -> pl.DataFrame:
        """Return a new, short table of the most important results, which is printed below the headline."""

    @abstractmethod
    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> NDArray[np.object_]:
        """Draw the result.

        Args:
            axes: Matplotlib axes to draw into, as many as are returned; by default a new figure's.

        Returns:
            The axes into which it drew, (n,); `axes[0].figure` is the figure.
        """

    @abstractmethod
    def to_json(self) -> str:
        """Return the result as JSON text; a number that is missing or not finite is null."""

    @property
    def footer(self) -> dict[str, Any]:
        """Numbers and sentences that `hydro.write` stores in the file with the table."""
        return {}

    def _above(self) -> Sequence[str]:
        """Sentences that are printed before the short table, the headline first."""
        return (self.headline,)

    def _below(self) -> Sequence[str]:
        """Sentences that are printed after the short table."""
        return ()

    def filter(self, *predicates: Any, **constraints: Any) -> pl.DataFrame:
        """Return the rows of `table` that fulfil conditions, as `polars.DataFrame.filter` does."""
        return self.table.filter(*predicates, **constraints)

    def select(self, *columns: Any, **named: Any) -> pl.DataFrame:
        """Return a new frame with some columns of `table`, as `polars.DataFrame.select` does."""
        return self.table.select(*columns, **named)

    def __repr__(self) -> str:
        return printed.text(self._above(), self.summary(), self._below(), self.units)

    def _repr_html_(self) -> str:
        """Return the printed text of the result as HTML, for a notebook."""
        return printed.html(self._above(), self.summary(), self._below(), self.units)

    def __eq__(self, other: object) -> bool:
        return same(self, other)

    def __len__(self) -> int:
        return self.table.height

    def __iter__(self) -> Iterator[Any]:
        return iter(self.table)

    def __getitem__(self, key: Any) -> Any:
        return self.table[key]

    def __contains__(self, name: object) -> bool:
        return name in self.table.columns

    def __array__(self, *given: Any, **named: Any) -> NDArray[Any]:
        return self.table.__array__(*given, **named)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """The table for every library that reads Arrow: `pl.DataFrame(result)`, `pyarrow.table(result)`."""
        return self.table.__arrow_c_stream__(requested_schema)

    def __getattr__(self, name: str) -> Any:
        if name == "table" or name.startswith("__"):  # not there yet while it is unpickled
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        found = getattr(self.table, name)
        return _of_frames(found) if inspect.ismethod(found) else found

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *dir(self.table)})


def _of_frames(method: Callable[..., Any]) -> Callable[..., Any]:
    """Return a version of a polars method that also accepts results, as in `found.equals(other)`."""

    @functools.wraps(method)
    def called(*given: Any, **named: Any) -> Any:
        return method(*map(frame_of, given), **{name: frame_of(one) for name, one in named.items()})

    return called


@overload
def frame_of(table: Result) -> pl.DataFrame: ...
@overload
def frame_of(table: T) -> T: ...
def frame_of(table: Any) -> Any:
    """Return the polars frame of a `Result`; return any other value, such as a frame, unchanged."""
    return table.table if isinstance(table, Result) else table


def same(one: Any, other: Any) -> bool:
    """Return whether two values are equal: tables and arrays entry by entry, with NaN equal to NaN."""
    import numpy as np
    import polars as pl

    if type(one) is not type(other):
        return False
    if isinstance(one, pl.DataFrame):
        return one.schema == other.schema and one.equals(other)
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if is_dataclass(one):
        return all(same(getattr(one, each.name), getattr(other, each.name)) for each in fields(one))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other) or (one != one and other != other)
