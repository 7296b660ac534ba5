"""`--json`: results for programs, in the place of what a person reads."""

from __future__ import annotations

import math
from typing import Annotated, Any

import typer

from hydro.commands.shell import STREAM, shows_table

INLINE = ("parameters", "standard_errors")
"""Columns that hold values of an effect as one line of TOML."""

Json = Annotated[
    bool,
    typer.Option("--json", help="Print JSON to stdout, and the answer to stderr."),
]


def saves(output: str, as_json: bool) -> bool:
    """Whether the table itself is written: to a file, or to a pipe that is not for JSON."""
    return output != STREAM or not (as_json or shows_table(output))


def print_json(**said: Any) -> None:
    """Print one object; tables become lists of their rows, and numbers that are none become null."""
    import json

    typer.echo(json.dumps({name: _plain(value) for name, value in said.items()}, allow_nan=False, indent=1))


def _plain(value: Any) -> Any:
    """A value in what JSON has."""
    import polars as pl

    if isinstance(value, pl.DataFrame):
        return [_row(row) for row in value.iter_rows(named=True)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return value


def _row(row: dict[str, Any]) -> dict[str, Any]:
    """A row of a table, values of an effect taken apart."""
    from hydro.core import toml_text

    apart = {name: toml_text.value(row[name]) if row[name] else {} for name in INLINE if name in row}
    return {name: _plain(value) for name, value in (row | apart).items()}
