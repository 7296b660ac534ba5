"""Record of keyboard interrupts, for the message on why a command ended.

A C module that is interrupted while it is loaded may turn the interrupt into another error, such as
`ImportError: initialization failed`.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_SEEN = threading.Event()


@contextmanager
def noted() -> Iterator[None]:
    """Record keyboard interrupts during a `with` block, in addition to Python's default.

    Nothing is recorded if another handler is set, or outside the main thread.
    """
    _SEEN.clear()
    ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if ours:
        signal.signal(signal.SIGINT, _note)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def seen() -> bool:
    """Return whether `noted` has recorded a keyboard interrupt."""
    return _SEEN.is_set()


def _note(number: int, frame: FrameType | None) -> None:
    _SEEN.set()
    signal.default_int_handler(number, frame)
