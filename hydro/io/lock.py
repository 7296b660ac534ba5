"""A folder of results for one command at a time.

The operating system lets go of a lock when its process ends, however it ends: what a kill leaves behind holds
nobody up.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import filelock

from hydro.core.errors import DataError
from hydro.io.files import explained, name_of

LOCK, OWNER = ".lock", ".owner"
"""Of a folder that is in use: the lock, and a line about who holds it."""


@contextlib.contextmanager
def alone(folder: str | Path) -> Iterator[None]:
    """Hold a folder for this process while the block runs; make it where it is missing.

    Folders that were made for it go again if nothing is in them at the end: a command that is refused leaves
    none.

    Raises:
        DataError: Another process holds it, or the operating system refuses.
    """
    place = Path(folder)
    made = [one for one in (place, *place.parents) if not one.exists()]
    try:
        place.mkdir(parents=True, exist_ok=True)
        with _held(place):
            yield
    finally:
        for one in made:
            with contextlib.suppress(OSError):  # something is in it
                one.rmdir()


@contextlib.contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder that is there."""
    lock, owner = filelock.FileLock(folder / LOCK), folder / OWNER
    try:
        lock.acquire(blocking=False)
        owner.write_text(_myself(), encoding="utf-8")
    except filelock.Timeout:
        raise DataError(
            f"{name_of(folder)}: in use by {_told(owner)}: wait until it has ended, or name another folder"
        ) from None
    except OSError as error:
        raise explained(str(folder), error) from error
    try:
        yield
    finally:
        for left in (owner, folder / LOCK):
            left.unlink(missing_ok=True)
        lock.release()


def _myself() -> str:
    """This process in one line, for whoever comes second."""
    words = ["hydro", *sys.argv[1:]]
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    return f"process {os.getpid()} on {socket.gethostname()} since {since} (`{shlex.join(words)}`)"


def _told(owner: Path) -> str:
    """What the holder says of itself; it may have ended since."""
    try:
        return owner.read_text(encoding="utf-8").strip() or "another process"
    except OSError:
        return "another process"
