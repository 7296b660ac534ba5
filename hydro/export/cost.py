"""Prediction error 5 s ahead due to properties of a vehicle that a target cannot represent."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

from hydro.core.difference.ahead import ERROR, Errors
from hydro.core.vehicle.description import Vehicle
from hydro.export.targets import Lack, all_left_out

ALL = "all of it"  # name of the row without all unsupported properties


def of_lacks(vehicle: Vehicle, lacks: Sequence[Lack], raw: pl.DataFrame | None = None) -> pl.DataFrame:
    """Return a table of the prediction errors that the missing properties of an export target cause.

    Args:
        vehicle: The vehicle.
        lacks: Properties that the target cannot represent.
        raw: A recording (raw table); by default manoeuvres simulated with the vehicle.

    Returns:
        A frame with one row per property: `left out`, `why` and the root mean square velocity error 5 s ahead
        [m/s] without this property, null if no motion depends on it.  The first row is the complete vehicle;
        the last one leaves out all properties together, if there are several.

    Raises:
        DataError: The vehicle cannot be simulated, or the recording does not fit it.
    """
    moving = [lack for lack in lacks if lack.without is not None]
    errors = Errors(vehicle, raw) if moving else None
    rows: list[tuple[str, str, float | None]] = []
    if errors is not None:
        rows.append(("nothing", "the vehicle file as it is", errors.own))
    for lack in lacks:
        error = None if errors is None or lack.without is None else errors.of(lack.without)
        rows.append((lack.what, lack.why, error))
    if errors is not None and len(moving) > 1:
        rows.append((ALL, "the vehicle as the target has it", errors.of(all_left_out(vehicle, moving))))
    schema = {"left out": pl.String, "why": pl.String, ERROR: pl.Float64}
    return pl.DataFrame(rows, schema=schema, orient="row")
