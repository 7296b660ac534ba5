"""How many threads one process may use: all processors, unless its share of the machine is said."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from hydro.core.errors import UsageError

T = TypeVar("T")
R = TypeVar("R")
_HERE = threading.local()
VARIABLE = "HYDRO_THREADS"
"""Environment variable with the threads of a process that shares its machine with others."""


def available() -> int:
    """Threads for work that is shared among them; no result depends on how many there are.

    A worker of a cluster has a share of a machine and still sees all its processors: what starts it says how
    many are its own.  Within `shared` they are shared among those that are at work.

    Raises:
        UsageError: HYDRO_THREADS is not a whole number from 1.
    """
    return max(_processors() // getattr(_HERE, "sharing", 1), 1)


def _processors() -> int:
    """What the machine has, or HYDRO_THREADS says."""
    said = os.environ.get(VARIABLE)
    if said is None:
        return os.cpu_count() or 1
    if not said.isdecimal() or int(said) < 1:
        raise UsageError(f"{VARIABLE}={said!r:.40}: set it to a whole number of threads, or unset it")
    return int(said)


def shared(work: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """What `work` makes of every item, in their order, the items shared among the threads.

    It pays for fits of some hundredths of a second and more: their kernels run side by side, and while one is
    prepared another one is predicted.
    """
    every = list(items)
    threads = max(min(available(), len(every)), 1)
    sharing = threads * getattr(_HERE, "sharing", 1)

    def alone(item: T) -> R:
        _HERE.sharing = sharing
        return work(item)

    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(alone, every)


def spread(work: Callable[[T], R], pieces: Iterable[T], threads: int | None = None) -> list[R]:
    """What `work` makes of every piece of one evaluation, in their order.

    Unlike `shared` it stays in the present thread where there is one piece or one thread: an evaluation takes
    milliseconds, of which starting a thread would be a part.

    Args:
        work: What is done with a piece; it starts no threads itself.
        pieces: The pieces.
        threads: How many threads; by default those that are available.
    """
    every = list(pieces)
    count = min(threads or available(), len(every))
    if count <= 1:
        return [work(piece) for piece in every]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, every))
