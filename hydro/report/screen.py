"""Answers as lines of a terminal: wrapped text, small tables and commands within a number of lines."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from hydro.report.following import pasted, quoted

COLUMNS = 80
"""Default width of a terminal."""
MOST_LINES = 38
"""Maximum number of lines of an answer: 40 of a terminal, less the prompt and one message."""


@dataclass(frozen=True)
class Text:
    """Paragraph of an answer on a terminal.

    Attributes:
        text: Text; empty for an empty line.
        indent: Number of spaces before each line.
        bold: Whether the text is bold.
        whole: Whether the text keeps its line breaks, as rows of a table do.
    """

    text: str = ""
    indent: int = 0
    bold: bool = False
    whole: bool = False

    def lines(self, width: int) -> list[Text]:
        """Return the paragraph as lines that fit the width of a terminal."""
        if self.whole or not self.text:
            return [self]
        wrapped = textwrap.wrap(
            self.text, max(width - self.indent, 20), break_long_words=False, break_on_hyphens=False
        )
        return [Text(" " * self.indent + one, 0, self.bold, True) for one in wrapped]


EMPTY = Text()


def laid(paragraphs: Iterable[Text], width: int) -> list[Text]:
    """Return the paragraphs as one list of lines that fit a terminal of `width` columns."""
    return [line for one in paragraphs for line in one.lines(width)]


def command(words: Sequence[str] | None, width: int) -> Iterator[Text]:
    """Yield the lines of a command that can be pasted into a shell; none without a command.

    Args:
        words: Words of the command; None without one.
        width: Columns of the terminal.
    """
    if words:
        yield from (Text(line, whole=True) for line in pasted(quoted(words), width))


@dataclass(frozen=True)
class Following:
    """Next command that an answer proposes, with its purpose.

    Attributes:
        label: Purpose of the command.
        words: Words of the command; None without a command.
    """

    label: str = ""
    words: Sequence[str] | None = None

    def lines(self, width: int) -> Iterator[Text]:
        """Yield the label, then the lines of the command; nothing if there is no command."""
        if self.words:
            yield Text(self.label)
            yield from command(self.words, width)


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[Text]:
    """Yield the header and the rows of a table as lines, the first column left, all others right."""
    cells = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    for number, row in enumerate(cells):
        first, *others = (
            one.ljust(size) if i == 0 else one.rjust(size)
            for i, (one, size) in enumerate(zip(row, widths, strict=True))
        )
        yield Text("  ".join([first, *others]).rstrip(), bold=number == 0, whole=True)


@dataclass(frozen=True)
class Block:
    """Part of an answer that may be omitted if the terminal is too small.

    Attributes:
        body: Paragraphs.
    """

    body: Sequence[Text]

    def lines(self, width: int) -> list[Text]:
        """Return the lines of the block on a terminal."""
        return laid(self.body, width)


def fitted(
    head: Sequence[Text], blocks: Sequence[Block], tail: Sequence[Text], width: int, more: str
) -> list[Text]:
    """Return the lines of an answer with as many blocks as fit on the terminal, and a note on omitted blocks.

    If the blocks do not fit, the last ones are omitted, but never the first.

    Args:
        head: First paragraphs.
        blocks: Blocks, the most important first.
        tail: Last paragraphs.
        width: Columns of the terminal.
        more: Note on omitted blocks, with `{count}`; empty if none may be omitted.
    """
    begin, end = laid(head, width), laid(tail, width)
    room = MOST_LINES - len(begin) - len(end)
    shown = list(blocks)

    def left() -> int:
        return len(blocks) - len(shown)

    def size() -> int:
        return sum(len(one.lines(width)) for one in shown) + (left() > 0)

    while more and len(shown) > 1 and size() > room:
        shown.pop()
    lines = [line for one in shown for line in one.lines(width)]
    if left():
        lines += laid([Text(more.format(count=f"{left()} more"))], width)
    return [*begin, *lines, *end]
