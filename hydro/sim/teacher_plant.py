"""Plant of vehicles in the embedded simulator, to test a policy in another simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array, Mask
from hydro.core.compiled import jit
from hydro.core.effects.program import STATE_COUNT, thrusters_of
from hydro.core.simulation.dynamics import BODY, afloat
from hydro.core.simulation.excitation import LOG_RATE
from hydro.core.simulation.integrate import at_rest
from hydro.core.vehicle.description import Vehicle
from hydro.sim.flight import Fleet, Pace, begin, fly, remembered, require_alike, steps_of
from hydro.sim.plant import Readings, Snapshot
from hydro.sim.teacher import SUBSTEPS, teacher

STEP = 1.0 / (LOG_RATE * SUBSTEPS)
"""Integration step [s], as in `hydro collect`."""


class TeacherPlant:
    """Vehicles in the embedded simulator; see `sim.plant.Plant` for its arrays."""

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
        gravity = vehicle.environment.gravity
        self._pace = Pace(period, steps_of(period, STEP), gravity)
        self._mesh, self._hidden = mesh, hidden
        subject = teacher(vehicle, mesh=mesh, hidden=hidden)
        flat = subject.program.flat
        table = thrusters_of(flat)
        thrusters, past = len(table), remembered(table, period)
        self.vehicle = vehicle
        self._readings = Readings.of(count, thrusters)
        self.pose, self.velocity, self.specific_force, self.thrust, self.diverged = self._readings
        self._fleet = Fleet(
            np.zeros((count, BODY + int(flat[STATE_COUNT]))),
            np.zeros((count, thrusters)),
            np.zeros((count, past, thrusters)),
            np.zeros(count),
        )
        self._craft = flat, subject.facets
        self._own: dict[int, tuple[Array, Array]] = {}

    def change(self, vehicles: Mapping[int, Vehicle]) -> None:
        """Replace some vehicles; see `sim.plant.Plant`.

        Raises:
            DataError: The embedded simulator refuses one, or it has other thrusters or internal states.
        """
        for number, vehicle in vehicles.items():
            subject = teacher(vehicle, mesh=self._mesh, hidden=self._hidden)
            flat = subject.program.flat
            require_alike(vehicle.name, flat, self._craft[0])
            self._own[number] = flat, subject.facets

    def reset(self, mask: Mask, pose: Array, velocity: Array) -> None:
        """Start some vehicles at given states; see `Plant`."""
        self.diverged[mask] = False
        for array in self._fleet:
            array[mask] = 0.0
        self._fleet.y[mask, :7], self._fleet.y[mask, 7:BODY] = pose[mask], velocity[mask]
        self._fly(mask, self._pace._replace(steps=0))

    def step(self, commands: Array, flying: Mask | None = None) -> None:
        """Simulate one control step; see `Plant`."""
        held = self._fleet.commands
        held[:, :-1] = held[:, 1:]
        held[:, -1] = commands
        self._fly(~self.diverged if flying is None else flying & ~self.diverged, self._pace)

    def _fly(self, mask: Mask, pace: Pace) -> None:
        """Simulate some vehicles for a control step, or start them, and update their arrays."""
        alike, alone = mask.copy(), np.zeros_like(mask)
        for number, craft in self._own.items():
            alike[number] = False
            if mask[number]:
                alone[number] = True
                _fly(alone, *craft, self._fleet, pace, self._readings)
                alone[number] = False
        _fly(alike, *self._craft, self._fleet, pace, self._readings)

    def snapshot(self) -> Snapshot:
        """Return all states and readings."""
        return {name: np.array(array) for name, array in self._state().items()}

    def restore(self, snapshot: Snapshot) -> None:
        """Restore a snapshot, bit for bit."""
        for name, array in self._state().items():
            array[:] = snapshot[name]

    def _state(self) -> Snapshot:
        """Return the arrays that change during simulation, by name."""
        return self._fleet._asdict() | self._readings._asdict()


@jit
def _fly(mask: Mask, program: Array, facets: Array, fleet: Fleet, pace: Pace, readings: Readings) -> None:
    """Simulate the vehicles of a mask (N,) for a control step; with 0 steps, start their internal states."""
    motion, thrusters, clock = afloat(program, facets), at_rest(program), np.empty(fleet.commands.shape[1])
    for k in np.flatnonzero(mask):
        if pace.steps > 0:
            fly(int(k), motion, thrusters, clock, fleet, pace, readings)
        else:
            begin(int(k), motion, thrusters.table, thrusters.rotors, fleet, pace, readings)
