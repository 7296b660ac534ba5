"""Buffer on disk for the numbers of a log: memory holds one block per topic, however long the log is."""

from __future__ import annotations

import errno
import tempfile
import weakref
from array import array
from collections.abc import Sequence

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError

BLOCK = 4096
"""Number of messages of a topic that are kept in memory before they are written."""
SMALL = 16_000_000
"""Size of a log below which no file is written [bytes]."""
_DOUBLE = 8


class Spill:
    """Temporary file for blocks of numbers, which is deleted with the last object that reads it."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(max_size=SMALL)  # noqa: SIM115  closed by the finalizer
        weakref.finalize(self, self._file.close)

    def put(self, block: Sequence[array[float]]) -> int:
        """Append columns of numbers to the file, one after another; return the index of the first number.

        Args:
            block: The columns.

        Raises:
            DataError: The disk is full.
        """
        place = self._file.seek(0, 2)
        try:
            for column in block:
                self._file.write(column)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            raise DataError(
                f"{tempfile.gettempdir()}: no room for the numbers of this log, 8 bytes each: "
                "free some, or name another folder in TMPDIR"
            ) from error
        return place

    def take(self, place: int, into: Array) -> None:
        """Fill the array `into` with numbers from the file, from index `place` on."""
        self._file.seek(place)
        self._file.readinto(into.data.cast("B"))


class Columns:
    """Columns of numbers with a row for each message, written to a temporary file block by block.

    Args:
        count: Number of columns.
        spill: Temporary file that receives the blocks.
    """

    def __init__(self, count: int, spill: Spill) -> None:
        self.rows = 0
        self.open = [array("d") for _ in range(count)]
        self._spill = spill
        self._places: list[int] = []

    def advance(self) -> None:
        """Count a row, after a number was appended to each of the `open` columns.

        Write a full block to the file.
        """
        self.rows += 1
        if self.rows % BLOCK == 0:
            self._places.append(self._spill.put(self.open))
            for column in self.open:
                del column[:]

    def column(self, number: int, start: int = 0, stop: int | None = None) -> Array:
        """Return the numbers of one column in rows `start` to `stop` (excluded); by default all rows.

        Args:
            number: Index of the column.
            start: First row.
            stop: Row after the last; None for all.
        """
        stop = self.rows if stop is None else stop
        out = np.empty(max(stop - start, 0))
        for block in range(start // BLOCK, -(-stop // BLOCK) if len(out) else 0):
            first = block * BLOCK
            low, high = max(start, first), min(stop, first + BLOCK)
            part = out[low - start : high - start]
            if block < len(self._places):
                self._spill.take(self._places[block] + (number * BLOCK + low - first) * _DOUBLE, part)
            else:
                part[:] = self.open[number][low - first : high - first]
        return out
