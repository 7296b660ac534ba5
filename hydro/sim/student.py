"""The MuJoCo student: vehicles of one kind that fly side by side, each with its own thrusts and held wrench.

Physics runs at the time step of the model; a residual network, where there is one, is evaluated at the slower control step
for all vehicles at once and its wrench held in between, as in the paper (III-B): Kalman filter for nu_dot, network,
conditioning.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mujoco import batch
from numpy.typing import ArrayLike, NDArray

from hydro.core.compiled import jit
from hydro.core.effects import inertia_matrix
from hydro.core.errors import DataError, UsageError
from hydro.core.rigid_body import mass_matrix
from hydro.core.smoothing import Design, filter_step, gains
from hydro.core.vehicle import Vehicle
from hydro.sim import mjcf, native, states
from hydro.sim.network import Network, TrainedModel

Array = NDArray[np.float64]

NOISELESS = 1e6
"""q dt^3 / R of a filter that trusts every sample: a simulated velocity carries no noise."""


@dataclass(frozen=True)
class Physics:
    """How the student is integrated.

    Attributes:
        timestep: Physics step [s].
        integrator: MuJoCo integrator.
        control_step: Time for which a residual network's wrench is held [s], a multiple of the physics step.
    """

    timestep: float = 0.002
    integrator: mjcf.Integrator = "implicitfast"
    control_step: float = 0.04

    @property
    def control_steps(self) -> int:
        """Physics steps per control step.

        Raises:
            UsageError: The control step is no multiple of the physics step.
        """
        return multiple(self.control_step, self.timestep, "the control step")


def multiple(period: float, step: float, what: str) -> int:
    """How many physics steps make up a period.

    Raises:
        UsageError: It is not a whole number of at least one.
    """
    count = round(period / step)
    if count < 1 or abs(count * step - period) > 1e-6 * period:
        raise UsageError(
            f"{what} of {period:g} s is no multiple of the physics step of {step:g} s; choose another step"
        )
    return count


class Student:
    """Several vehicles of one vehicle file in MuJoCo, sharing one clock.

    Attributes:
        model: The compiled MuJoCo model; its controls are thrusts [N].
        seconds: Time since `start` [s].
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        count: int = 1,
        network: TrainedModel | None = None,
        added_mass: bool = True,
        design: Design | None = None,
        physics: Physics | None = None,
        threads: int = 1,
        folder: Path | None = None,
    ) -> None:
        """Build the model and its batch.

        Args:
            vehicle: The vehicle file.
            count: Number of vehicles.
            network: Residual model; it brings all of C(nu) nu and D(nu) nu, so MuJoCo's own C_RB is cancelled.
            added_mass: Without a network, whether M_A is added to the mass matrix; MuJoCo's own C_RB stays as it is.
                A network always has M_A, which its label left out, and brings C_A itself.
            design: Filter for the online acceleration, at any sample time; by default one that trusts every sample.
            physics: Steps and integrator; the paper's by default.
            threads: Threads that share the vehicles.
            folder: Folder of the vehicle file, where a hull mesh is looked for.

        Raises:
            DataError: The vehicle cannot be simulated, or the network is not a plain feedforward one.
            UsageError: The control step is no multiple of the physics step.
        """
        self.physics = physics or Physics()
        self._control_steps = self.physics.control_steps
        self._network = Network.of(network) if network is not None else None
        inertia = inertia_matrix(vehicle)
        spec = mjcf.scene(
            vehicle, timestep=self.physics.timestep, integrator=self.physics.integrator, folder=folder
        )
        if self._network is not None:
            spec.nuserdata = 6
            parameters = native.parameters(inertia=inertia, coriolis=-mass_matrix(vehicle), held=0)
            native.attach(spec, vehicle.name, parameters)
        elif added_mass:
            native.attach(spec, vehicle.name, native.parameters(inertia=inertia))
        self.model = native.prepare(spec.compile())
        self._batch = batch.Batch(self.model, count, nthread=threads)
        design = design or Design(self.physics.control_step, (NOISELESS,) * 6, (0.0,) * 6)
        self._gains = gains(design.at(self.physics.control_step)).forward
        self._filter = np.zeros((count, 6, 2))
        self._steps = 0

    def start(self, eta: ArrayLike, nu: ArrayLike) -> None:
        """Put all vehicles at eta (count, 6), NED, moving with nu (count, 6), FRD, and set the clock to 0."""
        self._batch.reset()
        self._batch.qpos[:], self._batch.qvel[:] = states.to_mujoco(eta, nu)
        self._filter[...] = 0.0
        self._steps = 0

    @property
    def seconds(self) -> float:
        """Time since `start` [s]."""
        return self._steps * self.physics.timestep

    def state(self) -> tuple[Array, Array]:
        """eta (count, 6), NED, and nu (count, 6), FRD over ground, of CO."""
        return states.from_mujoco(self._batch.qpos, self._batch.qvel)

    def diverged(self) -> NDArray[np.bool_]:
        """Which vehicles MuJoCo has raised a warning for since `start`, (count,)."""
        return np.asarray(self._batch.warning[:, :, 1].sum(axis=1) > 0)

    def advance(self, thrusts: ArrayLike, ids: NDArray[np.int64] | None = None) -> None:
        """Fly on.

        Args:
            thrusts: Thrusts [N] of every physics step, (vehicles, steps, n).
            ids: Which vehicles fly; all by default.  The others stay where they are.

        Raises:
            DataError: Not as many thrusts as the vehicle has thrusters.
        """
        forces = np.ascontiguousarray(thrusts, dtype=np.float64)
        if forces.ndim != 3 or forces.shape[2] != self.model.nu:
            raise DataError(f"thrusts: expected (vehicles, steps, {self.model.nu}), got {forces.shape}")
        chosen = np.arange(len(self._filter)) if ids is None else np.asarray(ids)
        done = 0
        while done < forces.shape[1]:
            phase = self._steps % self._control_steps
            if phase == 0 and self._network is not None:
                self._evaluate(self._network, chosen)
            until = min(done + self._control_steps - phase, forces.shape[1])
            part = np.ascontiguousarray(forces[:, done:until])
            self._batch.rollout(nstep=until - done, control=part, ids=chosen)
            self._steps += until - done
            done = until

    def _evaluate(self, network: Network, ids: NDArray[np.int64]) -> None:
        """Renew the held wrench of some vehicles."""
        _, nu = states.from_mujoco(self._batch.qpos[ids], self._batch.qvel[ids])
        tick = self._steps // self._control_steps
        gain = self._gains[min(tick, len(self._gains) - 1)]
        _filter(self._filter, ids, nu, gain, self.physics.control_step, tick == 0)
        moving = np.hstack([nu, self._filter[ids, :, 1]])
        self._batch.userdata[ids] = network.wrench(moving)


@jit
def _filter(filters, ids, nu, gain, dt, first):  # type: ignore[no-untyped-def]
    """Advance the acceleration filters (count, 6, 2) of the vehicles `ids` to their velocities nu (len(ids), 6)."""
    for k in range(ids.size):
        if first:
            filters[ids[k], :, 0] = nu[k]
            filters[ids[k], :, 1] = 0.0
        else:
            filter_step(filters[ids[k]], nu[k], gain, dt)
