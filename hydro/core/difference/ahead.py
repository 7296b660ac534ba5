"""Prediction errors of vehicle files 5 s ahead, where another vehicle file or a recording is the truth.

Without a recording, the true vehicle is simulated in the manoeuvres of the library, without noise.  The error
of another file on these runs is then due to its differences from the true vehicle only.
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
"""Name of the column of prediction errors in tables."""


def flights(vehicle: Vehicle) -> pl.DataFrame:
    """Return simulated flights of all manoeuvres of the library, open loop from rest, as one raw table.

    Manoeuvres in which the motion diverges are left out.

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
    """Prediction errors of vehicle files 5 s ahead; the truth is a vehicle's simulation or a recording.

    Attributes:
        own: Error of the true vehicle's file itself [m/s]; on simulated manoeuvres due to smoothing alone.
    """

    def __init__(self, vehicle: Vehicle, raw: pl.DataFrame | None = None) -> None:
        """Prepare the true motion: the recording, or else simulated manoeuvres.

        Args:
            vehicle: True vehicle, whose inertia weights the axes.
            raw: Raw table of a recording of the true vehicle; None to simulate the manoeuvres of the library.

        Raises:
            DataError: The motion of the vehicle diverges, or the recording does not fit it.
        """
        self._recorded = raw is not None
        true = self._logged(vehicle)
        self._ahead = Ahead(flights(true) if raw is None else raw, true)
        self.own = self.of(vehicle)

    def of(self, vehicle: Vehicle) -> float:
        """Return the root mean square velocity error of a vehicle file, predicted 5 s ahead [m/s].

        The error is measured as `hydro compare` and `hydro explain` do.

        Args:
            vehicle: Vehicle file to test.

        Raises:
            DataError: The vehicle does not fit the commands.
        """
        return self._ahead.of(self._logged(vehicle))

    def _logged(self, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle; on simulated manoeuvres without errors of sensors, which are not simulated."""
        if self._recorded:
            return vehicle
        kept = (table for table in vehicle.effect if CATALOGUE[table["name"]].kind != "sensor")
        return msgspec.structs.replace(vehicle, effect=tuple(kept))
