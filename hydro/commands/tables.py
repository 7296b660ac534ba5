"""Tables for human eyes, as wide as the terminal: what does not fit beside the rest stands below it."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import polars as pl
    from rich.console import Console

WIDE = 160
"""Columns where no terminal says how many it has."""


def person(aside: bool = False) -> Console:
    """Where a command whose results are files talks to a person: stdout on a terminal, else stderr."""
    from rich.console import Console

    return Console(stderr=aside or not sys.stdout.isatty(), highlight=False, markup=False)


def print_table(frame: pl.DataFrame, title: str = "", console: Console | None = None) -> None:
    """Print a table for a person: numbers to the right with three significant figures, gaps as dashes.

    Where the terminal is narrow, sentences wrap first: numbers and names stay whole.  Columns that do not fit
    even so follow in a second table below, behind the same names of rows.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    console = console or Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else WIDE)
    console.print(*["", title] if title else [""], sep="\n", style="bold")
    cells = {name: [_cell(value) for value in frame[name]] for name in frame.columns}
    numeric = {name for name, dtype in frame.schema.items() if dtype.is_numeric()}
    for place, names in enumerate(_side_by_side(cells, numeric, console.width)):
        table = Table(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
        for name in names:
            whole = not _wraps(cells[name]) and 2 * _least(name, cells[name]) <= console.width
            justify = "right" if name in numeric else "left"
            table.add_column(name, justify=justify, no_wrap=whole, overflow="fold")  # type: ignore[arg-type]
        for row in zip(*(cells[name] for name in names), strict=True):
            table.add_row(*row)
        if place:
            console.print()
        console.print(table)


def _side_by_side(cells: dict[str, list[str]], numeric: set[str], width: int) -> Iterator[Sequence[str]]:
    """The columns in groups that are no wider than so many characters, each behind the names of its rows."""
    keys = list(cells)[:1]
    least = {name: _least(name, column) + 2 for name, column in cells.items()}
    for name in list(cells)[1:]:
        if name in numeric or len(keys) == 2:
            break
        keys.append(name)
    group, room = list(keys), width - sum(least[name] for name in keys)
    left = room
    for name in list(cells)[len(keys) :]:
        if least[name] > left and len(group) > len(keys):
            yield group
            group, left = list(keys), room
        group.append(name)
        left -= least[name]
    yield group


def _least(name: str, column: Sequence[str]) -> int:
    """Characters that a column takes at least: its longest cell, or its longest word where it may wrap."""
    words = (
        [name, *column] if not _wraps(column) else [word for cell in (name, *column) for word in cell.split()]
    )
    return max(map(len, words), default=0)


def _wraps(column: Sequence[str]) -> bool:
    """Whether a column has sentences."""
    return any(" " in cell for cell in column)


def _cell(value: Any) -> str:
    """A value as three significant figures at most, in plain notation where that is short."""
    if value is None:
        return "–"
    if not isinstance(value, float):
        return f"{value:,}" if isinstance(value, int) else str(value)
    return f"{value:#.3g}".rstrip(".") if 1e-4 <= abs(value) < 1e4 else f"{value:.3g}"
