"""Cleaned recording used by compare, diagnose, explain and fit, with a list of the changes.

The order matters.  Impossible readings are removed first, since they would hide mislabelled columns.
Mislabelled columns are corrected next.  A gyro's bias is removed and outliers are handled last.

Every correction is a sentence in `Cleaned.changes`.  Outliers of a channel with heavy-tailed noise get a
smaller weight in `Cleaned.record` and stay in the table as logged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import polars as pl

from hydro.core.errors import DataError
from hydro.core.logs.axis_faults import axis_faults
from hydro.core.recording.arrays import Recording
from hydro.core.recording.heavy_tails import Tail
from hydro.core.recording.sensor_faults import (
    Corrected,
    Fault,
    without_bad_readings,
    without_bias,
    without_faults,
    without_outliers,
)
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Cleaned:
    """Recording with the faults of its log corrected.

    Attributes:
        raw: Corrected raw table; rows and columns without faults are as logged.
        record: The corrected table as arrays; outliers of channels with heavy-tailed noise have less weight.
        faults: Corrected faults of the log, one of each kind.
        tails: Channels with heavy-tailed noise, and the degrees of freedom of their noise (Student's t).
    """

    raw: pl.DataFrame
    record: Recording
    faults: tuple[Fault, ...] = ()
    tails: tuple[Tail, ...] = ()

    @property
    def changes(self) -> tuple[str, ...]:
        """One sentence for each correction of the recording."""
        return (*(fault.message for fault in self.faults), *heavy_tails_told(self.tails))


def cleaned(vehicle: Vehicle, raw: pl.DataFrame, *, put_right: bool = True) -> Cleaned:
    """Return a recording corrected for bad readings, mislabelled columns, a gyro's bias and outliers.

    The given table does not change.

    Args:
        vehicle: Vehicle of the recording.
        raw: Raw table.
        put_right: Whether to correct mislabelled columns (reversed, exchanged, in degrees or in another
            frame); if False, they raise an error.

    Raises:
        DataError: The recording does not fit the vehicle, columns contradict each other without showing which
            is wrong, or a column is mislabelled and `put_right` is False.
    """
    readings = without_bad_readings(vehicle, raw)
    found = axis_faults(readings.raw, readings.record)
    if found is None:
        return _of(without_outliers(vehicle, without_bias(vehicle, readings)))
    if not put_right:
        raise DataError("; ".join(fault.message for fault in found.wrong))
    log = without_faults(vehicle, found.put_right(raw))
    return _of(replace(log, faults=(*found.faults, *log.faults)))


def heavy_tails_told(tails: tuple[Tail, ...]) -> tuple[str, ...]:
    """Return a tuple with a sentence on the channels with heavy-tailed noise; empty without such channels."""
    if not tails:
        return ()
    names = ", ".join(f"{tail.channel} ({tail.freedom:g})" for tail in tails)
    return (f"noise with heavy tails, Student's t (degrees of freedom): {names}; outliers count for less",)


def _of(log: Corrected) -> Cleaned:
    """Return the cleaned recording from a log whose sensor faults were corrected."""
    return Cleaned(log.raw, log.record, log.faults, log.tails)
