"""Limit on the expanded size of a file: the memory of its contents after decompression.

A file of 60 kB can hold 2 GB of zeros.  Readers therefore count the bytes that they are about to expand, and
stop at a limit.  They use the sizes that the format states, or count step by step if it states none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from hydro.core.errors import DataError

RATIO = 100.0
"""Default limit of the expanded size, relative to the file's size.

Recordings expand 3 to 20 times, and tables of nearly constant numbers up to 50 times.  Files made to exhaust
the memory expand 200 times (LZ4), 1,000 times (zip, MATLAB) and far more (zstd, bzip2, Parquet).
"""
LEAST = 100e6
"""Expanded size that every file may have [bytes]; it affects only files below 1 MB."""
OPTION = "--max-expanded"
"""Command-line option that replaces the limit."""
NUMBER = 8
"""Bytes of a number during computation, independent of its size in the file."""
_GIGA = 1e9

_chosen: ContextVar[float | None] = ContextVar("max_expanded", default=None)


@contextmanager
def allowed(gigabytes: float | None) -> Iterator[None]:
    """Set the limit on the expanded size of every file that is read in a `with` block.

    Args:
        gigabytes: Limit [GB, of 10^9 bytes]; None for the default, which depends on the file's size.
    """
    before = _chosen.set(gigabytes)
    try:
        yield
    finally:
        _chosen.reset(before)


def limit(size: float) -> float:
    """Return the maximum expanded size [bytes] of a file of `size` bytes on disk."""
    chosen = _chosen.get()
    return max(LEAST, RATIO * size) if chosen is None else chosen * _GIGA


class Expansion:
    """Counter of one file's bytes after decompression, with a limit that protects the memory.

    Attributes:
        limit: Maximum of the count.

    Args:
        name: Name of the file in error messages.
        size: Size of the file on disk [bytes].
    """

    def __init__(self, name: str, size: int) -> None:
        self.limit = limit(size)
        self._name, self._size, self._count = name, size, 0.0

    @classmethod
    def of(cls, name: str, path: Path) -> Expansion:
        """Return a new count for a file, or for all files in a folder."""
        files = path.rglob("*") if path.is_dir() else [path]
        return cls(name, sum(each.stat().st_size for each in files if each.is_file()))

    def add(self, count: float) -> None:
        """Add `count` bytes to the total, before the file is expanded to them.

        Raises:
            DataError: The total exceeds the limit.
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
