"""Plant: several vehicles that a policy controls, one control step at a time.

`Plant` is the interface of a policy to every simulator.  Its arrays are live: `reset` and `step` rewrite them
in place, so that compiled code can read them without a copy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask
from hydro.core.compiled import jit, kernel
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import HALF_TURN, quaternion_kernel
from hydro.sim.bridge.water import Water, wet
from hydro.sim.student import Physics, Student

Snapshot = dict[str, NDArray[np.generic]]


class Readings(NamedTuple):
    """Readings of N simulated vehicles with n thrusters.

    Attributes:
        pose: (N, 7): x y z of CO [m], NED, and the quaternion (w, x, y, z) from FRD to NED with w >= 0.
        velocity: u v w p q r of CO over ground, FRD, (N, 6) [m/s, rad/s].
        specific_force: Reading of an accelerometer at CO, FRD, (N, 3) [m/s^2]; (0, 0, -g) when level at rest.
        thrust: Thrusts (N, n) [N].
        diverged: Whether a vehicle's state has become infinite, or greater than the simulator allows, (N,).
    """

    pose: Array
    velocity: Array
    specific_force: Array
    thrust: Array
    diverged: Mask

    @classmethod
    def of(cls, count: int, thrusters: int) -> Readings:
        """Return the readings of `count` vehicles with `thrusters` thrusters each, at rest at the origin."""
        pose, diverged = np.zeros((count, 7)), np.zeros(count, dtype=np.bool_)
        pose[:, 3] = 1.0
        return cls(pose, np.zeros((count, 6)), np.zeros((count, 3)), np.zeros((count, thrusters)), diverged)


class Coordinates(NamedTuple):
    """Motion of N vehicles in MuJoCo's coordinates.

    Attributes:
        qpos: Position and quaternion in the z-up world (N, 7); see `sim.bridge.states`.
        qvel: Velocities (N, 6).
        qacc: Accelerations at the start of the last physics step (N, 6).
        warning: MuJoCo's counters of warnings, (N, warnings, 2).
    """

    qpos: Array
    qvel: Array
    qacc: Array
    warning: NDArray[np.int32]


class Plant(Protocol):
    """Interface of a set of N simulated vehicles, which a policy controls one control step at a time.

    Attributes:
        vehicle: Vehicle file.
        pose: (N, 7): x y z of CO, NED, and the quaternion (w, x, y, z) from FRD to NED with w >= 0.
        velocity: u v w p q r of CO over ground, FRD, (N, 6).
        specific_force: Reading of an accelerometer at CO, FRD, (N, 3) [m/s^2]; (0, 0, -g) when level at rest.
        thrust: Thrusts (N, n) [N].
        diverged: Vehicles whose state has become infinite, or greater than the simulator allows, since their
            last reset, (N,); their other rows keep the last valid values.
    """

    vehicle: Vehicle
    pose: Array
    velocity: Array
    specific_force: Array
    thrust: Array
    diverged: Mask

    def change(self, vehicles: Mapping[int, Vehicle]) -> None:
        """Replace vehicles, given by their index, from their next reset on.

        The number of thrusters must stay.
        """

    def reset(self, mask: Mask, pose: Array, velocity: Array) -> None:
        """Start the vehicles of a mask (N,) with thrusters at rest and clock at 0.

        Args:
            mask: Vehicles that start, (N,).
            pose: Poses as in `pose` (N, 7).
            velocity: Velocities as in `velocity` (N, 6).
        """

    def step(self, commands: Array, flying: Mask | None = None) -> None:
        """Simulate one control step, and rewrite the arrays of readings.

        Args:
            commands: Commands in [-1, 1], held during the step (N, n).
            flying: Vehicles that move (N,), by default all; all others stay unchanged.
        """

    def snapshot(self) -> Snapshot:
        """Return a copy of all states and readings as arrays by name, for `restore`."""

    def restore(self, snapshot: Snapshot) -> None:
        """Set all states and readings to those of a snapshot, and continue bit for bit."""


class StudentPlant:
    """Plant whose vehicles are MuJoCo models; see `Plant` for its arrays."""

    def __init__(
        self,
        vehicle: Vehicle,
        water: Callable[[Vehicle], Water] = wet,
        *,
        count: int = 1,
        physics: Physics | None = None,
        period: float = 0.04,
        threads: int = 1,
        folder: Path | None = None,
    ) -> None:
        """Build the models, each with its own clock.

        Args:
            vehicle: Vehicle file.
            water: Function that returns the water forces of a vehicle; by default all of its file.
            count: Number of vehicles.
            physics: Step and integrator.
            period: Control step [s].
            threads: Number of threads that share the vehicles; results do not depend on it, bit for bit.
            folder: Folder of the vehicle file, which has its hull mesh.

        Raises:
            DataError: The vehicle cannot be simulated.
            UsageError: The control step is not a multiple of the physics step.
        """
        physics = physics or Physics()
        self._steps = physics.steps(period, "the control step")
        self._student = Student(
            vehicle, water(vehicle), count=count, physics=physics, threads=threads, folder=folder
        )
        self._water = water
        batch, thrusters = self._student.batch, len(vehicle.thruster)
        self._motion = Coordinates(batch.qpos, batch.qvel, batch.qacc, batch.warning)
        self._force = batch.actuator_force[:, :thrusters]
        self._ctrl = batch.ctrl[:, :thrusters]
        self._gravity = vehicle.environment.gravity
        self.vehicle = vehicle
        self._readings, self._all = Readings.of(count, thrusters), np.ones(count, dtype=np.bool_)
        self.pose, self.velocity, self.specific_force, self.thrust, self.diverged = self._readings

    def change(self, vehicles: Mapping[int, Vehicle]) -> None:
        """Replace vehicles, given by their index in the plant; each must be reset before its next step.

        Raises:
            DataError: A vehicle cannot be simulated together with the first.
        """
        self._student.change({k: (vehicle, self._water(vehicle)) for k, vehicle in vehicles.items()})

    def reset(self, mask: Mask, pose: Array, velocity: Array) -> None:
        """Start the vehicles of a mask (N,) with thrusters at rest and clock at 0.

        Args:
            mask: Vehicles that start, (N,).
            pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED (N, 7).
            velocity: u v w p q r over ground, FRD [m/s, rad/s] (N, 6).
        """
        self._student.restart(mask, pose, velocity)
        self.diverged[mask] = False
        self._read(mask)

    def step(self, commands: Array, flying: Mask | None = None) -> None:
        """Simulate one control step, and rewrite the plant's arrays of readings.

        Args:
            commands: Commands in [-1, 1], held during the step (N, n).
            flying: Vehicles that move (N,), by default all; all others stay unchanged.
        """
        self._ctrl[:] = commands
        self._student.march(self._steps, None if flying is None else np.flatnonzero(flying))
        self._read(self._all if flying is None else flying)

    def _read(self, mask: Mask) -> None:
        """Update the readings of the vehicles in a mask (N,)."""
        read_kernel(mask, self._motion, self._gravity, self._readings)
        np.copyto(self.thrust, self._force, where=mask[:, None])

    def snapshot(self) -> Snapshot:
        """Return a copy of all states and readings as arrays by name, for `restore`."""
        batch = self._student.batch
        return {name: np.array(array) for name, array in self._readings._asdict().items()} | {
            "state": np.array(batch.state),
            "warning": np.array(batch.warning),
        }

    def restore(self, snapshot: Snapshot) -> None:
        """Set all states and readings to those of a snapshot, and continue bit for bit."""
        batch = self._student.batch
        batch.state[:], batch.warning[:] = snapshot["state"], snapshot["warning"]
        for name, array in self._readings._asdict().items():
            array[:] = snapshot[name]


@kernel
def upright(state: Array, pose: Array) -> None:
    """Copy a position and a quaternion to `pose`, with the quaternion's sign chosen so that w >= 0.

    Args:
        state: Position [m] and quaternion w x y z, (7,).
        pose: The copy, (7,), written.
    """
    sign = 1.0 if state[3] >= 0.0 else -1.0
    for i in range(7):
        pose[i] = state[i] if i < 3 else sign * state[i]


@jit
def read_kernel(mask: Mask, motion: Coordinates, gravity: float, readings: Readings) -> None:
    """Write the motion of vehicles, given in MuJoCo's coordinates, to `readings` in NED and FRD.

    A vehicle with a warning of MuJoCo, or whose state is not finite, is marked as diverged and keeps its row.

    Args:
        mask: Rows to read, (N,).
        motion: Motion of all vehicles, in MuJoCo's coordinates (`sim.bridge.states`).
        gravity: Gravity [m/s^2].
        readings: Written, except the thrusts; `diverged` is set and never cleared.
    """
    R, force = np.empty(9), np.empty(3)
    qpos, qvel, qacc, warning = motion.qpos, motion.qvel, motion.qacc, motion.warning
    pose, velocity, diverged = readings.pose, readings.velocity, readings.diverged
    for k in np.flatnonzero(mask):
        for kind in range(warning.shape[1]):
            if warning[k, kind, 1] > 0:
                diverged[k] = True
        if not np.isfinite(qpos[k].sum() + qvel[k].sum() + qacc[k].sum()):
            diverged[k] = True
        if diverged[k]:
            continue
        upright(qpos[k], pose[k])
        for i in range(1, 3):
            pose[k, i] *= HALF_TURN[i]
            pose[k, 4 + i] *= HALF_TURN[i]
        quaternion_kernel(pose[k, 3:7], R)
        for i in range(3):
            force[i] = HALF_TURN[i] * qacc[k, i]
        force[2] -= gravity
        for i in range(3):
            velocity[k, i] = R[i] * qvel[k, 0] - R[3 + i] * qvel[k, 1] - R[6 + i] * qvel[k, 2]
            velocity[k, 3 + i] = HALF_TURN[i] * qvel[k, 3 + i]
            readings.specific_force[k, i] = R[i] * force[0] + R[3 + i] * force[1] + R[6 + i] * force[2]
