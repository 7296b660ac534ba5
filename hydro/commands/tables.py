"""Readable tables that fit the width of the terminal; columns that do not fit follow in a second table."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import polars as pl
    from rich.console import Console

WIDE = 160
"""Width of a table without a terminal [characters]."""


def person(aside: bool = False) -> Console:
    """Return the console for text that a person reads, as opposed to tables that a program reads.

    Text goes to stdout if that is a terminal, otherwise to stderr.

    Args:
        aside: Whether text always goes to stderr.
    """
    from rich.console import Console

    return Console(stderr=aside or not sys.stdout.isatty(), highlight=False, markup=False)


def print_table(frame: pl.DataFrame, title: str = "", console: Console | None = None) -> None:
    """Print a table: numbers with three significant figures, aligned right; missing values as dashes.

    On a narrow terminal, sentences wrap first; numbers and names are never broken.  Columns that still do not
    fit follow in a second table with the same row names.

    Args:
        frame: The table.
        title: Title to print above the table.
        console: Console to print on; by default that for a person.
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
    """Yield groups of columns that fit next to each other, each led by the columns that name the rows.

    Args:
        cells: Cells of each column by its name.
        numeric: Names of the columns with numbers.
        width: Width of the terminal [characters].
    """
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
    """Return the minimum width of a column: its longest cell, or its longest word if it may wrap."""
    words = (
        [name, *column] if not _wraps(column) else [word for cell in (name, *column) for word in cell.split()]
    )
    return max(map(len, words), default=0)


def _wraps(column: Sequence[str]) -> bool:
    """Return whether a column has cells of several words, which may be wrapped."""
    return any(" " in cell for cell in column)


def _cell(value: Any) -> str:
    """Return a value with three significant figures at most, in plain notation if that is short."""
    if value is None:
        return "–"
    if not isinstance(value, float):
        return f"{value:,}" if isinstance(value, int) else str(value)
    return f"{value:#.3g}".rstrip(".") if 1e-4 <= abs(value) < 1e4 else f"{value:.3g}"
