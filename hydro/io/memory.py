"""Return of freed memory to the operating system between sessions of a dataset.

Allocators keep freed memory for later requests, but requests of other sizes cannot use it.  After sixteen
sessions of 100,000 rows, a process held 1.6 times the memory that one session needs.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys
from pathlib import Path

import pyarrow as pa

WORTH = 32 * 2**20
"""Growth of the process since the last release that makes the next one worth its time [bytes].

Collecting garbage takes a tenth of a second and more. A session of 100,000 rows needs some 200 MB.
"""
_STATUS = Path("/proc/self/statm")
"""Sizes of this process [pages], of which the second is the resident memory; on Linux alone."""


class _Released:
    """Resident memory of this process after the last release [bytes]."""

    size = 0


def give_back() -> None:
    """Return unused memory of Arrow and the C library to the operating system.

    Nothing happens if the process has grown little since the last call that returned memory.
    """
    size = _resident()
    if size is not None and size - _Released.size < WORTH:
        return
    gc.collect()
    pa.default_memory_pool().release_unused()
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError, OSError):  # C libraries other than glibc
            ctypes.CDLL(None).malloc_trim(0)
    _Released.size = _resident() or 0


def _resident() -> int | None:
    """Return the resident memory of this process [bytes]; None where the operating system does not tell."""
    try:
        return int(_STATUS.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None
