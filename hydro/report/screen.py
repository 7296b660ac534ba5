"""Answers as lines of a terminal: wrapped text, small tables and commands within a number of lines."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from hydro.report.following import pasted, quoted

COLUMNS = 80
"""Width of a terminal where nothing says otherwise."""
MOST_LINES = 38
"""Lines of an answer at most: a terminal has 40, and the prompt and one message need theirs."""


@dataclass(frozen=True)
class Text:
    """A paragraph.

    Attributes:
        text: Its text; empty for an empty line.
        indent: Columns before each line.
        bold: Whether it is printed bold.
        whole: Whether it keeps its line breaks, as rows of a table do.
    """

    text: str = ""
    indent: int = 0
    bold: bool = False
    whole: bool = False

    def lines(self, width: int) -> list[Text]:
        """Return the paragraph as lines that are no wider than a terminal."""
        if self.whole or not self.text:
            return [self]
        wrapped = textwrap.wrap(
            self.text, max(width - self.indent, 20), break_long_words=False, break_on_hyphens=False
        )
        return [Text(" " * self.indent + one, 0, self.bold, True) for one in wrapped]


EMPTY = Text()


def laid(paragraphs: Iterable[Text], width: int) -> list[Text]:
    """Return paragraphs as lines of a terminal."""
    return [line for one in paragraphs for line in one.lines(width)]


def command(words: Sequence[str] | None, width: int) -> Iterator[Text]:
    """Yield the lines of a command that can be pasted; nothing where there is none."""
    if words:
        yield from (Text(line, whole=True) for line in pasted(quoted(words), width))


@dataclass(frozen=True)
class Following:
    """The next command.

    Attributes:
        label: What it does.
        words: Its words; None where there is none.
    """

    label: str = ""
    words: Sequence[str] | None = None

    def lines(self, width: int) -> Iterator[Text]:
        """Yield the label and the command; nothing where there is none."""
        if self.words:
            yield Text(self.label)
            yield from command(self.words, width)


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[Text]:
    """Yield a table, its first column to the left and all others to the right."""
    cells = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    for number, row in enumerate(cells):
        first, *others = (
            one.ljust(size) if i == 0 else one.rjust(size)
            for i, (one, size) in enumerate(zip(row, widths, strict=True))
        )
        yield Text("  ".join([first, *others]).rstrip(), bold=number == 0, whole=True)


def fitted(
    head: Sequence[Text], blocks: Sequence[Sequence[Text]], tail: Sequence[Text], width: int, more: str
) -> list[Text]:
    """Return the lines of an answer: as many blocks as fit, and a word on those that are left out.

    Args:
        head: What stands first.
        blocks: Blocks, the most important first.
        tail: What stands last.
        width: Columns.
        more: Says where the blocks are that are left out, with `{count}`; empty where none may be.
    """
    begin, end = laid(head, width), laid(tail, width)
    room = MOST_LINES - len(begin) - len(end)
    each = [laid(block, width) for block in blocks]
    count = len(each)
    while more and count > 1 and sum(map(len, each[:count])) + (count < len(each)) > room:
        count -= 1
    shown = [line for block in each[:count] for line in block]
    if left := len(each) - count:
        shown += laid([Text(more.format(count=left))], width)
    return [*begin, *shown, *end]
