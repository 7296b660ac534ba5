"""Columns that say which samples of a sensor count, by their names beside it: `velocity_valid`, `valid`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hydro.core.logs.logmap import BLOCKS

Block = dict[str, Any]


def validity(names: Sequence[str], blocks: Mapping[str, Block]) -> dict[str, str]:
    """Return the column that says which samples count, by the name of the block; of those that have one.

    Args:
        names: The log's columns.
        blocks: The blocks of a map; those that say `valid` already are left out.
    """
    there = set(names)
    found = {}
    for name in BLOCKS:
        block = blocks.get(name, {})
        columns = block.get("columns") or block.get("quaternion") or ()
        if "valid" in block or not columns or not isinstance(columns[0], str):
            continue
        column = next((each for each in _candidates(columns[0], name) if each in there), None)
        if column is not None:
            found[name] = column
    return found


def _candidates(column: str, name: str) -> Iterator[str]:
    """Yield what a column of validity may be called beside a column of the block, the nearest first."""
    stem = column
    while (cut := max(stem.rfind("."), stem.rfind("_"))) > 0:
        stem = stem[:cut]
        yield from (f"{stem}_valid", f"{stem}.valid", f"{stem}.{name}_valid")
