"""Limits of the size of a recording, checked before any work, and the expected duration of a diagnosis."""

from __future__ import annotations

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
FIRST_SECONDS, DIAGNOSED_ROWS, DIAGNOSED_VALUES = 16.0, 750.0, 50.0
"""Duration of a diagnosis: fixed seconds of one processor (2.8 GHz), rows per further second, and number of
fitted values that doubles it.  The values fit the nine measured durations of
`tests/core/recording/test_extent.py`.  The number of findings, unknown in advance, adds a factor of up to
two."""
SERIAL = 1.0 / 3.0
"""Share of a diagnosis that runs on one processor."""
EXPLAINED = 1.25
"""Duration of the first step of `explain`, in diagnoses: 40 s of 32 s; later steps took 25 s and 18 s."""


def require_rows(rows: float) -> None:
    """Refuse more rows than the maximum of a table.

    Raises:
        DataError: There are more rows; the message gives their size.
    """
    if rows > MOST_ROWS:
        raise DataError(
            f"{rows:,.0f} rows would take {rows * BYTES_PER_ROW / 1e9:,.0f} GB; a table has at most "
            f"{MOST_ROWS:,}: make several, or ask for less"
        )


def require_rate(rate: float, step: float) -> None:
    """Refuse a row rate far above that of any sensor.

    Args:
        rate: Rows per second.
        step: Median step of the fastest sensor [s].

    Raises:
        DataError: The rate is too high.
    """
    if rate * step > FINEST:
        raise DataError(
            f"{rate:g} rows per second are {rate * step:.0f} to each sample of the fastest sensor: "
            f"ask for at most {FINEST / step:.4g}"
        )


def duration(seconds: float) -> str:
    """Return a duration in words."""
    for size, unit in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def diagnosis_seconds(rows: int, values: int, processors: int) -> float:
    """Estimate the duration of a diagnosis, to a factor of two [s].

    Args:
        rows: Rows of the recording.
        values: Number of fitted values of the vehicle file.
        processors: Number of processors.
    """
    alone = (FIRST_SECONDS + rows / DIAGNOSED_ROWS) * (1.0 + values / DIAGNOSED_VALUES)
    return alone * (SERIAL + (1.0 - SERIAL) / processors)


def above_surface(raw: pl.DataFrame) -> str:
    """Return a warning that a simulated vehicle left the water, and when; else an empty string.

    Sessions that start at the origin start at the surface, so a small height is ignored.

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
