"""A log freed of its own faults before anything is fitted to it, and what they were, for the user."""

from __future__ import annotations

import polars as pl

from hydro.core.findings import Finding
from hydro.core.readings import faults, mended, told
from hydro.core.recording import recording
from hydro.core.vehicle import Vehicle


def freed(vehicle: Vehicle, raw: pl.DataFrame) -> tuple[pl.DataFrame, tuple[Finding, ...]]:
    """The recording without readings that no motion makes, and a finding for each kind of them.

    Args:
        vehicle: The vehicle.
        raw: Raw table.

    Raises:
        DataError: The recording does not fit the vehicle.
    """
    record = recording(raw, vehicle)
    found = faults(record)
    lines = told(raw, record, found)
    findings = (Finding("log_fault", members=columns, advice=words) for columns, words in lines)
    return mended(raw, record, found), tuple(findings)
