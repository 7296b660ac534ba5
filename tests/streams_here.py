"""`hydro` run in this process on streams of its own: files in the place of pipes, or a terminal.

Importing the libraries takes longer than most commands. So only tests of the process itself start a new one.
"""

from __future__ import annotations

import contextlib
import os
import pty
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple
from unittest import mock

from hydro import cli


class Done(NamedTuple):
    """Result of a command: its exit code and the bytes that it wrote."""

    returncode: int
    stdout: bytes
    stderr: bytes


def piped(*arguments: object, stdin: bytes = b"", cwd: Path | None = None) -> Done:
    """Run a command whose three streams are files, not a terminal."""
    file = tempfile.TemporaryFile
    with file() as source, file() as out, file() as error:
        source.write(stdin)
        source.seek(0)
        code = _run(arguments, (source, out, error), {}, cwd)
        out.seek(0)
        error.seek(0)
        return Done(code, out.read(), error.read())


def on_terminal(
    *arguments: object, columns: int = 160, term: str = "dumb", answers: Sequence[str] = ()
) -> tuple[int, str]:
    """Run a command whose three streams are one terminal, and return its exit code and everything printed.

    The answers are typed ahead, a line each, and then the end of the input.
    """
    leader, follower = pty.openpty()
    os.write(leader, "".join(f"{answer}\n" for answer in answers).encode() + b"\x04")
    printed: list[bytes] = []
    reader = threading.Thread(target=lambda: printed.extend(_read(leader)))
    reader.start()
    try:
        with open(follower, "r+b", buffering=0) as stream:
            environment = {"COLUMNS": str(columns), "TERM": term}
            code = _run(arguments, (stream, stream, stream), environment, None)
    finally:  # the follower is closed now, which ends what the leader reads
        reader.join()
        os.close(leader)
    return code, b"".join(printed).decode(errors="replace")


def _read(leader: int) -> Iterator[bytes]:
    """Yield what a terminal prints until its other end is closed, which Linux tells by an error."""
    with contextlib.suppress(OSError):
        while piece := os.read(leader, 65536):
            yield piece


def _run(
    arguments: Sequence[object],
    streams: tuple[BinaryIO, BinaryIO, BinaryIO],
    environment: Mapping[str, str],
    folder: Path | None,
) -> int:
    """Run a command with these in the place of stdin, stdout and stderr, and return its exit code."""
    with contextlib.ExitStack() as stack:
        for name, stream in zip(("stdin", "stdout", "stderr"), streams, strict=True):
            mode = "r" if name == "stdin" else "w"
            copy = stack.enter_context(open(os.dup(stream.fileno()), mode, encoding="utf-8"))
            stack.enter_context(mock.patch.object(sys, name, copy))
        stack.enter_context(mock.patch.dict(os.environ, environment))
        stack.enter_context(contextlib.chdir(folder or Path.cwd()))
        return cli.main([str(argument) for argument in arguments])
