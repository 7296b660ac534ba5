"""A command line run in this process as if on a terminal of some width."""

from __future__ import annotations

import io
import re

import pytest

from hydro import cli


class _Terminal(io.TextIOWrapper):
    def isatty(self) -> bool:
        return True


def on_terminal(line: list[str], columns: int, monkeypatch: pytest.MonkeyPatch) -> str:
    """What a command that ends well prints on stdout, without colours and without spaces at a line's end."""
    shown = _Terminal(io.BytesIO(), encoding="utf-8", write_through=True)
    with monkeypatch.context() as patch:
        patch.setattr("sys.stdout", shown)
        for name, value in (("COLUMNS", str(columns)), ("TERM", "xterm"), ("NO_COLOR", "1")):
            patch.setenv(name, value)
        assert cli.main(line) == 0, line
    text = re.sub(r"\x1b\[[0-9;]*m", "", shown.buffer.getvalue().decode())  # type: ignore[attr-defined]
    return "\n".join(each.rstrip() for each in text.splitlines())


def fits(text: str, columns: int = 80) -> bool:
    """Whether no line is wider, and nothing was cut off to have it so."""
    return "…" not in text and all(len(line) <= columns for line in text.splitlines())
