"""What leaving something out of a vehicle costs: the error of predictions 5 s ahead."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

from hydro.core.difference.ahead import ERROR, Errors
from hydro.core.vehicle.description import Vehicle
from hydro.export.targets import Lack, all_left_out

ALL = "all of it"


def of_lacks(vehicle: Vehicle, lacks: Sequence[Lack], raw: pl.DataFrame | None = None) -> pl.DataFrame:
    """What a target cannot hold of a vehicle, and what leaving it out costs.

    Args:
        vehicle: The vehicle.
        lacks: Of the target.
        raw: A recording; by default the vehicle's own manoeuvres.

    Returns:
        `left out`, `why` and the error 5 s ahead, null where no motion depends on it; the vehicle as it is
        first, and all that is left out together last.

    Raises:
        DataError: The vehicle cannot fly, or the recording does not fit it.
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
