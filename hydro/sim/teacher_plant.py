"""A plant of vehicles in the embedded teacher, for a policy to fly where it was not trained."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hydro.core.columns import Array, Mask
from hydro.core.compiled import jit
from hydro.core.effects.layout import ROTATION, TIME
from hydro.core.effects.program import STATE_COUNT, heed, thrusters_of
from hydro.core.errors import DataError
from hydro.core.simulation.dynamics import BODY, Motion, afloat, rates_kernel, settle, thrust_of
from hydro.core.simulation.excitation import LOG_RATE
from hydro.core.simulation.integrate import Course, Thrusters, advance, at_rest, resume
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import DELAY
from hydro.sim.plant import Readings, Snapshot, upright
from hydro.sim.teacher import SUBSTEPS, teacher

STEP = 1.0 / (LOG_RATE * SUBSTEPS)
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
        self._period, self._gravity = period, vehicle.environment.gravity
        self._mesh, self._hidden = mesh, hidden
        subject = teacher(vehicle, mesh=mesh, hidden=hidden)
        flat = subject.program.flat
        table = thrusters_of(flat)
        thrusters, past = len(table), 2 + math.ceil(table[:, DELAY].max(initial=0.0) / period)
        self.vehicle = vehicle
        self._readings = Readings.of(count, thrusters)
        self.pose, self.velocity, self.specific_force, self.thrust, self.diverged = self._readings
        self._y = np.zeros((count, BODY + int(flat[STATE_COUNT])))
        self._lags, self._commands = np.zeros((count, thrusters)), np.zeros((count, past, thrusters))
        self._time = np.zeros(count)
        self._fleet = _Fleet(flat, subject.facets, self._y, self._lags, self._commands, self._time)
        self._own: dict[int, _Fleet] = {}

    def change(self, vehicles: Mapping[int, Vehicle]) -> None:
        """Let some be other vehicles; see `sim.plant.Plant`.

        Raises:
            DataError: One has no teacher, or has other thrusters or memories than the first.
        """
        for number, vehicle in vehicles.items():
            subject = teacher(vehicle, mesh=self._mesh, hidden=self._hidden)
            flat = subject.program.flat
            alike = thrusters_of(flat).shape == thrusters_of(self._fleet.flat).shape
            if not alike or flat[STATE_COUNT] != self._fleet.flat[STATE_COUNT]:
                raise DataError(
                    f"{vehicle.name}: flies beside vehicles with other thrusters or memories; give one "
                    "that differs in its numbers alone"
                )
            self._own[number] = self._fleet._replace(flat=flat, facets=subject.facets)

    def reset(self, mask: Mask, pose: Array, velocity: Array) -> None:
        """Put some vehicles somewhere; see `Plant`."""
        self.diverged[mask], self._lags[mask], self._commands[mask] = False, 0.0, 0.0
        self._y[mask], self._time[mask] = 0.0, 0.0
        self._y[mask, :7], self._y[mask, 7:BODY] = pose[mask], velocity[mask]
        self._fly(mask, 0.0, begin=True)

    def step(self, commands: Array) -> None:
        """Fly one control step; see `Plant`."""
        self._commands[:, :-1] = self._commands[:, 1:]
        self._commands[:, -1] = commands
        self._fly(~self.diverged, self._period)

    def _fly(self, mask: Mask, period: float, *, begin: bool = False) -> None:
        """Fly some vehicles for a time, and bring their arrays up to date."""
        alike, alone = mask.copy(), np.zeros_like(mask)
        for number, fleet in self._own.items():
            alike[number] = False
            if mask[number]:
                alone[number] = True
                _fly(alone, fleet, begin, period, self._gravity, self._readings)
                alone[number] = False
        _fly(alike, self._fleet, begin, period, self._gravity, self._readings)

    def snapshot(self) -> Snapshot:
        """Everything that the future depends on, and the arrays of the present."""
        return {name: np.array(getattr(self, name)) for name in _STATE}

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot, bit for bit."""
        for name in _STATE:
            getattr(self, name)[:] = snapshot[name]


_STATE = ("pose", "velocity", "specific_force", "thrust", "diverged", "_y", "_lags", "_commands", "_time")


class _Fleet(NamedTuple):
    """N vehicles of one kind: program, hull, states (N, 13 + states), lag states (N, n), and commands.

    The commands (N, K, n) are those of the last K control steps, the last one of which begins now.
    """

    flat: Array
    facets: Array
    y: Array
    lags: Array
    commands: Array
    time: Array


@jit
def _fly(mask: Mask, fleet: _Fleet, begin: bool, period: float, gravity: float, readings: Readings) -> None:
    """Fly the vehicles of a mask (N,) for a time [s]; `begin` starts the effects' internal states first."""
    motion, thrusters, past = afloat(fleet.flat, fleet.facets), at_rest(fleet.flat), fleet.commands.shape[1]
    ago = (np.arange(past) - (past - 1.0)) * period
    steps = int(np.ceil(period / STEP - 1e-6))
    for k in np.flatnonzero(mask):
        now = fleet.time[k]
        course = Course(fleet.commands[k], now + ago, steps, 0.0)
        motion.y[:], motion.s[TIME] = fleet.y[k], now
        if begin:
            settle(motion)
        resume(thrusters, course, past - 1, False)
        thrusters.rotors[2] = fleet.lags[k]
        if steps > 0:
            heed(course.commands[past - 1], motion.s)
            advance(motion, thrusters, course, now, period / steps, None)
        fleet.y[k], fleet.lags[k], fleet.time[k] = motion.y, thrusters.rotors[2], now + period
        _read(motion, thrusters, gravity, int(k), readings)


@jit
def _read(motion: Motion, thrusters: Thrusters, gravity: float, k: int, readings: Readings) -> None:
    """Write the readings of vehicle k, or mark it as diverged and keep what they were."""
    y, s, work, rotors = motion.y, motion.s, motion.work, thrusters.rotors[2]
    rates_kernel(motion.flat, motion.facets, y, s, rotors, work[3, :6], work[0])
    if not np.isfinite(y.sum() + work[0].sum()):
        readings.diverged[k] = True
        return
    upright(y, readings.pose[k])
    readings.velocity[k] = y[7:BODY]
    down = s[ROTATION + 6 : ROTATION + 9]
    _feel(gravity, down, readings.velocity[k], work[0, 7:10], readings.specific_force[k])
    for i in range(rotors.size):
        readings.thrust[k, i] = thrust_of(thrusters.table[i], rotors[i], s)


@jit
def _feel(gravity: float, down: Array, nu: Array, v_dot: Array, out: Array) -> None:
    """Specific force v_dot + omega x v - R^T g at CO, FRD; `down` (3,) is the world's, in the body."""
    u, v, w, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    out[0] = v_dot[0] + q * w - r * v - gravity * down[0]
    out[1] = v_dot[1] + r * u - p * w - gravity * down[1]
    out[2] = v_dot[2] + p * v - q * u - gravity * down[2]
