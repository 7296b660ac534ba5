"""Plant (set of simulated vehicles) in the embedded simulator, to test a policy in another simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array, Mask
from hydro.core.compiled import jit
from hydro.core.simulation.dynamics import afloat
from hydro.core.simulation.excitation import LOG_RATE
from hydro.core.simulation.integrate import at_rest
from hydro.core.vehicle.description import Vehicle
from hydro.sim.fleet_plant import FleetPlant
from hydro.sim.flight import Fleet, Pace, begin, fly, require_alike
from hydro.sim.plant import Readings
from hydro.sim.teacher import SUBSTEPS, teacher

STEP = 1.0 / (LOG_RATE * SUBSTEPS)
"""Integration step [s], as in `hydro collect`."""


class TeacherPlant(FleetPlant):
    """Plant whose N vehicles run in the embedded simulator; see `sim.plant.Plant` for its arrays."""

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        count: int = 1,
        period: float = 0.04,
        mesh: tuple[Array, Any] | None = None,
        hidden: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        """Build the embedded simulation of a vehicle file, for `count` vehicles.

        Args:
            vehicle: Vehicle file.
            count: Number of vehicles.
            period: Control step [s].
            mesh: Vertices [m] and faces of its hull; see `sim.teacher.teacher`.
            hidden: Effects that act but are not in the vehicle file.

        Raises:
            DataError: The embedded simulator refuses the vehicle.
        """
        subject = teacher(vehicle, mesh=mesh, hidden=hidden)
        super().__init__(vehicle, subject.program.flat, count, period, STEP)
        self._mesh, self._hidden = mesh, hidden
        self._craft = subject.program.flat, subject.facets
        self._own: dict[int, tuple[Array, Array]] = {}

    def change(self, vehicles: Mapping[int, Vehicle]) -> None:
        """Replace vehicles, given by their index in the plant; each must be reset before its next step.

        Raises:
            DataError: The embedded simulator refuses a vehicle, or it has other thrusters or internal states.
        """
        for number, vehicle in vehicles.items():
            subject = teacher(vehicle, mesh=self._mesh, hidden=self._hidden)
            flat = subject.program.flat
            require_alike(vehicle.name, flat, self._craft[0])
            self._own[number] = flat, subject.facets

    def _fly(self, mask: Mask, pace: Pace) -> None:
        """Simulate the vehicles of a mask (N,) for a control step, or with 0 steps start them."""
        alike, alone = mask.copy(), np.zeros_like(mask)
        for number, craft in self._own.items():
            alike[number] = False
            if mask[number]:
                alone[number] = True
                _fly(alone, *craft, self._fleet, pace, self._readings)
                alone[number] = False
        _fly(alike, *self._craft, self._fleet, pace, self._readings)


@jit
def _fly(mask: Mask, program: Array, facets: Array, fleet: Fleet, pace: Pace, readings: Readings) -> None:
    """Simulate the vehicles of a mask (N,) for a control step; with 0 steps, start their internal states."""
    motion, thrusters, clock = afloat(program, facets), at_rest(program), np.empty(fleet.commands.shape[1])
    for k in np.flatnonzero(mask):
        if pace.steps > 0:
            fly(int(k), motion, thrusters, clock, fleet, pace, readings)
        else:
            begin(int(k), motion, thrusters.table, thrusters.rotors, fleet, pace, readings)
