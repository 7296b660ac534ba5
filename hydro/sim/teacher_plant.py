"""A plant of vehicles in the embedded teacher, for a policy to fly where it was not trained."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array, Mask
from hydro.core.compiled import jit
from hydro.core.effects.layout import MOTION, RELATIVE_VELOCITY, ROTATION
from hydro.core.effects.program import STATE_COUNT, start, thrusters_of
from hydro.core.simulation.dynamics import observe
from hydro.core.simulation.excitation import RATE
from hydro.core.simulation.integrate import BODY, advance, rates_kernel
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import DELAY, INFLOW, inflow_speed, state_to_thrust
from hydro.sim.plant import Snapshot
from hydro.sim.teacher import SUBSTEPS, teacher

STEP = 1.0 / (RATE * SUBSTEPS)
"""Integration step [s], that of `hydro collect`."""


class TeacherPlant:
    """Vehicles in the embedded teacher; see `sim.plant.Plant` for its arrays."""

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        count: int = 1,
        period: float = 0.04,
        mesh: tuple[Array, Any] | None = None,
        hidden: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        """Build the teacher of a vehicle file, and fly it so many times.

        Args:
            vehicle: The vehicle file.
            count: Number of vehicles.
            period: Control step [s].
            mesh: Vertices [m] and faces of its hull; see `sim.teacher.teacher`.
            hidden: Effects that act without standing in the vehicle file.

        Raises:
            DataError: The vehicle has no teacher.
        """
        subject = teacher(vehicle, mesh=mesh, hidden=hidden)
        self._flat, self._facets = subject.program.flat, subject.facets
        self._period, self._gravity = period, vehicle.environment.gravity
        table = thrusters_of(self._flat)
        thrusters, past = len(table), 2 + math.ceil(table[:, DELAY].max(initial=0.0) / period)
        self.vehicle = vehicle
        self.pose, self.velocity = np.zeros((count, 7)), np.zeros((count, 6))
        self.pose[:, 3] = 1.0
        self.specific_force, self.thrust = np.zeros((count, 3)), np.zeros((count, thrusters))
        self.diverged = np.zeros(count, dtype=np.bool_)
        self._y = np.zeros((count, BODY + int(self._flat[STATE_COUNT])))
        self._lags, self._commands = np.zeros((count, thrusters)), np.zeros((count, past, thrusters))

    def reset(self, mask: Mask, pose: Array, velocity: Array) -> None:
        """Put some vehicles somewhere; see `Plant`."""
        self.diverged[mask], self._lags[mask], self._commands[mask] = False, 0.0, 0.0
        self._y[mask] = 0.0
        self._y[mask, :7], self._y[mask, 7:BODY] = pose[mask], velocity[mask]
        self._fly(mask, 0.0, begin=True)

    def step(self, commands: Array) -> None:
        """Fly one control step; see `Plant`."""
        self._commands[:, :-1] = self._commands[:, 1:]
        self._commands[:, -1] = commands
        self._fly(~self.diverged, self._period)

    def _fly(self, mask: Mask, period: float, *, begin: bool = False) -> None:
        """Fly some vehicles for a time, and bring their arrays up to date."""
        _march(
            mask, begin, period, self._gravity, self._flat, self._facets, self._commands, self._y, self._lags,
            self.pose, self.velocity, self.specific_force, self.thrust, self.diverged,
        )  # fmt: skip

    def snapshot(self) -> Snapshot:
        """Everything that the future depends on, and the arrays of the present."""
        return {name: np.array(getattr(self, name)) for name in _STATE}

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot, bit for bit."""
        for name in _STATE:
            getattr(self, name)[:] = snapshot[name]


_STATE = ("pose", "velocity", "specific_force", "thrust", "diverged", "_y", "_lags", "_commands")


@jit
def _march(
    mask: Mask,
    begin: bool,
    period: float,
    gravity: float,
    flat: Array,
    facets: Array,
    commands: Array,
    y: Array,
    lags: Array,
    pose: Array,
    velocity: Array,
    specific_force: Array,
    thrust: Array,
    diverged: Mask,
) -> None:
    """Fly the vehicles of a mask (N,) for a time [s]; `begin` starts the effects' internal states first.

    `commands` (N, K, n) are those of the last K control steps, the last one of which begins now.
    """
    table = thrusters_of(flat)
    count, past = table.shape[0], commands.shape[1]
    s, work, rotors = np.zeros(MOTION), np.zeros((4, y.shape[1])), np.zeros((3, count))
    target, upcoming, decay = np.zeros(count), np.zeros(count, np.int64), np.ones(count)
    t = (np.arange(past) - (past - 1.0)) * period
    steps = int(np.ceil(period / STEP - 1e-6))
    for k in np.flatnonzero(mask):
        if begin:
            observe(flat, y[k, :3], y[k, 3:7], y[k, 7:BODY], s)
            start(flat, s, y[k, BODY:])
        rotors[2], due = lags[k], (0.0, 0.0)
        upcoming[:] = 0
        for j in range(steps):
            now, end = period * j / steps, period * (j + 1) / steps
            due = advance(
                flat,
                facets,
                table,
                commands[k],
                t,
                now,
                end,
                due,
                target,
                upcoming,
                decay,
                rotors,
                y[k],
                s,
                work,
            )
        lags[k] = rotors[2]
        rates_kernel(flat, facets, y[k], s, rotors[2], work[3, :6], work[0])
        if not np.isfinite(y[k].sum() + work[0].sum()):
            diverged[k] = True
            continue
        sign = 1.0 if y[k, 3] >= 0.0 else -1.0
        for i in range(7):
            pose[k, i] = y[k, i] if i < 3 else sign * y[k, i]
        velocity[k] = y[k, 7:BODY]
        _feel(gravity, s[ROTATION + 6 : ROTATION + 9], velocity[k], work[0, 7:10], specific_force[k])
        for i in range(count):
            inflow = 0.0
            if table[i, INFLOW] != 0.0:
                inflow = inflow_speed(table[i], s[RELATIVE_VELOCITY : RELATIVE_VELOCITY + 6])
            thrust[k, i] = state_to_thrust(table[i], rotors[2, i], inflow)


@jit
def _feel(gravity: float, down: Array, nu: Array, v_dot: Array, out: Array) -> None:
    """Specific force v_dot + omega x v - R^T g at CO, FRD; `down` (3,) is the world's, in the body."""
    u, v, w, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    out[0] = v_dot[0] + q * w - r * v - gravity * down[0]
    out[1] = v_dot[1] + r * u - p * w - gravity * down[1]
    out[2] = v_dot[2] + p * v - q * u - gravity * down[2]
