"""Base of the plants (sets of simulated vehicles) that integrate with `sim.flight` on the processor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask
from hydro.core.effects.program import STATE_COUNT, thrusters_of
from hydro.core.simulation.dynamics import BODY
from hydro.core.vehicle.description import Vehicle
from hydro.sim.flight import Fleet, Pace, remembered, steps_of
from hydro.sim.plant import Readings, Snapshot


class FleetPlant(ABC):
    """Base class of plants on the processor: N vehicles, their start, control step and snapshots.

    A subclass sets the programs of its vehicles, and moves them in `_fly`; see `sim.plant.Plant`.
    """

    def __init__(self, vehicle: Vehicle, program: Array, count: int, period: float, timestep: float) -> None:
        """Allocate the vehicles; `reset` starts them.

        Args:
            vehicle: Vehicle file.
            program: Its compiled effects and thrusters, which give the numbers of states.
            count: Number of vehicles N.
            period: Control step [s].
            timestep: Maximum integration step [s].
        """
        table, states = thrusters_of(program), int(program[STATE_COUNT])
        self.vehicle = vehicle
        self._pace = Pace(period, steps_of(period, timestep), vehicle.environment.gravity)
        self._readings = Readings.of(count, len(table))
        self.pose, self.velocity, self.specific_force, self.thrust, self.diverged = self._readings
        self._fleet = Fleet(
            np.zeros((count, BODY + states)),
            np.zeros((count, len(table))),
            np.zeros((count, remembered(table, period), len(table))),
            np.zeros(count),
        )

    def reset(self, mask: Mask, pose: Array, velocity: Array) -> None:
        """Start the vehicles of a mask (N,) with thrusters at rest and clock at 0.

        Args:
            mask: Vehicles that start, (N,).
            pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED (N, 7).
            velocity: u v w p q r over ground, FRD [m/s, rad/s] (N, 6).
        """
        self.diverged[mask] = False
        for _, array in self._states():
            array[mask] = 0.0
        self._fleet.y[mask, :7], self._fleet.y[mask, 7:BODY] = pose[mask], velocity[mask]
        self._fly(mask, self._pace._replace(steps=0))

    def step(self, commands: Array, flying: Mask | None = None) -> None:
        """Simulate one control step, and rewrite the plant's arrays of readings.

        Args:
            commands: Commands in [-1, 1], held during the step (N, n).
            flying: Vehicles that move (N,), by default all; all others stay unchanged.
        """
        held = self._fleet.commands
        held[:, :-1] = held[:, 1:]
        held[:, -1] = commands
        self._fly(~self.diverged if flying is None else flying & ~self.diverged, self._pace)

    def snapshot(self) -> Snapshot:
        """Return a copy of all states and readings as arrays by name, for `restore`."""
        return {name: np.array(array) for name, array in self._arrays()}

    def restore(self, snapshot: Snapshot) -> None:
        """Set all states and readings to those of a snapshot, and continue bit for bit."""
        for name, array in self._arrays():
            array[:] = snapshot[name]

    def _arrays(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Yield the arrays that change during simulation, with their names."""
        yield from self._states()
        yield from self._readings._asdict().items()

    def _states(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Yield the states of the vehicles, which a reset sets to 0, with their names."""
        yield from self._fleet._asdict().items()

    @abstractmethod
    def _fly(self, mask: Mask, pace: Pace) -> None:
        """Simulate the vehicles of a mask (N,) for a control step; with 0 steps, start them."""
