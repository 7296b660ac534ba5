"""One vehicle's control step by the classical Runge-Kutta method, whoever asks for it.

A processor flies the vehicles of a plant one after another (`sim.teacher_plant`), a GPU gives each a thread
(`sim.gpu`): both call `fly`, which makes no arrays.
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


class Fleet(NamedTuple):
    """Where N vehicles are between control steps.

    Attributes:
        y: States of their motion (N, 13 + internal states).
        lags: Lag states of their thrusters (N, n).
        commands: Of the last K control steps (N, K, n), the last one of which begins now.
        time: Their clocks (N,) [s].
    """

    y: Array
    lags: Array
    commands: Array
    time: Array


class Pace(NamedTuple):
    """How time passes.

    Attributes:
        period: Control step [s].
        steps: Integration steps of it.
        gravity: [m/s^2].
    """

    period: float
    steps: int
    gravity: float


def steps_of(period: float, step: float) -> int:
    """How many integration steps of at most `step` [s] make up a control step [s]."""
    return math.ceil(period / step - 1e-6)


def remembered(table: Array, period: float) -> int:
    """Control steps whose commands a thruster table (n, columns) may still have to feel."""
    longest = float(table[:, DELAY].max(initial=0.0))
    return 2 + math.ceil(longest / period)


def require_alike(name: str, flat: Array, first: Array) -> None:
    """Refuse a program that cannot fly beside the first one.

    Raises:
        DataError: It has other thrusters or memories.
    """
    if flat[THRUSTER_COUNT] != first[THRUSTER_COUNT] or flat[STATE_COUNT] != first[STATE_COUNT]:
        raise DataError(
            f"{name}: flies beside vehicles with other thrusters or memories; give one that differs in its "
            "numbers alone"
        )


@kernel
def begin(
    k: int, motion: Motion, table: Array, rotors: Array, fleet: Fleet, pace: Pace, readings: Readings
) -> None:
    """Start the internal states of vehicle `k` as if it had always moved as it does, and read it.

    The arguments are those of `fly`; thruster table (n, columns) and room for lag states (3, n) stand alone.
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
    """Fly vehicle `k` for one control step.

    Args:
        k: Its number.
        motion: Its program and hull, and room for its motion.
        thrusters: Its thruster table, and room for what they are at.
        clock: Room for the times of the commands (K,).
        fleet: Where the vehicles are; its rows are written.
        pace: How time passes.
        readings: Its rows are written; where it is not finite it is marked as diverged and they stay.
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
    """Write the readings of vehicle k, or mark it as diverged and keep what they were."""
    y, s, work = motion.y, motion.s, motion.work
    rates_kernel(motion.flat, motion.facets, y, s, rotors, work[3, :6], work[0])
    total = 0.0
    for i in range(y.size):
        total += y[i] + work[0, i]
    if not math.isfinite(total):
        readings.diverged[k] = True
        return
    upright(y, readings.pose[k])
    copy_kernel(y[7:BODY], readings.velocity[k])
    down = s[ROTATION + 6 : ROTATION + 9]
    _feel(gravity, down, readings.velocity[k], work[0, 7:10], readings.specific_force[k])
    for i in range(rotors.size):
        readings.thrust[k, i] = thrust_of(table[i], rotors[i], s)


@kernel
def _feel(gravity: float, down: Array, nu: Array, v_dot: Array, out: Array) -> None:
    """Specific force v_dot + omega x v - R^T g at CO, FRD; `down` (3,) is the world's, in the body."""
    u, v, w, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    out[0] = v_dot[0] + q * w - r * v - gravity * down[0]
    out[1] = v_dot[1] + r * u - p * w - gravity * down[1]
    out[2] = v_dot[2] + p * v - q * u - gravity * down[2]
