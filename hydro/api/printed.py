"""Sentences and a small table as plain text for a shell, or as HTML for a notebook."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import polars as pl

WIDTH = 80
"""Maximum length of a line in characters: the usual width of a terminal."""
MOST_ROWS = 12
"""Maximum number of printed rows, so that a result fits one screen; other rows are only counted."""
NARROWEST = 8
"""Minimum width in characters of a column of text, if a table is wider than WIDTH."""
PLAIN = str.maketrans({"−": "-", "–": "-"})
"""Signs that some encodings of a terminal lack, and their replacements in ASCII."""


def text(
    above: Sequence[str],
    table: pl.DataFrame,
    below: Sequence[str],
    units: Mapping[str, str],
) -> str:
    """Return sentences, a small table and more sentences as one text, in lines of at most WIDTH characters.

    Args:
        above: Sentences before the table, one paragraph each.
        table: The table; columns without any value are left out.
        below: Sentences after the table.
        units: Units of columns by name; they are printed after the name.
    """
    shown = _with_values(table)
    columns = _columns(shown, units)
    parts = [*(_wrapped(one) for one in above)]
    if columns and shown.height:
        parts += ["", *_aligned(columns, [dtype.is_numeric() for dtype in shown.dtypes])]
        parts += [f"... and {left} more" for left in _left_out(shown)] + [""] * bool(below)
    return "\n".join([*parts, *(_wrapped(one) for one in below)])


def html(
    above: Sequence[str],
    table: pl.DataFrame,
    below: Sequence[str],
    units: Mapping[str, str],
) -> str:
    """Return sentences, a table and more sentences as the text of one HTML `div`; all text is escaped.

    Args:
        above: Sentences before the table, at least one; the first is bold.
        table: The table; columns without any value are left out.
        below: Sentences after the table.
        units: Units of columns by name; they are printed after the name.
    """
    shown = _with_values(table)
    columns = _columns(shown, units)
    first, *rest = above
    lines = [f"<p><strong>{_escaped(first)}</strong></p>", *(f"<p>{_escaped(one)}</p>" for one in rest)]
    if columns and shown.height:
        sides = ["right" if dtype.is_numeric() else "left" for dtype in shown.dtypes]
        heads = (_cell("th", name, side) for (name, _), side in zip(columns, sides, strict=True))
        rows = zip(*(cells for _, cells in columns), strict=True)
        body = ("".join(_cell("td", one, side) for one, side in zip(row, sides, strict=True)) for row in rows)
        lines.append(f"<table><thead><tr>{''.join(heads)}</tr></thead>")
        lines += ["<tbody>", *(f"<tr>{row}</tr>" for row in body), "</tbody></table>"]
        lines += [f"<p>... and {left} more</p>" for left in _left_out(shown)]
    return "\n".join(["<div>", *lines, *(f"<p>{_escaped(one)}</p>" for one in below), "</div>"])


def _with_values(table: pl.DataFrame) -> pl.DataFrame:
    """Return the columns that have a value, not only nulls and empty texts."""
    return table.select(
        name for name in table.columns if any(value not in (None, "") for value in table[name].to_list())
    )


def _columns(table: pl.DataFrame, units: Mapping[str, str]) -> list[tuple[str, list[str]]]:
    """Return the name of each column with its unit, and its cells as text."""
    columns = []
    for name in table.columns:
        unit = f" [{units[name]}]" if name in units else ""
        head = _printable(f"{name.replace('_', ' ')}{unit}")
        columns.append((head, [_text_of(value) for value in table[name].head(MOST_ROWS)]))
    return columns


def _left_out(table: pl.DataFrame) -> list[int]:
    """Return a list with the number of rows that are not printed, or an empty list if all are printed."""
    return [table.height - MOST_ROWS] if table.height > MOST_ROWS else []


def _text_of(value: Any) -> str:
    """Return a value as text: three significant figures, a dash for none."""
    from hydro.report.words import figure

    if value is None or isinstance(value, float):
        return figure(value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return _printable(str(value))


def _aligned(columns: Sequence[tuple[str, Sequence[str]]], numeric: Sequence[bool]) -> list[str]:
    """Return the lines of a table: numbers to the right, texts to the left, cut to fit."""
    widths = [max(map(len, (name, *cells))) for name, cells in columns]
    texts = [place for place, number in enumerate(numeric) if not number]
    over = sum(widths) + 2 * (len(widths) - 1) - WIDTH
    for place in sorted(texts, key=lambda place: -widths[place]):
        cut = max(min(over, widths[place] - NARROWEST), 0)
        widths[place], over = widths[place] - cut, over - cut
    plain = ((name, *(cell.translate(PLAIN) for cell in cells)) for name, cells in columns)
    rows = zip(*plain, strict=True)
    return [
        "  ".join(
            cell.rjust(width) if number else _cut(cell, width).ljust(width)
            for cell, width, number in zip(row, widths, numeric, strict=True)
        ).rstrip()
        for row in rows
    ]


def _cut(cell: str, width: int) -> str:
    return cell if len(cell) <= width else f"{cell[: width - 3]}..."


def _wrapped(sentence: str) -> str:
    return textwrap.fill(_printable(sentence), WIDTH, break_long_words=False, break_on_hyphens=False)


def _printable(sentence: str) -> str:
    """Return a text with line breaks and control characters escaped."""
    return "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in sentence)


def _escaped(sentence: str) -> str:
    return escape(_printable(sentence))


def _cell(tag: str, content: str, side: str) -> str:
    return f'<{tag} style="text-align: {side}; padding: 0.1em 0.6em">{escape(content)}</{tag}>'
