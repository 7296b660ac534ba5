"""What leaving something out of a vehicle costs: the error of predictions 5 s ahead.

Without a recording the vehicle flies the manoeuvres of the library itself, without noise: what another
vehicle file predicts of these flights is then off by what it lacks, and by nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.experiment.library import library
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.export.targets import Lack, all_left_out, of_sensors, without_effects

DEPTH = 10.0
"""Of the manoeuvres' beginning [m]: away from the surface."""
ALL = "all of it"


def flights(vehicle: Vehicle) -> pl.DataFrame:
    """Raw table of what a vehicle does under the manoeuvres of the library, open loop, from rest.

    Raises:
        DataError: It has no thrusters, or its motion diverges in all of them.
    """
    flown, reason = list[pl.DataFrame](), ""
    for manoeuvre in library(vehicle):
        try:
            raw = simulate(vehicle, manoeuvre.table())
        except DataError as error:
            reason = str(error)
            continue
        flown.append(raw)
    if not flown:
        raise DataError(reason)
    return pl.concat(flown)


class Costs:
    """Errors of vehicles 5 s ahead where one of them is the truth, or a recording is.

    Attributes:
        own: Error of the vehicle itself [m/s]: 0 but for smoothing, where it flew the manoeuvres.
    """

    def __init__(self, vehicle: Vehicle, raw: pl.DataFrame | None = None) -> None:
        """Fly the manoeuvres, where there is no recording.

        Args:
            vehicle: The vehicle with all that its file says.
            raw: A recording of it.

        Raises:
            DataError: The vehicle cannot fly, or the recording does not fit it.
        """
        moving = without_effects(vehicle, lambda effect: bool(of_sensors(effect)))
        self._sensors = raw is not None
        if raw is None:
            self._ahead = Ahead(flights(moving), moving)
            self.own = self._ahead.of(moving)
        else:
            self._ahead = Ahead(raw, vehicle)
            self.own = self._ahead.of(vehicle)

    def of(self, vehicle: Vehicle) -> float:
        """Root mean square error of the velocity 5 s ahead [m/s], axes weighed by the true vehicle's inertia.

        Raises:
            DataError: The vehicle does not fit the commands.
        """
        if not self._sensors:
            vehicle = without_effects(vehicle, lambda effect: bool(of_sensors(effect)))
        return self._ahead.of(vehicle)


def of_lacks(vehicle: Vehicle, lacks: Sequence[Lack], raw: pl.DataFrame | None = None) -> pl.DataFrame:
    """What a target cannot hold of a vehicle, and what leaving it out costs.

    Args:
        vehicle: The vehicle.
        lacks: Of the target.
        raw: A recording; by default the vehicle's own manoeuvres.

    Returns:
        `left out`, `why` and `error 5 s ahead [m/s]`, null where no motion depends on it; the vehicle as it
        is first, and all that is left out together last.

    Raises:
        DataError: The vehicle cannot fly, or the recording does not fit it.
    """
    moving = [lack for lack in lacks if lack.without is not None]
    costs = Costs(vehicle, raw) if moving else None
    rows: list[tuple[str, str, float | None]] = []
    if costs is not None:
        rows.append(("nothing", "the vehicle file as it is", costs.own))
    for lack in lacks:
        error = None if costs is None or lack.without is None else costs.of(lack.without)
        rows.append((lack.what, lack.why, error))
    if costs is not None and len(moving) > 1:
        rows.append((ALL, "the vehicle as the target has it", costs.of(all_left_out(vehicle, moving))))
    schema = {"left out": pl.String, "why": pl.String, "error 5 s ahead [m/s]": pl.Float64}
    return pl.DataFrame(rows, schema=schema, orient="row")
