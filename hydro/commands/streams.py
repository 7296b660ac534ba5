"""Standard streams of the process: replacement of closed ones, warnings, and messages on failures."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
import warnings
from collections.abc import Iterator
from typing import Any, TextIO, cast

from hydro.core.errors import HydroNotice, HydroWarning

_STREAMS = (("stdin", os.O_WRONLY, "r"), ("stdout", os.O_RDONLY, "w"), ("stderr", os.O_WRONLY, "w"))
"""Name of each stream, access mode of the null device that replaces it, and mode of its file object."""


_OF_WRITING = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF, errno.ENXIO}
"""Errors of a write to stdout; errors of writes to files name their file."""


def replace_closed() -> None:
    """Replace streams that were closed before the process began by the null device.

    Reading from stdin and writing to stdout then fail like a file, and only when a command uses them; a
    message on stderr is lost, as intended by the caller.
    """
    for name, access, mode in _STREAMS:
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.open(os.devnull, access), mode, closefd=False))  # noqa: SIM115


class _Lasting:
    """Text stream whose reader may leave: what is written afterwards is lost, and no error is raised.

    Args:
        stream: The stream.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except BrokenPipeError:
            _discard(self._stream)
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except BrokenPipeError:
            _discard(self._stream)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def messages_may_be_lost() -> Iterator[None]:
    """Continue a command without messages when the reader of stderr leaves, during a `with` block.

    `hydro import LOG -o FILE` whose messages go to `head` then still writes the file.
    """
    with contextlib.redirect_stderr(cast("TextIO", _Lasting(sys.stderr))):
        yield


@contextlib.contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Print warnings on the data as single lines on stderr during a `with` block, each line once.

    Notices are printed only where stderr is a terminal.
    """
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
    """Return the message for an error of the operating system without a file name."""
    from hydro.io.files import explained

    if error.errno in _OF_WRITING:
        return str(explained("stdout", error))
    try:
        os.getcwd()
    except OSError:
        return "the working directory has been removed: change to another one and run again"
    return f"{(error.strerror or str(error)).lower()}: the operating system refused; --debug shows where"


def leave() -> None:
    """Discard the unwritten output of stdout, so that its flush at exit does not cause a second error."""
    _discard(sys.stdout)


def _discard(stream: TextIO) -> None:
    """Connect a stream to the null device, so that its unwritten text is lost without an error."""
    with contextlib.suppress(io.UnsupportedOperation, ValueError):  # a stream of tests has no number
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
