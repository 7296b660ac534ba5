"""Opening of a named pipe, without waiting for ever for a program that writes into it."""

from __future__ import annotations

import contextlib
import os
import queue
import stat
import threading
from pathlib import Path
from typing import BinaryIO

from hydro.core.errors import DataError, shown

WAIT = 5.0
"""Longest time until a program opens the pipe for writing [s]: a shell starts the programs of one line within
a fraction of a second."""


def is_pipe(path: str | Path) -> bool:
    """Return whether a path leads to a pipe.

    Raises:
        OSError: There is no such path.
    """
    return stat.S_ISFIFO(os.stat(path).st_mode)


def opened(path: str | Path) -> BinaryIO:
    """Open a pipe for reading; the caller closes it.

    A program that has opened the pipe may take any time until it writes.

    Raises:
        DataError: No program opens the pipe for writing within WAIT.
        OSError: The pipe cannot be opened.
    """
    found: queue.SimpleQueue[int | OSError] = queue.SimpleQueue()
    threading.Thread(target=_open, args=(path, found), daemon=True).start()
    try:
        result = found.get(timeout=WAIT)
    except queue.Empty:
        _release(path, found)
        raise DataError(f"{shown(os.fspath(path))}: no program writes into this pipe: name a file") from None
    if isinstance(result, OSError):
        raise result
    return open(result, "rb")


def _open(path: str | Path, found: queue.SimpleQueue[int | OSError]) -> None:
    """Open a pipe as soon as a program writes into it, and put its number or the error into a queue."""
    try:
        found.put(os.open(path, os.O_RDONLY))
    except OSError as error:
        found.put(error)


def _release(path: str | Path, found: queue.SimpleQueue[int | OSError]) -> None:
    """End the wait in `_open` by opening the other end of the pipe, and close both ends."""
    with contextlib.suppress(OSError):  # no right to write: the thread waits until the process ends
        os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))
        number = found.get()
        if isinstance(number, int):
            os.close(number)
