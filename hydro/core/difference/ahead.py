"""Prediction errors of vehicle files 5 s ahead, where another vehicle file or a recording is the truth.

Without a recording the manoeuvres of the library are simulated with the true vehicle, without noise.  The
error of another file on these runs is due to its differences only.
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
"""Name of the column in tables."""


def flights(vehicle: Vehicle) -> pl.DataFrame:
    """Simulate the manoeuvres of the library open loop from rest, as a raw table.

    Raises:
        DataError: The vehicle has no thrusters, or its motion diverges in every manoeuvre.
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
    """Prediction errors of vehicle files 5 s ahead.

    Attributes:
        own: Error of the true vehicle itself [m/s]; due to smoothing alone on simulated manoeuvres.
    """

    def __init__(self, vehicle: Vehicle, raw: pl.DataFrame | None = None) -> None:
        """Simulate the manoeuvres if no recording is given.

        Args:
            vehicle: True vehicle, whose inertia weights the axes.
            raw: Raw table of a recording of it.

        Raises:
            DataError: The motion of the vehicle diverges, or the recording does not fit it.
        """
        self._recorded = raw is not None
        true = self._logged(vehicle)
        self._ahead = Ahead(flights(true) if raw is None else raw, true)
        self.own = self.of(vehicle)

    def of(self, vehicle: Vehicle) -> float:
        """Return the root mean square velocity error 5 s ahead [m/s], as in `compare` and `explain`.

        Raises:
            DataError: The vehicle does not fit the commands.
        """
        return self._ahead.of(self._logged(vehicle))

    def _logged(self, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle, without errors of its velocity sensor on simulated manoeuvres."""
        if self._recorded:
            return vehicle
        kept = (table for table in vehicle.effect if CATALOGUE[table["name"]].kind != "sensor")
        return msgspec.structs.replace(vehicle, effect=tuple(kept))
