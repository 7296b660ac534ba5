"""Cleaned recording used by compare, diagnose, explain and fit, with a list of the changes.

The order matters.  Impossible readings are removed first, since they would hide mislabelled columns.
Mislabelled columns are corrected next.  A gyro's bias and the tails of the noise come last.

Every change is a line in `Cleaned.changes`.  Outliers of a channel with heavy tails get a smaller weight in
the observation model (`Cleaned.record`) and stay in the table as logged.
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
        raw: Raw table; rows and columns without faults are as logged.
        record: The table as arrays, with the observation model of channels whose noise has heavy tails.
        faults: Faults of the log, one of each kind.
        tails: Noise of the channels with heavy tails.
    """

    raw: pl.DataFrame
    record: Recording
    faults: tuple[Fault, ...] = ()
    tails: tuple[Tail, ...] = ()

    @property
    def changes(self) -> tuple[str, ...]:
        """Sentences on the changes, one each."""
        return (*(fault.message for fault in self.faults), *heavy_tails_told(self.tails))


def cleaned(vehicle: Vehicle, raw: pl.DataFrame, *, put_right: bool = True) -> Cleaned:
    """Clean a recording.

    Args:
        vehicle: The vehicle.
        raw: Raw table.
        put_right: Whether mislabelled columns are corrected; otherwise they are refused.

    Raises:
        DataError: The recording does not fit the vehicle, columns contradict each other without showing which
            is wrong, or a column is wrong and `put_right` is False.
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
    """Return the sentence on channels whose noise has heavy tails; empty without any."""
    if not tails:
        return ()
    names = ", ".join(f"{tail.channel} ({tail.freedom:g})" for tail in tails)
    return (f"noise with heavy tails, Student's t (degrees of freedom): {names}; outliers count for less",)


def _of(log: Corrected) -> Cleaned:
    """Return the cleaned recording of one whose sensors were corrected."""
    return Cleaned(log.raw, log.record, log.faults, log.tails)
