"""One control step of a vehicle by the classical Runge-Kutta method, for processor and GPU.

On the processor, the vehicles of a plant are simulated one after another (`sim.fleet_plant`); on a GPU,
each has a thread (`sim.gpu`).  Both call `fly`, which allocates no arrays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hydro.core.columns import Array
from hydro.core.compiled import copy_kernel, kernel
from hydro.core.effects.layout import ROTATION, TIME
from hydro.core.effects.program import STATE_COUNT, THRUSTER_COUNT, heed
from hydro.core.errors import DataError
from hydro.core.simulation.dynamics import BODY, Motion, rates_kernel, settle, thrust_of
from hydro.core.simulation.integrate import Course, Thrusters, advance, resume
from hydro.core.vehicle.thrusters import DELAY
from hydro.sim.plant import Readings, upright

MOST = 1e10
"""Greatest magnitude of a state or of its rate, in SI units: MuJoCo's own limit (mjMAXVAL)."""


class Fleet(NamedTuple):
    """States of N vehicles between control steps.

    Attributes:
        y: States of motion, (N, 13 + internal states): pose (7,), velocity (6,), internal states of effects.
        lags: Lag states of the n thrusters, (N, n).
        commands: Commands of the last K control steps, (N, K, n); the last one starts now.
        time: Time of each vehicle, (N,) [s].
    """

    y: Array
    lags: Array
    commands: Array
    time: Array


class Pace(NamedTuple):
    """Time steps of a simulation.

    Attributes:
        period: Control step [s].
        steps: Integration steps per control step.
        gravity: Gravity [m/s^2].
    """

    period: float
    steps: int
    gravity: float


def steps_of(period: float, step: float) -> int:
    """Return the number of integration steps of at most `step` [s] in a control step of `period` [s]."""
    return math.ceil(period / step - 1e-6)


def remembered(table: Array, period: float) -> int:
    """Return the number of past control steps whose commands must be stored for thruster delays.

    Args:
        table: Thruster table, (n, columns), for n thrusters.
        period: Control step [s].
    """
    longest = float(table[:, DELAY].max(initial=0.0))
    return 2 + math.ceil(longest / period)


def require_alike(name: str, flat: Array, first: Array) -> None:
    """Check that a vehicle can be simulated together with the first vehicle of a plant.

    Args:
        name: Name of the vehicle in the message.
        flat: Program of the vehicle.
        first: Program of the first vehicle.

    Raises:
        DataError: The numbers of thrusters or internal states differ.
    """
    if flat[THRUSTER_COUNT] != first[THRUSTER_COUNT] or flat[STATE_COUNT] != first[STATE_COUNT]:
        raise DataError(
            f"{name}: has other thrusters or internal states than the first vehicle; give one that differs "
            "only in its numbers"
        )


@kernel
def begin(
    k: int, motion: Motion, table: Array, rotors: Array, fleet: Fleet, pace: Pace, readings: Readings
) -> None:
    """Start the internal states of vehicle `k` at their steady values, and write its readings.

    Args:
        k: Index of the vehicle.
        motion: Program and hull of the vehicle, and buffers for its motion.
        table: Thruster table, (n, columns), for n thrusters.
        rotors: Buffer of lag states, (3, n).
        fleet: States of the vehicles; the internal states of row `k` are written.
        pace: Time steps; only the gravity is used.
        readings: Row `k` is written.
    """
    copy_kernel(fleet.y[k], motion.y)
    copy_kernel(fleet.lags[k], rotors[2])
    motion.s[TIME] = fleet.time[k]
    settle(motion)
    copy_kernel(motion.y, fleet.y[k])
    _read(k, motion, table, rotors[2], pace.gravity, readings)


@kernel
def fly(
    k: int,
    motion: Motion,
    thrusters: Thrusters,
    clock: Array,
    fleet: Fleet,
    pace: Pace,
    readings: Readings,
) -> None:
    """Simulate vehicle `k` for one control step.

    Args:
        k: Index of the vehicle.
        motion: Program and hull of the vehicle, and buffers for its motion.
        thrusters: Thruster table of the vehicle, and buffers for its thrusters.
        clock: Buffer for the times of the last K commands, (K,).
        fleet: States of the vehicles; row `k` is written.
        pace: Time steps.
        readings: Row `k` is written; if the state or its rate exceeds `MOST`, the vehicle is marked as
            diverged and its row stays.
    """
    now, last = fleet.time[k], clock.size - 1
    for i in range(clock.size):
        clock[i] = now + (i - float(last)) * pace.period
    course = Course(fleet.commands[k], clock, pace.steps, 0.0)
    copy_kernel(fleet.y[k], motion.y)
    motion.s[TIME] = now
    resume(thrusters, course, last, False)
    copy_kernel(fleet.lags[k], thrusters.rotors[2])
    heed(course.commands[last], motion.s)
    advance(motion, thrusters, course, now, pace.period / pace.steps, None)
    copy_kernel(motion.y, fleet.y[k])
    copy_kernel(thrusters.rotors[2], fleet.lags[k])
    fleet.time[k] = now + pace.period
    _read(k, motion, thrusters.table, thrusters.rotors[2], pace.gravity, readings)


@kernel
def _read(k: int, motion: Motion, table: Array, rotors: Array, gravity: float, readings: Readings) -> None:
    """Write the readings of vehicle `k`; if it diverged, mark it and keep its last readings."""
    y, s, work = motion.y, motion.s, motion.work
    rates_kernel(motion.flat, motion.facets, y, s, rotors, work[3, :6], work[0])
    for i in range(y.size):
        if not (abs(y[i]) <= MOST and abs(work[0, i]) <= MOST):  # true for NaN
            readings.diverged[k] = True
            return
    upright(y, readings.pose[k])
    copy_kernel(y[7:BODY], readings.velocity[k])
    down = s[ROTATION + 6 : ROTATION + 9]
    _write_specific_force(gravity, down, readings.velocity[k], work[0, 7:10], readings.specific_force[k])
    for i in range(rotors.size):
        readings.thrust[k, i] = thrust_of(table[i], rotors[i], s)


@kernel
def _write_specific_force(gravity: float, down: Array, nu: Array, v_dot: Array, out: Array) -> None:
    """Write the specific force v_dot + omega x v - g R^T e_z at CO, FRD, into `out` (3,) [m/s^2].

    Args:
        gravity: g [m/s^2].
        down: R^T e_z, the world's down direction in body axes (3,).
        nu: Velocity v, omega (6,) [m/s, rad/s].
        v_dot: Time derivative of v in body axes [m/s^2].
        out: Specific force.
    """
    u, v, w, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    out[0] = v_dot[0] + q * w - r * v - gravity * down[0]
    out[1] = v_dot[1] + r * u - p * w - gravity * down[1]
    out[2] = v_dot[2] + p * v - q * u - gravity * down[2]
