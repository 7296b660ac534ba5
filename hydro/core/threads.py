"""Threads of one process: all processors, unless the environment limits its share of the machine."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from hydro.core.errors import UsageError

T = TypeVar("T")
R = TypeVar("R")
_LOCAL = threading.local()  # `sharing`: number of threads that share the processors at present
VARIABLE, COMPILER = "HYDRO_THREADS", "NUMBA_NUM_THREADS"
"""Environment variables with the number of threads of a process that shares its machine, and of numba."""


def available() -> int:
    """Return the number of threads that one computation may use; no result depends on the number.

    It is HYDRO_THREADS, or else the number of processors.  Within `shared`, the threads divide it among
    themselves.

    Raises:
        UsageError: HYDRO_THREADS is not a whole number from 1.
    """
    return max(_processors() // getattr(_LOCAL, "sharing", 1), 1)


def require_numbers() -> None:
    """Check that HYDRO_THREADS and NUMBA_NUM_THREADS are numbers of threads, if they are set.

    Numba would raise on its import otherwise.

    Raises:
        UsageError: One of the two is not a whole number from 1.
    """
    for name in (VARIABLE, COMPILER):
        _number(name)


def _processors() -> int:
    """Return the number in HYDRO_THREADS, otherwise the number of processors."""
    return _number(VARIABLE) or os.cpu_count() or 1


def _number(name: str) -> int | None:
    """Return the number of threads in a variable of the environment; None where it is not set."""
    limit = os.environ.get(name)
    if limit is None:
        return None
    if not limit.isdecimal() or int(limit) < 1:
        raise UsageError(f"{name}={limit!r:.40}: set it to a whole number of threads, or unset it")
    return int(limit)


def shared(work: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """Apply `work` to every item in parallel threads; yield the results in the order of the items.

    Threads pay for work of some hundredths of a second or more.  Compiled kernels run in parallel; Python
    code does not.  With one available thread, the current thread does the work.

    Args:
        work: Function of one item.
        items: The items; all are read before the first result.
    """
    every = list(items)
    threads = min(available(), len(every))
    if threads <= 1:
        yield from map(work, every)
        return
    sharing = threads * getattr(_LOCAL, "sharing", 1)

    def in_thread(item: T) -> R:
        _LOCAL.sharing = sharing
        return work(item)

    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(in_thread, every)


def spread(work: Callable[[T], R], pieces: Iterable[T], threads: int | None = None) -> list[R]:
    """Apply `work` to every piece in parallel threads; return the results in the order of the pieces.

    With one piece or one thread, the current thread does the work: a piece takes milliseconds, and starting a
    thread would cost a significant part of that.

    Args:
        work: Function of one piece; it starts no threads itself.
        pieces: The pieces.
        threads: Number of threads; by default `available()`.
    """
    every = list(pieces)
    count = min(threads or available(), len(every))
    if count <= 1:
        return [work(piece) for piece in every]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, every))
