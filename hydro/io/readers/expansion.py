"""Limit on how much a file may expand: what its contents take once they are decompressed.

A file of 60 kB can hold 2 GB of zeros.  Readers therefore count the bytes that they are about to make of a
file, by the sizes that its format states or step by step where it states none, and stop at a limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from hydro.core.errors import DataError

RATIO = 100.0
"""Bytes that a file may expand to by default, for each of its own.

Recordings expand 3 to 20 times, tables of numbers that hardly change up to 50 times; files that are made to
fill a memory expand 200 times (LZ4), 1,000 times (zip, MATLAB) and far more (zstd, bzip2, Parquet).  A file
can then take no more than 100 times what its sender had to send.
"""
LEAST = 100e6
"""Bytes that every file may expand to: no machine lacks them.  It matters to files below 1 MB alone."""
OPTION = "--max-expanded"
"""Command-line option that replaces the limit."""
NUMBER = 8
"""Bytes that a number takes once it is computed with, however few its file needs for it."""
_GIGA = 1e9

_chosen: ContextVar[float | None] = ContextVar("max_expanded", default=None)


@contextmanager
def allowed(gigabytes: float | None) -> Iterator[None]:
    """Hold every file that is read in the block to another limit.

    Args:
        gigabytes: The limit [GB, of 10^9 bytes]; None for the default, which depends on the file's size.
    """
    before = _chosen.set(gigabytes)
    try:
        yield
    finally:
        _chosen.reset(before)


def limit(size: float) -> float:
    """Return how many bytes a file of `size` bytes may expand to."""
    chosen = _chosen.get()
    return max(LEAST, RATIO * size) if chosen is None else chosen * _GIGA


class Expansion:
    """Count of the bytes that one file has expanded to.

    Attributes:
        limit: How many they may be.

    Args:
        name: What error lines call the file.
        size: Its bytes.
    """

    def __init__(self, name: str, size: int) -> None:
        self.limit = limit(size)
        self._name, self._size, self._count = name, size, 0.0

    @classmethod
    def of(cls, name: str, path: Path) -> Expansion:
        """Return the count of a file, or of all files in a folder, at its beginning."""
        files = path.rglob("*") if path.is_dir() else [path]
        return cls(name, sum(each.stat().st_size for each in files if each.is_file()))

    def add(self, count: float) -> None:
        """Count bytes that are about to be made of the file.

        Raises:
            DataError: they are more than the limit, with those before them.
        """
        self._count += count
        if self._count > self.limit:
            raise DataError(
                f"{self._name}: {self._size:,} bytes would take {_gigabytes(self._count)} or more once they "
                f"are decompressed, and the limit is {_gigabytes(self.limit)}: if you trust this file, raise "
                f"it with {OPTION} GB"
            )


def _gigabytes(count: float) -> str:
    """Return a number of bytes in GB, with two digits."""
    return f"{count / _GIGA:.2g} GB" if count < 100 * _GIGA else f"{math.floor(count / _GIGA):,} GB"
