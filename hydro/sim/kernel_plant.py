"""Plant (set of simulated vehicles) in this project's own kernels: MuJoCo's physics without MuJoCo.

The computation is that of the plant on a GPU (`sim.gpu`): `sim.flight` integrates with the classical
Runge-Kutta method.  Water forces, thrusters, residual network and conditioning are those of the MuJoCo model.
Contacts and waves are absent; the environments test collisions themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Mask
from hydro.core.compiled import jit
from hydro.core.effects.layout import MOTION, TIME
from hydro.core.simulation.dynamics import Motion
from hydro.core.simulation.held import FELT, WITH_HELD
from hydro.core.simulation.integrate import Thrusters
from hydro.core.threads import spread
from hydro.core.vehicle.description import Vehicle
from hydro.sim.bridge.water import Water, wet
from hydro.sim.craft import STEP, Control, Craft, Crafts, assigned, control_of, crafts_of, first_of
from hydro.sim.fleet_plant import FleetPlant
from hydro.sim.flight import Fleet, Pace, begin, fly, require_alike
from hydro.sim.plant import Readings
from hydro.sim.residual.control import Room, Tables, attend


class KernelPlant(FleetPlant):
    """Plant of N vehicles in this project's own kernels, on the processor; see `sim.plant.Plant`."""

    def __init__(
        self,
        vehicle: Vehicle,
        water: Callable[[Vehicle], Water] = wet,
        *,
        count: int = 1,
        period: float = 0.04,
        timestep: float = STEP,
        threads: int = 1,
    ) -> None:
        """Allocate the vehicles; `reset` starts them.

        Args:
            vehicle: Vehicle file.
            water: Function that returns the water forces of a vehicle; by default all of its file. The
                residual network and conditioning of the first vehicle are used for all.
            count: Number of vehicles N.
            period: Control step [s].
            timestep: Maximum integration step [s].
            threads: Number of threads that share the vehicles; results do not depend on it, bit for bit.

        Raises:
            UsageError: A number is not positive, the network has another control step, or the water has
                forces that only MuJoCo can compute.
            DataError: The vehicle cannot be simulated, or has no thrusters.
        """
        first, felt = first_of(vehicle, water, count=count, period=period, timestep=timestep)
        super().__init__(vehicle, first.program, count, period, timestep)
        self._water, self._threads = water, threads
        self._room = (0, 0) if felt.control is None else (felt.control.network.room, felt.control.scratch)
        self._control = control_of(felt, count)
        self._list, self._crafts = [first], crafts_of([first], np.zeros(count, dtype=np.int32))

    def change(self, vehicles: Mapping[int, Vehicle]) -> None:
        """Replace vehicles, given by their index in the plant; each must be reset before its next step.

        Raises:
            DataError: A vehicle cannot be simulated together with the first.
        """
        changes = {}
        for number, vehicle in vehicles.items():
            changes[number] = Craft.of(vehicle, self._water(vehicle))
            require_alike(vehicle.name, changes[number].program, self._list[0].program)
        self._list, kind = assigned(self._list, self._crafts.kind, changes)
        self._crafts = crafts_of(self._list, kind)

    def _fly(self, mask: Mask, pace: Pace) -> None:
        """Simulate the vehicles of a mask (N,) for a control step; with 0 steps, start them."""

        def work(part: Mask) -> None:
            fly_kernel(part, self._crafts, self._control, self._room, self._fleet, pace, self._readings)

        if self._threads == 1:
            work(mask)
            return
        owner = np.arange(len(mask)) * self._threads // len(mask)
        spread(work, [mask & (owner == k) for k in range(self._threads)], self._threads)

    def _states(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Yield the states of the vehicles and of the network's control, with their names."""
        yield from super()._states()
        yield "control", self._control.states


@jit
def fly_kernel(
    mask: Mask,
    crafts: Crafts,
    control: Control,
    room: tuple[int, int],
    fleet: Fleet,
    pace: Pace,
    readings: Readings,
) -> None:
    """Simulate the vehicles of a mask for a control step; write their states and readings.

    Args:
        mask: Vehicles that move, (N,).
        crafts: Programs of all vehicles.
        control: Residual network and its states.
        room: Lengths of the network's workspace and of its further buffer; (0, 0) without a network.
        fleet: States of all vehicles, written; the newest commands are those of this step.
        pace: Time steps; with 0 steps, the internal states start at their steady values instead.
        readings: Pose, velocity, specific force, thrusts and divergence of all vehicles, written.
    """
    size, thrusters, networked = fleet.y.shape[1], fleet.lags.shape[1], room[0] > 0
    y, work = np.zeros(size), np.zeros((4, size))
    s, clock = np.zeros(WITH_HELD if networked else MOTION), np.empty(fleet.commands.shape[1])
    target, upcoming, decay = np.zeros(thrusters), np.zeros(thrusters, np.int64), np.ones(thrusters)
    rotors, due = np.zeros((3, thrusters)), np.zeros(2)
    buffers = Room(np.empty(room[0], np.float32), np.empty(room[1]))
    tables = Tables(control.block, control.gains, control.program, control.weights)
    for each in np.flatnonzero(mask):
        k = int(each)
        row = crafts.kind[k]
        program, table = crafts.programs[row], crafts.tables[row]
        s[:] = 0.0
        if networked:
            s[TIME], s[FELT] = fleet.time[k], float(control.felt)
            attend(program, fleet.y[k], tables, control.states[k], crafts.inertia[row], s, buffers)
        motion = Motion(program, crafts.facets, y, s, work)
        if pace.steps > 0:
            crew = Thrusters(table, target, upcoming, decay, rotors, due)
            fly(k, motion, crew, clock, fleet, pace, readings)
        else:
            begin(k, motion, table, rotors, fleet, pace, readings)
