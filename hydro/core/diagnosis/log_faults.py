"""A log freed of its own faults before anything is fitted to it, and what they were, for the user."""

from __future__ import annotations

from dataclasses import dataclass

import polars as pl

from hydro.core.columns import command_column
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.thruster_order import Rewired, Wiring, rewired
from hydro.core.recording.arrays import recording
from hydro.core.recording.sensor_faults import freed
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Sound:
    """A recording without the faults of its log.

    Attributes:
        raw: Raw table.
        faults: A finding for each kind of fault.
        wiring: The order of the command columns, where it is another than the vehicle file's.
    """

    raw: pl.DataFrame
    faults: tuple[Finding, ...]
    wiring: Wiring | None = None


def sound(vehicle: Vehicle, raw: pl.DataFrame) -> Sound:
    """The recording without readings that no motion makes, its commands as the accelerations ask for them.

    Args:
        vehicle: The vehicle.
        raw: Raw table.

    Raises:
        DataError: The recording does not fit the vehicle.
    """
    kept, faults = freed(vehicle, raw)
    found = rewired(vehicle, recording(kept, vehicle))
    if found is None:
        return Sound(kept, faults)
    return Sound(ordered(kept, found.wiring), (*faults, _exchanged(found)), found.wiring)


def ordered(raw: pl.DataFrame, wiring: Wiring | None) -> pl.DataFrame:
    """The table with its command columns in the order that the vehicle file means."""
    if wiring is None:
        return raw
    drives = zip(wiring.column, wiring.sign, strict=True)
    return raw.with_columns(
        (sign * pl.col(command_column(column))).alias(command_column(i))
        for i, (column, sign) in enumerate(drives)
    )


def _exchanged(found: Rewired) -> Finding:
    """That commands are exchanged or reversed."""
    words = (
        f"it looks as if {found.wiring.words()}: then the forces leave {found.left:.2g} of what they leave "
        "unexplained now; run each thruster alone and put the columns, or the [[thruster]] tables, in "
        "order. All else here is told as if they were so"
    )
    return Finding("log_fault", members=found.wiring.columns(), confidence=found.confidence, advice=words)
