"""Arrays of several lengths, one for each sensor, with arrays of their times."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from hydro.core.errors import DataError
from hydro.io.readers.messages import Options, Selection
from hydro.io.readers.tables import TIME

Named = Mapping[str, "np.ndarray[Any, Any]"]
_CLOCK = re.compile(
    r"(?:.*[._/])?(?:t|time|timestamp|timestamps|stamp)(?:_?(?:s|sec|ms|us|ns))?", re.IGNORECASE
)


def table(columns: Named, selection: Selection, options: Options) -> pl.DataFrame | None:
    """Return the wanted columns as a table in which each clock (array of times) has its own rows.

    Rows are sorted by time; a row has values in the columns of its clock only.

    Args:
        columns: All arrays by name, each (n,) with its own length n.
        selection: Wanted columns.
        options: Gets a note that names the clocks.

    Returns:
        Table, or None if the wanted arrays have one length or an array has no clock.

    Raises:
        DataError: The clocks have no time in common.
    """
    clocks = [name for name, each in columns.items() if _CLOCK.fullmatch(name) and _rises(each)]
    asked = selection.columns
    wanted = [name for name in columns if name not in clocks and (asked is None or name in asked)]
    of = {name: _clock_of(name, columns, clocks) for name in wanted}
    if asked is None:
        of = {name: clock for name, clock in of.items() if clock is not None}
    used = [clock for clock in clocks if clock in of.values()]
    if len({len(columns[clock]) for clock in used}) < 2 or None in of.values():
        return None
    _require_overlap(columns, used, options.name)
    parts = []
    for clock in used:
        own = {name: columns[name] for name, its in of.items() if its == clock}
        called = [TIME, *(each for each in clocks if asked is None or each in asked)]
        times = dict.fromkeys(called, columns[clock])
        parts.append(pl.DataFrame({**times, **own}))
    options.notes.append(
        f"arrays of several lengths: those of each clock ({', '.join(used)}) have rows of their own, "
        f"by the column {TIME}"
    )
    if asked is None and (rest := [name for name in wanted if name not in of]):
        options.notes.append(f"left out, because no times have their length: {', '.join(rest[:8])}")
    return pl.concat(parts, how="diagonal_relaxed").sort(TIME, maintain_order=True)


def _rises(values: np.ndarray[Any, Any]) -> bool:
    """Return whether an array increases, so that it may contain times."""
    return bool(np.isfinite(values).all() and (np.diff(values) >= 0).all() and values[-1] > values[0])


def _clock_of(name: str, columns: Named, clocks: Sequence[str]) -> str | None:
    """Return the name of an array's clock: the one with its length and the most similar name; None if none.

    Args:
        name: Name of the array.
        columns: All arrays by name.
        clocks: Names of the clocks.
    """
    same = [each for each in clocks if len(columns[each]) == len(columns[name])]
    return max(same, key=lambda each: _alike(each, name), default=None)


def _alike(first: str, second: str) -> int:
    """Return the length of the common beginning of two names."""
    return next(
        (place for place, (a, b) in enumerate(zip(first, second, strict=False)) if a != b),
        min(len(first), len(second)),
    )


def _require_overlap(columns: Named, clocks: Sequence[str], name: str) -> None:
    """Check that clocks have the same epoch and unit: their ranges must overlap."""
    for other in clocks[1:]:
        first, second = columns[clocks[0]], columns[other]
        if min(first[-1], second[-1]) <= max(first[0], second[0]):
            raise DataError(
                f"{name}: the clocks {clocks[0]} ({first[0]:g} to {first[-1]:g}) and {other} "
                f"({second[0]:g} to {second[-1]:g}) have no time in common: save them in one unit"
            )
