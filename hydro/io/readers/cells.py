"""Numbers in text cells with decimal commas or units."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

_COMMA = r"^(\s*[-+]?\d*),(\d+(?:[eE][-+]?\d+)?\s*[A-Za-z°%µμ/]*\s*)$"
_NUMBER = r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
_UNIT = r"([A-Za-z°%µμ][A-Za-z0-9°%µμ/^*·]*)\s*$"
_MAX_NAMES = 6
"""Number of columns that a note names."""


def with_points(frame: pl.DataFrame, notes: list[str]) -> pl.DataFrame:
    """Return a table of texts with decimal commas replaced by points, in columns without decimal points.

    This is only for tables whose separator is not a comma: there a comma in a number is a decimal comma.

    Args:
        frame: Columns of text.
        notes: A line that names the columns is appended.
    """
    changed = {}
    for name in frame.columns:
        values = frame[name]
        commas = values.str.contains(_COMMA).fill_null(False)
        if (
            commas.any()
            and not values.str.contains(_NUMBER + "$").filter(values.str.contains(".", literal=True)).any()
        ):
            changed[name] = values.str.replace(_COMMA, "${1}.${2}")
    if changed:
        notes.append(f"decimal commas are read as points in {_listed(list(changed))}")
    return frame.with_columns(**changed)


def without_units(frame: pl.DataFrame, notes: list[str]) -> pl.DataFrame:
    """Return a table of texts without the units after numbers, in columns with one unit or none per cell.

    Args:
        frame: Columns of text.
        notes: A line that names the columns and their units is appended.
    """
    changed, told = {}, []
    for name in frame.columns:
        first = frame[name].drop_nulls().head(1)
        if not first.len() or not first.str.contains(_NUMBER + _UNIT)[0]:
            continue
        values = frame[name]
        numbers = values.str.extract(_NUMBER + "(?:" + _UNIT[:-1] + r")?$", 1)
        units = values.str.extract(_NUMBER + _UNIT, 2).drop_nulls().unique()
        if units.len() == 1 and numbers.null_count() == values.null_count():
            changed[name] = numbers
            told.append(f"{name} [{units[0]}]")
    if changed:
        notes.append(f"units at the end of cells are left out, check them against the map: {_listed(told)}")
    return frame.with_columns(**changed)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else ""
    return ", ".join(names[:_MAX_NAMES]) + more
