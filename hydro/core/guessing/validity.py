"""Columns that mark valid samples of a sensor, found by name: `velocity_valid`, `valid`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hydro.core.logs.logmap import BLOCKS

Block = dict[str, Any]


def validity(names: Sequence[str], blocks: Mapping[str, Block]) -> dict[str, str]:
    """Return the columns that mark valid samples of a sensor, found by their names.

    Args:
        names: The log's columns.
        blocks: The blocks of a map by name (a block says which columns hold one quantity); blocks with
            `valid` are skipped.

    Returns:
        The column by the name of the block, for blocks that have one.
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
    """Yield possible names of the column of validity, the closest to a column of the block first."""
    stem = column
    while (cut := max(stem.rfind("."), stem.rfind("_"))) > 0:
        stem = stem[:cut]
        yield from (f"{stem}_valid", f"{stem}.valid", f"{stem}.{name}_valid")
