"""MuJoCo model of vehicles (the student): vehicles of one kind in parallel, each with its own commands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import ArrayLike, NDArray

from hydro.core.columns import Array
from hydro.core.effects.program import thrusters_of
from hydro.core.errors import DataError, UsageError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import settled_state
from hydro.sim.bridge import mjcf, native, states
from hydro.sim.bridge.water import AT_CONTROL, AT_CONTROL_STATES, PREFIX, Water, wet
from hydro.sim.residual import control
from hydro.sim.residual.conditioning import COUNTS, OFF, Counts, counts_of

_TIME = mujoco.mjtState.mjSTATE_TIME


@dataclass(frozen=True)
class Physics:
    """Physics step and integrator of MuJoCo; by default 500 Hz as in Wu et al..

    Attributes:
        timestep: Physics step [s].
        integrator: MuJoCo integrator.
    """

    timestep: float = 0.002
    integrator: mjcf.Integrator = "implicitfast"

    def steps(self, period: float, what: str) -> int:
        """Return the number of physics steps in a period [s].

        Args:
            period: The period [s].
            what: Name of the period in the message.

        Raises:
            UsageError: The period is not a whole number of at least one physics step.
        """
        count = round(period / self.timestep)
        if count < 1 or abs(count * self.timestep - period) > 1e-6 * period:
            raise UsageError(
                f"{what} of {period:g} s is not a multiple of the physics step of {self.timestep:g} s; "
                "choose another step"
            )
        return count


class Student:
    """Several vehicles of one vehicle file in MuJoCo, with one clock.

    Attributes:
        model: Compiled MuJoCo model; its controls are the thrusters' effective commands (`recording.supply`),
            which differ from the commands only if a thrust curve is a table.
        batch: The simulations, for other functions of MuJoCo.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        water: Water | None = None,
        *,
        count: int = 1,
        physics: Physics | None = None,
        threads: int = 1,
        folder: Path | None = None,
    ) -> None:
        """Build the model and its simulations.

        Args:
            vehicle: Vehicle file.
            water: Water forces on the vehicles; by default all of the file.
            count: Number of vehicles.
            physics: Step and integrator.
            threads: Number of threads that share the vehicles; results do not depend on it, bit for bit.
            folder: Folder of the vehicle file, which has its hull mesh.

        Raises:
            DataError: The vehicle cannot be simulated.
            UsageError: The control step is not a multiple of the physics step.
        """
        physics = physics or Physics()
        if water is not None and water.control is not None:
            physics.steps(water.control.period, "the control step")
        spec = mjcf.scene(
            vehicle, water, timestep=physics.timestep, integrator=physics.integrator, folder=folder
        )
        self.model = native.prepare(spec.compile())
        self.batch = batch.Batch(self.model, count, nthread=threads)
        self._physics, self._folder, self._models = physics, folder, [self.model] * count
        program = (water or wet(vehicle)).program
        self._table = thrusters_of(program.flat)
        self._control = control_states(self.model, vehicle.name)
        own = None if water is None else water.control
        self._conditioned = own is not None and own.conditioning != OFF
        self._period = 1.0 if own is None else own.period
        self._begun = np.zeros(count)

    def start(
        self, eta: ArrayLike, nu: ArrayLike, *, settled: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> None:
        """Start all vehicles at given states and set the clock.

        Args:
            eta: Pose (count, 6), NED.
            nu: Velocity of CO over ground (count, 6), FRD.
            settled: Commands (count, n) at which the thrusters have settled; NaN for thrusters at rest, which
                is the default for all.
            t: Start time [s], a number or (count,).
        """
        self.batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        self.batch.time[:] = np.broadcast_to(t, len(self.batch.time)).reshape(self.batch.time.shape)
        self._begun = self.batch.time.reshape(-1).copy()
        self.batch.qpos[:], self.batch.qvel[:] = states.to_mujoco(eta, nu)
        if settled is not None:
            for vehicle, commands in enumerate(np.asarray(settled, dtype=np.float64)):
                for thruster in np.flatnonzero(np.isfinite(commands)):
                    self._settle(vehicle, int(thruster), commands[thruster])

    def change(self, vehicles: Mapping[int, tuple[Vehicle, Water]]) -> None:
        """Replace the vehicles of simulations, given by their index.

        Args:
            vehicles: New vehicle and its water forces by index, with the thrusters and internal states of the
                first.

        Raises:
            DataError: A vehicle cannot be simulated, or is too different.
        """
        for number, (vehicle, water) in vehicles.items():
            spec = mjcf.scene(
                vehicle,
                water,
                timestep=self._physics.timestep,
                integrator=self._physics.integrator,
                folder=self._folder,
            )
            self._models[number] = native.prepare(spec.compile())
        try:
            self.batch.set_models(self._models)
        except (ValueError, mujoco.FatalError) as error:
            raise DataError(f"these vehicles cannot be simulated together: {error}") from error

    def restart(self, mask: NDArray[np.bool_], pose: Array, nu: Array) -> None:
        """Start the vehicles of a mask at time 0, with thrusters at rest, and compute their forces.

        Args:
            mask: Vehicles that start, (count,).
            pose: x y z NED and quaternion FRD to NED (count, 7); rows outside the mask are not read.
            nu: Velocity of CO over ground (count, 6), FRD.
        """
        self.batch.reset(mask, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._begun[mask] = 0.0
        self.batch.qpos[mask], self.batch.qvel[mask] = states.coordinates(pose[mask], nu[mask])
        with _silent_warnings():
            self.batch.forward(mask)

    def march(self, steps: int, ids: NDArray[np.int64] | None = None) -> None:
        """Simulate `steps` physics steps with the controls that are stored in the batch.

        Args:
            steps: Number of physics steps.
            ids: Indices of vehicles to simulate; all by default.
        """
        with _silent_warnings():
            self.batch.step(ids, nstep=steps)

    def _settle(self, vehicle: int, thruster: int, command: float) -> None:
        """Set a thruster of a vehicle, both by index, to its steady state under a constant command."""
        if self.model.actuator_actnum[thruster]:
            lag = self.model.actuator_actadr[thruster] + self.model.actuator_actnum[thruster] - 1
            self.batch.act[vehicle, lag] = settled_state(self._table[thruster], command)
        samples = int(self.model.actuator_history[thruster, 0])
        if samples:
            data = self.batch.get_data(vehicle)
            mujoco.mj_initCtrlHistory(self.model, data, thruster, None, np.full(samples, command))
            self.batch.history[vehicle] = data.history

    def state(self) -> tuple[Array, Array]:
        """Return the state of all vehicles, over ground.

        Returns:
            Pose eta (count, 6), NED [m, rad], and velocity nu of CO (count, 6), FRD [m/s, rad/s].
        """
        return states.from_mujoco(self.batch.qpos, self.batch.qvel)

    def diverged(self) -> NDArray[np.bool_]:
        """Return a mask of the vehicles for which MuJoCo has warned since `start`, (count,)."""
        return np.asarray(self.batch.warning[:, :, 1].sum(axis=1) > 0)

    def fly(self, commands: ArrayLike, steps: int, ids: NDArray[np.int64] | None = None) -> Array:
        """Simulate the vehicles under commands, each held for `steps` physics steps, and return the motion.

        Args:
            commands: Commands in [-1, 1], (vehicles, rows, n).
            steps: Physics steps per row.
            ids: Indices of vehicles to simulate; all by default.  All others do not move.

        Returns:
            eta and nu at the end of every row, (vehicles, rows, 12).  NaN from the row in which a flight
            diverged.

        Raises:
            DataError: The number of commands is not that of the thrusters.
        """
        given = np.asarray(commands, dtype=np.float64)
        if given.ndim != 3 or given.shape[2] != len(self._table):
            raise DataError(
                f"commands: expected (vehicles, rows, {len(self._table)}), got shape {given.shape}"
            )
        carrier = self.model.nu - given.shape[2]  # a vehicle without thrusters may have an unused control
        held = np.pad(np.repeat(given, steps, axis=1), ((0, 0), (0, 0), (0, carrier)))
        with _silent_warnings():
            flown = self.batch.rollout(
                nstep=held.shape[1], control=held, record=(_TIME, "qpos", "qvel"), ids=ids
            )
        times, qpos, qvel = (flown[name][:, steps - 1 :: steps] for name in (_TIME, "qpos", "qvel"))
        motion = np.concatenate(states.from_mujoco(qpos, qvel), axis=-1)
        # MuJoCo stops a diverged vehicle, and its clock with it.
        times = times[..., 0]
        planned = times[:, :1] + np.arange(times.shape[1]) * steps * self.model.opt.timestep
        stopped = np.abs(times - planned) > 0.5 * self.model.opt.timestep
        motion[np.logical_or.accumulate(stopped, axis=1)] = np.nan
        return motion

    def conditioning_counts(self) -> list[Counts]:
        """Return, for each vehicle, the number of control steps in which the conditioning acted.

        They count from the vehicle's start.

        Raises:
            UsageError: The vehicles have no network.
        """
        if self._control is None:
            raise UsageError("this MuJoCo model has no residual network, so no conditioning acts")
        if not self._conditioned:
            steps = control.steps_since(self.batch.act[:, self._control :], self._begun, self._period)
            return [Counts(int(count), (0,) * 6, 0) for count in steps]
        first = self._control + control.COUNTED
        return [counts_of(row) for row in self.batch.act[:, first : first + COUNTS]]


@contextmanager
def _silent_warnings() -> Iterator[None]:
    """Suppress MuJoCo's printed warnings and its log file in the working folder; the counters stay."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def control_states(model: mujoco.MjModel, name: str) -> int | None:
    """Return the index in MuJoCo's activations of the first state of a vehicle's network.

    Args:
        model: Compiled model.
        name: Name of the vehicle's body.

    Returns:
        The index; None without a network.
    """
    field = model.numeric(PREFIX + name).data
    return int(field[AT_CONTROL_STATES]) if field[AT_CONTROL] else None
