"""Vehicle file completed by a fit to the recording from which its hull-force model is learnt.

A hull-force model acts along the measured motion, so it describes the error of a file only to first order.
Where a file is far from its vehicle, the model also has to absorb terms of second order, and closed-loop
control lets it exchange inertia for restoring moments.  Both bias what is found later.  A fit of the file's
own effects predicts from the commands alone and has neither fault, so the model is then learnt about the
fitted vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Completion:
    """Vehicle file before and after the fit.

    Attributes:
        file: Vehicle file.
        fitted: The file with fitted effects, buoyancy and thrusters, and with further effects.
    """

    file: Vehicle
    fitted: Vehicle

    def of(self, vehicle: Vehicle) -> Vehicle:
        """Return a vehicle with the fitted values, except where it differs from the file already.

        Args:
            vehicle: The vehicle file, perhaps with effects added or changed, or one completed already.
        """
        given = {table["name"]: table for table in self.file.effect}
        fitted = {table["name"]: table for table in self.fitted.effect}
        there = {table["name"] for table in vehicle.effect}
        own = [
            fitted[table["name"]] if table["name"] in fitted and table == given.get(table["name"]) else table
            for table in vehicle.effect
        ]
        further = [table for name, table in fitted.items() if name not in given and name not in there]
        buoyancy = self.fitted.buoyancy if vehicle.buoyancy == self.file.buoyancy else vehicle.buoyancy
        pairs = zip(vehicle.thruster, self.file.thruster, self.fitted.thruster, strict=True)
        thrusters = tuple(other if one == as_given else one for one, as_given, other in pairs)
        return msgspec.structs.replace(
            vehicle, effect=(*own, *further), buoyancy=buoyancy, thruster=thrusters
        )
