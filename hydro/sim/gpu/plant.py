"""Plant (set of simulated vehicles) on a GPU, one thread each, with the equations of `hydro simulate`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from hydro.core.effects.program import STATE_COUNT, thrusters_of
from hydro.core.errors import DataError
from hydro.core.simulation.dynamics import BODY
from hydro.core.vehicle.description import Vehicle
from hydro.sim.bridge.water import Water, wet
from hydro.sim.craft import STEP, Craft, assigned, control_of, crafts_of, first_of
from hydro.sim.flight import Fleet, Pace, remembered, require_alike, steps_of
from hydro.sim.gpu import memory
from hydro.sim.plant import Readings, Snapshot


class GpuPlant:
    """Vehicles on a GPU: a `sim.plant.Plant` whose arrays are on the device.

    `sim.plant.Plant` describes `pose`, `velocity`, `specific_force`, `thrust` and `diverged`.  `reset` and
    `step` rewrite them in place.  They provide `__cuda_array_interface__`, so
    `torch.as_tensor(plant.pose, device="cuda")` is the same memory.  There are no contacts and no waves.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        water: Callable[[Vehicle], Water] = wet,
        *,
        count: int = 1,
        period: float = 0.04,
        timestep: float = STEP,
    ) -> None:
        """Allocate the vehicles; `reset` starts them.

        Args:
            vehicle: Vehicle file.
            water: Function that returns the water forces of a vehicle; by default all of its file. The
                residual network and conditioning of the first vehicle are used for all.
            count: Number of vehicles N.
            period: Control step [s].
            timestep: Maximum integration step [s].

        Raises:
            UsageError: There is no GPU or no numba-cuda, a number is not positive, or the water has forces
                that only MuJoCo can compute.
            DataError: The vehicle cannot be simulated, or has no thrusters.
        """
        memory.require()
        first, felt = first_of(vehicle, water, count=count, period=period, timestep=timestep)
        table, states = thrusters_of(first.program), int(first.program[STATE_COUNT])
        from hydro.sim.gpu import kernels  # imports numba-cuda

        room = () if felt.control is None else (felt.control.network.room, felt.control.scratch)
        sizes = kernels.Sizes(states, len(table), remembered(table, period), *room)
        self.vehicle, self.count, self._water = vehicle, count, water
        self._start, self._step = kernels.start_kernel(sizes), kernels.step_kernel(sizes)
        self._control = control_of(felt, count, memory.put)
        self._pace = Pace(period, steps_of(period, timestep), vehicle.environment.gravity)
        self._fleet = Fleet(
            memory.zeros((count, BODY + states)),
            memory.zeros((count, len(table))),
            memory.zeros((count, sizes.past, len(table))),
            memory.zeros((count,)),
        )
        self._readings = Readings(*(memory.put(each) for each in Readings.of(count, len(table))))
        self.pose, self.velocity, self.specific_force, self.thrust, self.diverged = self._readings
        self._upload([first], np.zeros(count, dtype=np.int32))

    @property
    def kind(self) -> Any:
        """Index into the `pool` of the parameters of each vehicle, (N,) int32 on the device.

        It may be written: from the next `reset` or `step`, a vehicle moves with the parameters of its new
        index, from its present state.  Indices are not checked.  `pool` and `change` replace this array.
        """
        return self._crafts.kind

    def pool(self, vehicles: Sequence[Vehicle]) -> None:
        """Set P vehicles to choose from.

        `kind` assigns one of them to each simulated vehicle, first the first.

        Args:
            vehicles: Vehicles with the thrusters and internal states of the first vehicle file; only their
                numbers may differ.

        Raises:
            DataError: The pool is empty, or a vehicle cannot be simulated or is too different.
        """
        if not vehicles:
            raise DataError("the pool has no vehicles; give at least one")
        self._upload([self._craft(one) for one in vehicles], np.zeros(self.count, dtype=np.int32))

    def change(self, vehicles: Mapping[int, Vehicle]) -> None:
        """Replace simulated vehicles, given by their index in the plant.

        Unused vehicles of a pool are dropped.

        Raises:
            DataError: A vehicle cannot be simulated or is too different.
        """
        changes = {number: self._craft(vehicle) for number, vehicle in vehicles.items()}
        self._upload(*assigned(self._crafts_on_host, memory.host(self.kind), changes))

    def _craft(self, vehicle: Vehicle) -> Craft:
        """Return a vehicle that can be simulated together with the first."""
        craft = Craft.of(vehicle, self._water(vehicle))
        require_alike(vehicle.name, craft.program, self._crafts_on_host[0].program)
        return craft

    def _upload(self, crafts: list[Craft], kind: NDArray[np.int32]) -> None:
        """Copy programs and the assignment of vehicles to the device."""
        self._crafts_on_host, self._crafts = crafts, crafts_of(crafts, kind, memory.put)

    def reset(self, mask: ArrayLike, pose: ArrayLike, velocity: ArrayLike) -> None:
        """Start the vehicles of a mask with thrusters at rest and clock at 0.

        Args:
            mask: Vehicles that start, (N,), on the device or host, like the other arguments.
            pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED (N, 7).
            velocity: u v w p q r over ground, FRD [m/s, rad/s] (N, 6).

        Raises:
            DataError: An argument has another shape.
        """
        from hydro.sim.gpu.kernels import Start

        self._launch(
            self._start,
            Start(
                self._argument("mask", mask, (self.count,), np.bool_),
                self._argument("pose", pose, (self.count, 7)),
                self._argument("velocity", velocity, (self.count, 6)),
            ),
        )

    def step(self, commands: ArrayLike) -> None:
        """Simulate one control step, and rewrite the plant's arrays of readings on the device.

        Args:
            commands: Commands in [-1, 1], held during the step (N, n), on the device or host.

        Raises:
            DataError: The commands have another shape.
        """
        from hydro.sim.gpu.kernels import Orders

        self._launch(self._step, Orders(self._argument("commands", commands, tuple(self.thrust.shape))))

    def _argument(
        self, name: str, values: ArrayLike, shape: tuple[int, ...], dtype: DTypeLike = np.float64
    ) -> Any:
        """Return an argument as a device array, after a check of its shape and type.

        Without the check, a kernel could read other memory.
        """
        array = memory.seen(values, dtype)
        if tuple(array.shape) != shape or array.dtype != dtype:
            raise DataError(
                f"{name}: expected {np.dtype(dtype)} of shape {shape}, "
                f"got {array.dtype} of {tuple(array.shape)}"
            )
        return array

    def _launch(self, kernel: Any, given: Any) -> None:
        """Run a kernel for all vehicles."""
        from hydro.sim.gpu.kernels import launch

        blocks = self._crafts, self._control, self._fleet, self._readings, self._pace, given
        launch(kernel, self.count, *blocks)

    def readings(self) -> Readings:
        """Return a copy of the readings of all vehicles, as numpy arrays."""
        return Readings(*(memory.host(each) for each in self._readings))

    def snapshot(self) -> Snapshot:
        """Return a copy of all states and readings as arrays by name, on the host."""
        return {name: memory.host(array) for name, array in self._state().items()}

    def restore(self, snapshot: Snapshot) -> None:
        """Set all states and readings to those of a snapshot, and continue bit for bit."""
        for name, array in self._state().items():
            memory.write(array, snapshot[name])

    def _state(self) -> dict[str, Any]:
        """Return the arrays that change during simulation, by name."""
        return self._fleet._asdict() | self._readings._asdict() | {"control": self._control.states}
