"""Lock on a folder of results, so that one command uses it at a time.

The operating system releases the lock when its process ends, even after a kill.
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
"""Files in a locked folder: the lock, and a line that describes its process."""


@contextlib.contextmanager
def alone(folder: str | Path) -> Iterator[None]:
    """Hold a lock on a folder during a `with` block, so that no other process uses the folder.

    The folder is created if it is missing.  Folders created here are removed at the end if they are empty, so
    a refused command leaves none.

    Raises:
        DataError: Another process holds the lock, or the operating system refuses.
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
    """Hold the lock of an existing folder."""
    lock, owner = filelock.FileLock(folder / LOCK), folder / OWNER
    try:
        lock.acquire(blocking=False)
        owner.write_text(_description(), encoding="utf-8")
    except filelock.Timeout:
        raise DataError(
            f"{name_of(folder)}: in use by {_owner(owner)}: wait until it has ended, or name another folder"
        ) from None
    except OSError as error:
        raise explained(str(folder), error) from error
    try:
        yield
    finally:
        for left in (owner, folder / LOCK):
            left.unlink(missing_ok=True)
        lock.release()


def _description() -> str:
    """Describe this process in one line, for the error of another process."""
    words = ["hydro", *sys.argv[1:]]
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    return f"process {os.getpid()} on {socket.gethostname()} since {since} (`{shlex.join(words)}`)"


def _owner(owner: Path) -> str:
    """Return the description of the process that holds the lock; the process may have ended meanwhile."""
    try:
        return owner.read_text(encoding="utf-8").strip() or "another process"
    except OSError:
        return "another process"
