"""Limits of the size of a recording, checked before any work, and the expected duration of a diagnosis."""

from __future__ import annotations

import math
from typing import NamedTuple

import polars as pl

from hydro.core.errors import DataError

MOST_ROWS = 100_000_000
"""Maximum rows of a table: 23 days at 50 Hz, and some 10 GB of memory with all derived arrays."""
BYTES_PER_ROW = 100
"""Size of a row: pose, velocity and eight commands in float32, time and session."""
FINEST = 10.0
"""Maximum rows per sample of the fastest sensor; more rows add no information."""

OUT_OF_WATER = 0.5
"""Height above the surface above which a simulated vehicle has left the water [m]."""
QUICK_SECONDS, QUICK_ROWS = 4.0, 7500.0
"""Shortest diagnosis, of a file that lacks nothing: fixed seconds of one processor (2.8 GHz) and rows per
further second."""
SLOW_SECONDS, SLOW_ROWS = 45.0, 400.0
"""Longest diagnosis, of a file that lacks several effects or of a hull that no formula fits: as above.  Both
limits contain the measured durations of `tests/core/recording/test_extent.py`."""
SERIAL = 1.0 / 3.0
"""Share of a diagnosis that runs on one processor."""
EXPLAINED = 1.25
"""Duration of the first step of `explain`, in diagnoses: 40 s of 32 s; later steps took 25 s and 18 s."""


def require_rows(rows: float) -> None:
    """Raise an error if `rows`, the number of rows of a planned recording, exceeds MOST_ROWS.

    Raises:
        DataError: There are too many rows; the message gives their number.
    """
    if rows > MOST_ROWS:
        raise DataError(
            f"{rows:,.0f} rows would take {rows * BYTES_PER_ROW / 1e9:,.0f} GB; a table has at most "
            f"{MOST_ROWS:,}: make several, or ask for less"
        )


def require_rate(rate: float, step: float) -> None:
    """Raise an error if a planned row rate is far above the rate of the fastest sensor.

    Args:
        rate: Rows per second of the table to make.
        step: Median time between samples of the fastest sensor [s].

    Raises:
        DataError: The rate is more than FINEST rows for each sample.
    """
    if rate * step > FINEST:
        raise DataError(
            f"{rate:g} rows per second are {rate * step:.0f} to each sample of the fastest sensor: "
            f"ask for at most {FINEST / step:.4g}"
        )


def duration(seconds: float) -> str:
    """Return a duration of `seconds` [s] in words, such as "5 minutes"."""
    for size, unit in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


class Expected(NamedTuple):
    """Expected duration of a diagnosis as a range, because the extent of its search is not known in advance.

    Attributes:
        shortest: Duration if the vehicle file lacks no effect [s].
        longest: Duration if the search tries most candidate effects [s].
    """

    shortest: float
    longest: float

    @property
    def middle(self) -> float:
        """Geometric mean of the shortest and the longest duration [s]."""
        return math.sqrt(self.shortest * self.longest)

    def times(self, factor: float) -> Expected:
        """Return a new range with both durations multiplied by `factor`."""
        return Expected(factor * self.shortest, factor * self.longest)

    def __str__(self) -> str:
        """Return the range in words."""
        return f"{duration(self.shortest)} to {duration(self.longest)}"


def diagnosis_seconds(rows: int, processors: int) -> Expected:
    """Return the estimated duration of a diagnosis of a recording, as a range [s].

    The duration depends mostly on how many effects are missing and on how well any formula fits the hull.
    Neither is known in advance.

    Args:
        rows: Rows of the recording.
        processors: Number of processors.
    """
    alone = Expected(QUICK_SECONDS + rows / QUICK_ROWS, SLOW_SECONDS + rows / SLOW_ROWS)
    return alone.times(SERIAL + (1.0 - SERIAL) / processors)


def above_surface(raw: pl.DataFrame) -> str:
    """Return a warning that gives when a simulated vehicle left the water; an empty string if it did not.

    A small height is ignored, because sessions that start at the origin start at the surface.

    Args:
        raw: Raw table of a simulation; depth `z` [m] is 0 at the surface.
    """
    out = raw.filter(pl.col("z") < -OUT_OF_WATER)
    if out.is_empty():
        return ""
    session, t = out.select("session", "t").row(0)
    highest = -float(raw["z"].cast(pl.Float64).min())  # type: ignore[arg-type]
    return (
        f"the vehicle leaves the water in session {session} at {t:.4g} s, and rises {highest:.3g} m above "
        "the surface (z < 0): a simulation has no surface; begin deeper, or command less upward thrust"
    )
