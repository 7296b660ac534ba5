"""Live simulation of a vehicle, step by step, under commands that arrive one at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.effects import assemble
from hydro.core.effects.layout import ROTATION, TIME
from hydro.core.effects.program import heed, thrusters_of
from hydro.core.errors import DataError
from hydro.core.simulation.dynamics import BODY, NO_HULL, Motion, afloat, rates_kernel, settle
from hydro.core.simulation.integrate import Course, Thrusters, advance, at_rest, resume
from hydro.core.simulation.simulate import steps_of_row
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import euler_from_quaternion, quaternion_from_euler
from hydro.core.vehicle.thrusters import DELAY


class Reading(NamedTuple):
    """State of a vehicle at one time.

    Attributes:
        time: Time since `Live.reset` [s].
        eta: Pose x y z [m, NED] and phi theta psi [rad, ZYX], (6,).
        quaternion: Rotation from body to NED (w, x, y, z), (4,).
        nu: Velocity of CO over ground, body axes, (6,) [m/s, rad/s].
        velocity: Linear velocity of CO in NED, (3,) [m/s].
        specific_force: Reading of an accelerometer at CO, v_dot + omega x v - R^T g, body axes, (3,) [m/s^2];
            v is the linear, omega the angular velocity, and g gravity in NED.
    """

    time: float
    eta: Array
    quaternion: Array
    nu: Array
    velocity: Array
    specific_force: Array


class Live:
    """Vehicle that is simulated step by step, with the same dynamics as `simulate`.

    Attributes:
        time: Time since `reset` [s].
    """

    def __init__(self, vehicle: Vehicle) -> None:
        """Create a vehicle at rest at the origin.

        Args:
            vehicle: The vehicle.

        Raises:
            DataError: An effect or a thruster of the vehicle is invalid.
        """
        program = assemble(vehicle)
        self._gravity = vehicle.environment.gravity
        self._motion: Motion = afloat(program.flat, NO_HULL)
        self._thrusters: Thrusters = at_rest(program.flat)
        self._latest = float(thrusters_of(program.flat)[:, DELAY].max(initial=0.0))
        self.reset()

    def reset(self, eta: ArrayLike = (0.0,) * 6, nu: ArrayLike = (0.0,) * 6) -> None:
        """Set pose and velocity, with time 0 and thrusters at rest.

        Args:
            eta: Pose x y z [m, NED], phi theta psi [rad, ZYX], (6,).
            nu: Velocity of CO over ground, body axes, (6,) [m/s, rad/s].
        """
        pose, count, y = np.asarray(eta, float), len(self._thrusters.target), self._motion.y
        self.time = 0.0
        y[:] = 0.0
        y[:3], y[3:7], y[7:BODY] = pose[:3], quaternion_from_euler(*pose[3:]), np.asarray(nu, float)
        self._motion.s[:] = 0.0
        settle(self._motion)
        self._lags, self._given, self._since = np.zeros(count), np.zeros((0, count)), np.zeros(0)

    def step(self, commands: ArrayLike, length: float) -> None:
        """Advance the motion under constant commands.

        Args:
            commands: Effective commands of the n thrusters, (n,) (`recording.supply`).
            length: Time to advance [s].

        Raises:
            DataError: The commands do not fit the thrusters, or the motion diverges.
        """
        row = np.asarray(commands, float)
        if row.shape != self._lags.shape:
            raise DataError(f"commands: expected {len(self._lags)}, one for each thruster, got {row.shape}")
        felt = self._since + self._latest > self.time
        felt[:-1] |= felt[1:]  # the last of those that are past is still held
        self._given, self._since = self._given[felt], self._since[felt]
        self._given = np.concatenate([self._given, row[None]])
        self._since = np.append(self._since, self.time)
        steps = steps_of_row(length)
        course = Course(self._given, self._since, steps, 0.0)
        _move(self._motion, self._thrusters, course, self._lags, length / steps)
        self.time += length
        if not np.isfinite(self._motion.y.sum()):
            raise DataError(f"the motion diverges by t = {self.time:g} s; check the vehicle's damping")

    def read(self) -> Reading:
        """Return the present state of the vehicle."""
        y, turned, force = self._motion.y, np.zeros(9), np.zeros(3)
        _feel(self._motion, self._lags, self.time, self._gravity, turned, force)
        angles = euler_from_quaternion(y[3:7])
        velocity = turned.reshape(3, 3) @ y[7:10]
        return Reading(
            self.time, np.concatenate([y[:3], angles]), y[3:7].copy(), y[7:BODY].copy(), velocity, force
        )


@jit
def _move(motion: Motion, thrusters: Thrusters, course: Course, lags: Array, length: float) -> None:
    """Advance a motion from the last row of its course, by steps of `length` [s].

    `lags` (n,), the lag states of the thrusters, are read and written.
    """
    last = course.t.size - 1
    resume(thrusters, course, last, False)
    thrusters.rotors[2] = lags
    heed(course.commands[last], motion.s)
    advance(motion, thrusters, course, course.t[last], length, None)
    lags[:] = thrusters.rotors[2]


@jit
def _feel(motion: Motion, lags: Array, time: float, gravity: float, turned: Array, force: Array) -> None:
    """Write the rotation from body to NED to `turned` (9,), the specific force [m/s^2] to `force` (3,)."""
    flat, facets, y, s, work = motion
    s[TIME] = time
    rates_kernel(flat, facets, y, s, lags, work[3, :6], work[0])
    turned[:] = s[ROTATION : ROTATION + 9]
    u, v, w, p, q, r = y[7], y[8], y[9], y[10], y[11], y[12]
    force[0] = work[0, 7] + q * w - r * v - gravity * turned[6]
    force[1] = work[0, 8] + r * u - p * w - gravity * turned[7]
    force[2] = work[0, 9] + p * v - q * u - gravity * turned[8]
