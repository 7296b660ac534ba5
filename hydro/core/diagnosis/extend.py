"""What a diagnosis adds to a vehicle: the tables of the effects that it found."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import polars as pl

from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

ADDED = ("missing", "retune", "cannot_tell_apart")
"""Verdicts that come with values."""


def tables(diagnosis: pl.DataFrame, effects: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """The `[[effect]]` tables of a diagnosis' findings, the most telling first.

    Args:
        diagnosis: Diagnosis table.
        effects: Names of the findings that are wanted; all by default.

    Returns:
        Tables with values and `standard_error`.

    Raises:
        DataError: The diagnosis has nothing to add, or not what is wanted.
    """
    rows = diagnosis.sort("rank").filter(pl.col("verdict").is_in(ADDED) & (pl.col("parameters") != ""))
    found = {row["effect"]: row for row in rows.iter_rows(named=True)}
    if not found:
        raise DataError("the diagnosis found nothing to add; see its advice with `hydro show`")
    wanted = list(effects or found)
    for name in wanted:
        if name not in found:
            raise DataError(_refusal(name, rows, list(found)))
    return [_table(found[name]) for name in dict.fromkeys(wanted)]


def extended(vehicle: Vehicle, effects: Sequence[Mapping[str, Any]]) -> Vehicle:
    """The vehicle with these `[[effect]]` tables in the place of those of the same name, or after them.

    Keys that a table does not have stay as they are; those that are None go.
    """
    changed = {table["name"]: table for table in effects}
    kept = [{**effect, **changed.pop(effect["name"], {})} for effect in vehicle.effect]
    every = [{k: v for k, v in table.items() if v is not None} for table in [*kept, *changed.values()]]
    return msgspec.structs.replace(vehicle, effect=tuple(every))


def _table(row: dict[str, Any]) -> dict[str, Any]:
    """One finding as a table."""
    try:
        values: dict[str, Any] = tomllib.loads(f"table = {row['parameters']}")["table"]
        errors: dict[str, Any] = tomllib.loads(f"table = {row['standard_errors'] or '{}'}")["table"]
    except tomllib.TOMLDecodeError as error:
        raise DataError(
            f"the values of {row['effect']} are not inline TOML ({error}); diagnose anew"
        ) from error
    return {"name": row["effect"]} | values | {"standard_error": errors}


def _refusal(name: str, rows: pl.DataFrame, found: Sequence[str]) -> str:
    """Why an effect cannot be added."""
    for row in rows.iter_rows(named=True):
        if name in row["members"]:
            return (
                f"{name} is tied with {row['effect']}, whose values the diagnosis holds; for its own, use "
                f"`hydro fit --effect {name}`"
            )
    return f"the diagnosis has no finding {name} to add; it has {', '.join(found)}"
