"""Run the commands of docs/tutorial.md and docs/dive.md and update their outputs; a test compares.

An indented block of a page is a shell command, run in a temporary folder with a link to `datasets`. The
```text block after it is the output: messages first, then the output of a terminal of 80 columns. A line `…`
stands for omitted lines. The numbers of lines before the first and after the last `…` are kept; a part
between two of them is found by its first word.
"""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import tempfile
import termios
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = tuple(Path(__file__).with_name(f"{name}.md") for name in ("tutorial", "dive"))

COMMANDS_AND_OUTPUT = re.compile(r"((?:^ {4}\S.*\n)+)(?:\n```text\n((?:.*\n)*?)```\n)?", re.MULTILINE)
ELISION = "…\n"
ROWS, COLUMNS = 40, 80


def page(text: str, program: str = f'"{sys.executable}" -m hydro.cli') -> str:
    """Return the page with current outputs; `program` is the command line of `hydro`."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "datasets").symlink_to(ROOT / "datasets")
        (Path(folder) / "bin").mkdir()
        hydro = Path(folder) / "bin" / "hydro"
        hydro.write_text(f'#!/bin/sh\nexec {program} "$@"\n')
        hydro.chmod(0o755)
        return COMMANDS_AND_OUTPUT.sub(lambda found: _renewed(found, Path(folder)), text)


def _renewed(found: re.Match[str], folder: Path) -> str:
    """Return commands and their current output, shortened like the page."""
    printed = run(re.sub("^ {4}", "", found[1], flags=re.MULTILINE), folder)
    return found[0] if found[2] is None else f"{found[1]}\n```text\n{excerpt(printed, found[2])}```\n"


def excerpt(printed: str, shown: str) -> str:
    """Return the same parts of an output that the page showed before.

    Raises:
        ValueError: A part between two elisions begins with a word that no line begins with any more.
    """
    first, *others = shown.split(ELISION)
    if not others:
        return printed
    lines = printed.splitlines(keepends=True)
    *middle, last = others
    parts, place = ["".join(lines[: first.count("\n")])], first.count("\n")
    for part in middle:
        word = part.split()[0]
        begin = next((i for i in range(place, len(lines)) if lines[i].split()[:1] == [word]), None)
        if begin is None:
            raise ValueError(f"no line begins with '{word}' any more: {printed}")
        place = begin + part.count("\n")
        parts.append("".join(lines[begin:place]))
    return ELISION.join([*parts, "".join(lines[len(lines) - last.count("\n") :])])


def run(commands: str, folder: Path) -> str:
    """Return the messages of commands, then their terminal output.

    Raises:
        subprocess.CalledProcessError: One of them failed.
    """
    environment = os.environ | {"NO_COLOR": "1", "TERM": "xterm", "PYTHONUTF8": "1", "PYTHONPATH": str(ROOT)}
    environment |= {"PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    environment |= {"COLUMNS": str(COLUMNS)}  # independent of the caller
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    with tempfile.TemporaryFile() as messages:
        shell = subprocess.Popen(
            ["bash", "-euo", "pipefail", "-c", commands],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=theirs,
            stderr=messages,
        )
        os.close(theirs)
        printed = _read(ours)
        failed = shell.wait()
        messages.seek(0)
        text = messages.read().decode() + printed
    if failed:
        raise subprocess.CalledProcessError(failed, commands, output=text)
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]|\r", "", text)
    return re.sub(r"\n{3,}", "\n\n", re.sub(r" +$", "", text, flags=re.MULTILINE)).strip("\n") + "\n"


def _read(terminal: int) -> str:
    """Return the output of a terminal until its other end is closed, which Linux signals by an error."""
    parts = []
    try:
        while part := os.read(terminal, 65536):
            parts.append(part)
    except OSError:
        pass
    os.close(terminal)
    return b"".join(parts).decode()


if __name__ == "__main__":
    for each in PAGES:
        if not sys.argv[1:] or each.stem in sys.argv[1:]:
            each.write_text(page(each.read_text()))
