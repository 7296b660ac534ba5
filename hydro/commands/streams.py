"""The streams of the process: closed ones, and what is said of one that fails."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
import warnings
from collections.abc import Iterator
from typing import Any

from hydro.core.errors import HydroNotice, HydroWarning

_STREAMS = (("stdin", os.O_WRONLY, "r"), ("stdout", os.O_RDONLY, "w"), ("stderr", os.O_WRONLY, "w"))
"""Name, how the null device takes its place when it is closed, and how it is used."""


_OF_WRITING = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF, errno.ENXIO}
"""Errors of a write; what prints is the only writer that names no file."""


def replace_closed() -> None:
    """Put the null device in the place of streams that were closed before the process began.

    Reading from stdin and writing to stdout then fail as a file does, when a command needs them and not
    before; a message on stderr is lost, as who closed it wants.
    """
    for name, access, mode in _STREAMS:
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.open(os.devnull, access), mode, closefd=False))  # noqa: SIM115


@contextlib.contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Print warnings on the data on stderr, each line once; notices where stderr is a terminal."""
    printed: set[str] = set()
    with warnings.catch_warnings():
        warnings.simplefilter("always", HydroWarning)
        ordinary = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if not issubclass(category, HydroWarning):
                ordinary(message, category, *place, **more)
            elif (line := str(message)) not in printed:
                printed.add(line)
                notice = issubclass(category, HydroNotice)
                if not notice or sys.stderr.isatty():
                    print(f"hydro: {'' if notice else 'warning: '}{line}", file=sys.stderr, flush=True)

        warnings.showwarning = show
        yield


def failure(error: OSError) -> str:
    """Return the line on an error of the operating system that names no file: writes to files name theirs."""
    from hydro.io.files import explained

    if error.errno in _OF_WRITING:
        return str(explained("stdout", error))
    try:
        os.getcwd()
    except OSError:
        return "the working directory has been removed: change to another one and run again"
    return f"{(error.strerror or str(error)).lower()}: the operating system refused; --debug shows where"


def leave() -> None:
    """Let what is left in stdout's buffer go nowhere, so that its flush at the end is no second error."""
    with contextlib.suppress(io.UnsupportedOperation, ValueError):  # a stream of tests has no number
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
