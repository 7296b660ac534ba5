"""An interrupt from the keyboard, remembered for whoever has to say why a command ended.

A module written in C that is interrupted while it is being loaded makes of the interrupt what it likes, such
as `ImportError: initialization failed`.
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
    """Note interrupts meanwhile, besides what Python does of itself; not where others handle them."""
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
    """Whether there was one."""
    return _SEEN.is_set()


def _note(number: int, frame: FrameType | None) -> None:
    _SEEN.set()
    signal.default_int_handler(number, frame)
