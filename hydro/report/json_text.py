"""Results as JSON text, for the command line and for Python."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import polars as pl

from hydro.core import toml_text

INLINE = ("parameters", "standard_errors")
"""Columns with the values of an effect as inline TOML."""


def json_text(**said: Any) -> str:
    """Return the keyword arguments as the text of one JSON object.

    Tables become lists of rows, and numbers that are not finite become null.

    Args:
        said: Values by name.
    """
    return json.dumps({name: _plain(value) for name, value in said.items()}, allow_nan=False, indent=1)


def _plain(value: Any) -> Any:
    """Return a value in the types that JSON has."""
    if isinstance(value, pl.DataFrame):
        return [_row(row) for row in value.iter_rows(named=True)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return value


def _row(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row of a table, with the fitted values of an effect as an object."""
    apart = {name: toml_text.value(row[name]) if row[name] else {} for name in INLINE if name in row}
    return {name: _plain(value) for name, value in (row | apart).items()}
