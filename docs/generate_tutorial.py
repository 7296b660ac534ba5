"""Run the commands of docs/tutorial.md and put what they print into the page; a test compares.

An indented block of the page is a shell command line, run in one temporary folder beside `datasets`. A
```text block after it is what it prints on a terminal. In such a block a line `…` stands for lines left out:
as many lines as stand before it are kept from the beginning, as many as follow it from the end.
"""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = Path(__file__).with_name("tutorial.md")

COMMANDS_AND_OUTPUT = re.compile(r"((?:^ {4}\S.*\n)+)(?:\n```text\n((?:.*\n)*?)```\n)?", re.MULTILINE)
ELISION = "…\n"
TERMINAL = {"COLUMNS": "130", "NO_COLOR": "1", "TERM": "dumb", "PYTHONUTF8": "1"}


def page(text: str) -> str:
    """The page with the output of its commands as it is now."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "datasets").symlink_to(ROOT / "datasets")
        (Path(folder) / "bin").mkdir()
        hydro = Path(folder) / "bin" / "hydro"
        hydro.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m hydro.cli "$@"\n')
        hydro.chmod(0o755)
        return COMMANDS_AND_OUTPUT.sub(lambda found: _renewed(found, Path(folder)), text)


def _renewed(found: re.Match[str], folder: Path) -> str:
    """Commands and what they print now, as long as what the page shows of it."""
    printed = run(re.sub("^ {4}", "", found[1], flags=re.MULTILINE), folder)
    if found[2] is None:
        return found[0]
    first, elided, last = found[2].partition(ELISION)
    if elided:
        lines, begin, end = printed.splitlines(keepends=True), first.count("\n"), last.count("\n")
        printed = "".join([*lines[:begin], ELISION, *lines[len(lines) - end :]])
    return f"{found[1]}\n```text\n{printed}```\n"


def run(commands: str, folder: Path) -> str:
    """What commands print on a terminal, without what a progress line wrote over.

    Raises:
        subprocess.CalledProcessError: one of them failed.
    """
    environment = os.environ | TERMINAL
    environment |= {"PYTHONPATH": str(ROOT), "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        ["bash", "-euo", "pipefail", "-c", commands],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=theirs,
    ) as shell:
        os.close(theirs)
        text = _read(ours)
    if shell.returncode:
        raise subprocess.CalledProcessError(shell.returncode, commands, output=text)
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text.replace("\r\n", "\n"))
    return "".join(line.rsplit("\r", 1)[-1].rstrip() + "\n" for line in text.splitlines()).strip("\n") + "\n"


def _read(terminal: int) -> str:
    """All that comes out of a terminal until its other end is closed, which Linux tells by an error."""
    parts = []
    try:
        while part := os.read(terminal, 65536):
            parts.append(part)
    except OSError:
        pass
    os.close(terminal)
    return b"".join(parts).decode()


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text()))
