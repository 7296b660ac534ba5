"""Forward simulation: the motion of a vehicle under commands, by the classical Runge-Kutta method.

The state is position, unit quaternion, nu and the effects' internal states.  The thrusters' lags depend on
the commands alone and are advanced exactly.  A step ends wherever a command takes effect, so that delays of
any length keep the order.
"""

from __future__ import annotations

import math

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from hydro.core.columns import POSE, VELOCITY, VOLTAGE, Array, checked_commands
from hydro.core.compiled import copy_kernel, jit
from hydro.core.effects import Program, assemble, sensor, velocity_log
from hydro.core.effects.layout import TIME
from hydro.core.errors import DataError
from hydro.core.recording.segments import require_samples, resumes, sample_time, segments
from hydro.core.recording.supply import recorded_commands
from hydro.core.simulation.dynamics import BODY, NO_HULL, afloat, settle
from hydro.core.simulation.integrate import Course, at_rest, march, resume
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import body_states, euler_from_quaternion

INTEGRATION_RATE = 500.0
"""Minimum rate of integration steps [Hz]."""


def simulate(vehicle: Vehicle, commands: pl.DataFrame, *, sea: int | None = None) -> pl.DataFrame:
    """Return the simulated motion of a vehicle under recorded or designed commands.

    Args:
        vehicle: The vehicle with all its effects; effects of its sensors act on the returned motion.
        commands: Columns `session`, `t` and `cmd_1 ... cmd_n`, and `voltage` [V] if known.  The command of a
            row is held until the next row.  With all columns of pose and velocity (a raw table), the first
            row of every session, and the first after a gap, gives the initial state; else every session
            starts at rest at the origin.
        sea: Seed of the waves of the file, drawn again for every session; by default there are no waves, as
            in every prediction.

    Returns:
        Raw table of the motion that noise-free sensors would log, row for row.

    Raises:
        DataError: Columns are missing, a gap in time has no state after it, or the motion diverges.
    """
    names = checked_commands(commands.columns, len(vehicle.thruster), vehicle.name)
    missing = [name for name in ("session", "t") if name not in commands.columns]
    if missing:
        raise DataError(
            f"commands: column {missing[0]} is missing; commands need session, t, {', '.join(names)}"
        )
    known = [name for name in (*POSE, *VELOCITY) if name in commands.columns]
    if known and len(known) < len(POSE) + len(VELOCITY):
        raise DataError(
            f"commands: has {', '.join(known)} but not all of pose and velocity; give all of them or none"
        )
    bounds, dt = segments(commands), sample_time(commands)
    require_samples(commands[bounds[:, 0]], known)
    after_gap = resumes(commands, bounds)
    if after_gap.any() and not known:
        at = int(bounds[int(after_gap.argmax()), 0])
        raise DataError(
            f"commands: a gap in t before row {at}, and no pose and velocity to continue from; fill the gap"
        )
    program, log, steps = assemble(vehicle), velocity_log(vehicle), steps_of_row(dt)
    t = commands["t"].to_numpy().astype(np.float64)
    demand = recorded_commands(vehicle, commands)
    given = commands.select(known).to_numpy().astype(np.float64) if known else np.zeros((len(t), 12))
    motion = np.empty((len(t), 12))
    number = np.cumsum(~after_gap)  # session of each segment
    for (begin, end), resumed, session in zip(bounds, after_gap, number, strict=True):
        rows = slice(begin, end)
        if sea is not None:
            program = assemble(vehicle, sea=(sea, int(session)))
        velocity = given[begin : begin + 1, 6:]
        if known:
            velocity = sensor.corrected(log, t[begin : begin + 1], velocity)
        eta, nu = sensor.true_pose(log, given[begin, :6]) if known else given[begin, :6], velocity[0]
        motion[rows] = trajectory(
            program, demand[rows], t[rows], eta=eta, nu=nu, settled=bool(resumed), steps=steps
        )
        motion[rows, :6] = sensor.logged_pose(log, motion[rows, :6])
        motion[rows, 6:] = sensor.measured(log, t[rows], motion[rows, 6:])
    logged = pl.DataFrame(motion, schema=[*POSE, *VELOCITY])
    kept = commands.select(*names, *(name for name in (VOLTAGE,) if name in commands.columns))
    return pl.concat([commands.select("session", "t"), logged, kept], how="horizontal")


def steps_of_row(dt: float, rate: float = INTEGRATION_RATE) -> int:
    """Return the number of integration steps per row.

    Args:
        dt: Time between rows [s].
        rate: Minimum number of steps per second [Hz].
    """
    return max(1, math.ceil(dt * rate * (1.0 - 1e-9)))


def trajectory(
    program: Program,
    commands: ArrayLike,
    t: ArrayLike,
    *,
    eta: ArrayLike = (0.0,) * 6,
    nu: ArrayLike = (0.0,) * 6,
    settled: bool = False,
    steps: int | None = None,
) -> Array:
    """Return the true motion of one segment, without sensor errors.

    Args:
        program: The compiled vehicle.
        commands: Effective commands of n thrusters in N rows, (N, n); row k is held on [t_k, t_k+1).
        t: Times [s], (N,), ascending.
        eta: Initial pose, NED and ZYX Euler angles, (6,) [m, rad].
        nu: Initial velocity of CO over ground, body frame, (6,) [m/s, rad/s].
        settled: Whether thrusters start in the steady state of the first command; by default at rest.
        steps: Integration steps per row; by default at least `INTEGRATION_RATE` a second.

    Returns:
        Pose and velocity (x ... psi, u ... r), (N, 12) [m, rad, m/s, rad/s].

    Raises:
        DataError: The commands do not fit the thrusters or the times, or the motion diverges.
    """
    # writable: numba would compile the kernels once more for a read-only array
    clock, demand = (np.require(given, np.float64, ["C", "W"]) for given in (t, commands))
    if not clock.size or demand.shape != (clock.size, program.thrusters) or not np.isfinite(demand).all():
        raise DataError(
            f"commands: expected {clock.size or 'some'} finite rows of {program.thrusters} thrusters, "
            f"got shape {demand.shape}"
        )
    first = body_states(eta, nu)
    interval = float(clock[-1] - clock[0]) / max(clock.size - 1, 1)
    course = Course(demand, clock, steps_of_row(interval) if steps is None else steps, 0.0)
    out = np.empty((clock.size, BODY))
    reached = _follow(program.flat, first, course, settled, out)
    if reached < clock.size:
        raise DataError(f"the motion diverges by t = {clock[reached]:g} s; check the vehicle's damping")
    return np.hstack([out[:, :3], euler_from_quaternion(out[:, 3:7]), out[:, 7:]])


@jit
def _follow(flat: Array, first: Array, course: Course, settled: bool, out: Array) -> int:
    """Integrate one segment from the state `first` (13,) into `out` (N, 13); return its finite rows."""
    motion, thrusters = afloat(flat, NO_HULL.copy()), at_rest(flat)
    begin = int(np.int64(0))  # a variable: a literal would compile what it calls once more
    copy_kernel(first, motion.y[:BODY])
    motion.s[TIME] = course.t[0]
    settle(motion)
    resume(thrusters, course, begin, settled)
    copy_kernel(thrusters.target, thrusters.rotors[2])
    return march(motion, thrusters, course, begin, out, None, None)
