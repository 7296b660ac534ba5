"""Errors of vehicle files 5 s ahead where another vehicle file is the truth, or a recording is.

Without a recording the true vehicle flies the manoeuvres of the library itself, without noise: what another
file predicts of these flights is then off by how it differs, and by nothing else.
"""

from __future__ import annotations

import msgspec
import polars as pl

from hydro.core.effects.catalogue import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.experiment.library import library
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle

ERROR = "error 5 s ahead [m/s]"
"""What tables call it."""


def flights(vehicle: Vehicle) -> pl.DataFrame:
    """Raw table of what a vehicle does under the manoeuvres of the library, open loop, from rest.

    Raises:
        DataError: It has no thrusters, or its motion diverges in all of them.
    """
    flown, reason = list[pl.DataFrame](), ""
    for manoeuvre in library(vehicle):
        try:
            flown.append(simulate(vehicle, manoeuvre.table()))
        except DataError as error:
            reason = str(error)
    if not flown:
        raise DataError(reason)
    return pl.concat(flown)


class Errors:
    """Errors of vehicle files 5 s ahead.

    Attributes:
        own: Error of the true vehicle itself [m/s]: of smoothing alone where it flew the manoeuvres.
    """

    def __init__(self, vehicle: Vehicle, raw: pl.DataFrame | None = None) -> None:
        """Fly the manoeuvres, where there is no recording.

        Args:
            vehicle: The true vehicle; axes are weighed by its inertia.
            raw: A recording of it.

        Raises:
            DataError: The vehicle cannot fly, or the recording does not fit it.
        """
        self._recorded = raw is not None
        true = self._logged(vehicle)
        self._ahead = Ahead(flights(true) if raw is None else raw, true)
        self.own = self.of(vehicle)

    def of(self, vehicle: Vehicle) -> float:
        """Root mean square error of the velocity 5 s ahead [m/s], as in `compare` and `explain`.

        Raises:
            DataError: The vehicle does not fit the commands.
        """
        return self._ahead.of(self._logged(vehicle))

    def _logged(self, vehicle: Vehicle) -> Vehicle:
        """The vehicle, its velocity log without errors where it is the true motion that is predicted."""
        if self._recorded:
            return vehicle
        kept = (table for table in vehicle.effect if CATALOGUE[table["name"]].kind != "sensor")
        return msgspec.structs.replace(vehicle, effect=tuple(kept))
