"""How much a recording may be: refused, with an estimate, before hours of work or more than memory holds.

And how long a diagnosis of it takes, about.
"""

from __future__ import annotations

import polars as pl

from hydro.core.errors import DataError

MOST_ROWS = 100_000_000
"""Of one table: 23 days at 50 Hz, and some 10 GB at once with all that is made of it."""
BYTES_PER_ROW = 100
"""Of a recording: pose, velocity and eight commands in float32, time and session."""
FINEST = 10.0
"""Rows to a sample of the fastest sensor: more hold nothing more."""

OUT_OF_WATER = 0.5
"""Height above the surface from which a simulated vehicle is said to have left the water [m]."""
FIRST_SECONDS, DIAGNOSED_ROWS, DIAGNOSED_VALUES = 16.0, 750.0, 50.0
"""Of a diagnosis: seconds of one processor (2.8 GHz) whatever there is; rows to a second more; values to fit
to as much again.  Laid through the nine measured ones of `tests/core/recording/test_extent.py`: how much is
found, which nobody knows beforehand, makes the rest, up to a factor of two."""
SERIAL = 1.0 / 3.0
"""Share of a diagnosis that one processor alone does."""
EXPLAINED = 1.25
"""A first step of `explain`, in diagnoses: 40 s of 32 s; later steps look for less and took 25 s and 18 s."""


def require_rows(rows: float) -> None:
    """Refuse more rows than a table may have.

    Raises:
        DataError: There are more; the line says what they would take.
    """
    if rows > MOST_ROWS:
        raise DataError(
            f"{rows:,.0f} rows would take {rows * BYTES_PER_ROW / 1e9:,.0f} GB; a table has at most "
            f"{MOST_ROWS:,}: make several, or ask for less"
        )


def require_rate(rate: float, step: float) -> None:
    """Refuse rows far closer than any sample.

    Args:
        rate: Rows per second.
        step: Median step of the fastest sensor [s].

    Raises:
        DataError: They are.
    """
    if rate * step > FINEST:
        raise DataError(
            f"{rate:g} rows per second are {rate * step:.0f} to each sample of the fastest sensor: "
            f"ask for at most {FINEST / step:.4g}"
        )


def duration(seconds: float) -> str:
    """An estimate of time in a few words."""
    for size, unit in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def diagnosis_seconds(rows: int, values: int, processors: int) -> float:
    """How long a diagnosis takes, to a factor of two [s].

    Args:
        rows: Of the recording.
        values: Numbers of the vehicle file that are fitted anew.
        processors: Of this machine.
    """
    alone = (FIRST_SECONDS + rows / DIAGNOSED_ROWS) * (1.0 + values / DIAGNOSED_VALUES)
    return alone * (SERIAL + (1.0 - SERIAL) / processors)


def above_surface(raw: pl.DataFrame) -> str:
    """Return that a simulated vehicle left the water, and when; empty where it did not.

    Every session that begins at the origin begins at the surface, so that a little height is nothing.

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
