"""Integration of a vehicle's motion under its commands by the classical Runge-Kutta method of order 4.

One loop serves the forward simulation, the reference simulator, fleets of vehicles, and the shots of a fit.
The uses differ in the initial state, in whether a pilot computes the commands, and in whether small
deviations are integrated too (`simulation.variational_equation`).

The thrusters' lags depend on the commands alone.  They are advanced exactly to the start, middle and end of a
step.  A step ends where a command takes effect, so that delays of any length keep the order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.compiled import copy_kernel, jit, kernel, separate, within
from hydro.core.effects.layout import TIME
from hydro.core.effects.program import heed, thrusters_of
from hydro.core.simulation.dynamics import Motion, observe_state, rates_kernel
from hydro.core.simulation.pilot import Pilot, steer
from hydro.core.simulation.variational_equation import (
    COUNT,
    DEVIATION,
    LEFT,
    Deviations,
    begin_step,
    end_step,
    keep_middle,
)
from hydro.core.vehicle.thrusters import DELAY, lag_decay, settled_state


class Thrusters(NamedTuple):
    """State of a vehicle's n thrusters, changed by the kernels in place.

    A lag state is a thrust [N] or a normalised rotor speed, see `vehicle.thrusters`.

    Attributes:
        table: Thruster table (n, columns).
        target: Lag states to which the present commands lead, (n,).
        upcoming: Next row of the commands that each thruster will follow, (n,).
        decay: Factor of the distance to `target` over half a step, (n,); 0 without lag.
        rotors: Lag states at the start, middle and end of a step, (3, n).
        due: Time of the next command [s], and the length of step to which `decay` applies [s], (2,).
    """

    table: Array
    target: Array
    upcoming: NDArray[np.int64]
    decay: Array
    rotors: Array
    due: Array


class Course(NamedTuple):
    """Commands of n thrusters in N rows of a segment, and the time steps of the integration.

    Attributes:
        commands: Effective commands, (N, n); row k acts on [t_k, t_k+1), later by each thruster's delay.
        t: Times of the rows (N,) [s].
        steps: Integration steps per row.
        length: Length of a step [s]; 0 divides each row into equal steps.
    """

    commands: Array
    t: Array
    steps: int
    length: float


_thrusters_of = jit(thrusters_of)


@jit
def at_rest(flat: Array) -> Thrusters:
    """Return the state of the thrusters of a vehicle at rest, with lag states and commands of 0.

    Args:
        flat: Compiled vehicle (`effects.program`).
    """
    table = _thrusters_of(flat)
    n = table.shape[0]
    upcoming = np.zeros(n, np.int64)
    return Thrusters(table, np.zeros(n), upcoming, np.ones(n), np.zeros((3, n)), np.zeros(2))


@kernel
def resume(thrusters: Thrusters, course: Course, at: int, settled: bool) -> None:
    """Set the thrusters' state for an integration that starts at row `at` of a segment.

    Commands of earlier rows that are still delayed stay pending.

    Args:
        thrusters: State of the thrusters, changed.
        course: Commands of the whole segment.
        at: First row to integrate.
        settled: Whether the rotors were in the steady state of the first command when the segment started, as
            after a gap; otherwise at rest.
    """
    t = course.t
    for i in range(thrusters.target.size):
        row = thrusters.table[i]
        thrusters.target[i] = settled_state(row, course.commands[0, i]) if settled else 0.0
        felt = at
        while felt > 0 and t[felt] + row[DELAY] > t[at]:
            felt -= 1
        thrusters.upcoming[i] = felt
    thrusters.due[0], thrusters.due[1] = t[at], 0.0


@kernel
def obey(thrusters: Thrusters, course: Course, now: float) -> float:
    """Apply the commands that take effect at `now` [s] or before; later commands are not read.

    Args:
        thrusters: State of the thrusters, changed.
        course: Commands of the segment.
        now: Time [s].

    Returns:
        Time of the next change [s], infinite after the last command.
    """
    table, target, upcoming = thrusters.table, thrusters.target, thrusters.upcoming
    commands, t, change = course.commands, course.t, np.inf
    for i in range(target.size):
        while upcoming[i] < t.size and t[upcoming[i]] + table[i, DELAY] <= now:
            target[i] = settled_state(table[i], commands[upcoming[i], i])
            upcoming[i] += 1
        if upcoming[i] < t.size:
            change = min(change, t[upcoming[i]] + table[i, DELAY])
    return change


@kernel
def spin(target: Array, decay: Array, rotors: Array) -> None:
    """Compute the lag states at the start, middle and end of a step from the end of the step before.

    Args:
        target: Lag states of n thrusters to which the present commands lead, (n,).
        decay: Factor of the distance to `target` over half a step, (n,); 0 without lag.
        rotors: Lag states, (3, n); the last row is read, all are written.
    """
    for i in range(target.size):
        away = rotors[2, i] - target[i] if decay[i] > 0.0 else 0.0
        rotors[0, i] = target[i] + away
        rotors[1, i] = target[i] + away * decay[i]
        rotors[2, i] = target[i] + away * decay[i] * decay[i]


@kernel
def turn(thrusters: Thrusters, course: Course, now: float, end: float, close: float) -> float:
    """Advance the rotors from `now` to `end`, or only to the time at which the next command takes effect.

    Args:
        thrusters: State of the thrusters, changed.
        course: Commands of the segment.
        now: Start [s].
        end: End [s].
        close: Difference up to which two times count as equal [s].

    Returns:
        Time to which the rotors were advanced [s].
    """
    due, target, decay = thrusters.due, thrusters.target, thrusters.decay
    if due[0] <= now + close:
        due[0] = obey(thrusters, course, now + close)
    until = due[0] if due[0] < end - close else end
    length = until - now
    if abs(length - due[1]) > 1e-9 * length:
        due[1] = length
        for i in range(target.size):
            decay[i] = lag_decay(thrusters.table[i], 0.5 * length)
    spin(target, decay, thrusters.rotors)
    return until


@within
def step(
    flat: Array,
    facets: Array,
    y: Array,
    s: Array,
    work: Array,
    rotors: Array,
    h: float,
    deviations: Deviations | None,
) -> None:
    """Advance the integrated state `y` by one Runge-Kutta step; the quaternion is normalised.

    The arguments are the arrays of `Motion`, since unpacking a tuple costs up to a tenth of the time.

    Args:
        flat: Compiled vehicle (`effects.program`).
        facets: Hull of the panel method, F facets, (8, F).
        y: Integrated state, changed.
        s: State of motion; the step starts at its time, which is advanced.
        work: Workspace of `Motion`.
        rotors: Lag states of n thrusters at the start, middle and end of the step, (3, n).
        h: Step [s].
        deviations: Small deviations of the state to integrate too; or None.
    """
    rates, total, trial, tau = work[0], work[1], work[2], work[3, :6]
    now = s[TIME]
    total[:] = 0.0
    copy_kernel(y, trial)
    for stage in range(4):
        rates_kernel(flat, facets, trial, s, rotors[(stage + 1) // 2], tau, rates)
        if deviations is not None and stage < 2 and deviations.carried:
            keep_middle(deviations, s, work, rotors[stage], h, stage)
        weight = 1.0 if stage == 0 or stage == 3 else 2.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(y.size):
            total[i] += weight * rates[i]
            trial[i] = y[i] + ahead * rates[i]
        s[TIME] = now + ahead
    s[TIME] = now + h
    for i in range(y.size):
        y[i] += h / 6.0 * total[i]
    norm = math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5] + y[6] * y[6])
    for i in range(3, 7):
        y[i] /= norm


@within
def advance(
    motion: Motion,
    thrusters: Thrusters,
    course: Course,
    begin: float,
    length: float,
    deviations: Deviations | None,
) -> None:
    """Advance the state of the vehicle over one row of commands, in several integration steps.

    A step is split where a command takes effect within it.  Times closer than a billionth of a step count as
    equal.

    Args:
        motion: State of the vehicle, changed.
        thrusters: State of the thrusters, changed.
        course: Commands and number of steps.
        begin: Time of the row [s].
        length: Length of each step [s].
        deviations: Small deviations of the state to integrate too; or None.
    """
    flat, facets, y, s, work = motion
    rotors = thrusters.rotors
    for j in range(course.steps):
        now, end = begin + j * length, begin + (j + 1) * length
        if deviations is not None and deviations.carried:
            begin_step(deviations, now, length)
        close = 1e-9 * (end - now)
        while now < end - close:
            s[TIME] = now
            until = turn(thrusters, course, now, end, close)
            step(flat, facets, y, s, work, rotors, until - now, deviations)
            now = until
        if deviations is not None and deviations.carried:
            end_step(flat, deviations)


@separate
def march(
    motion: Motion,
    thrusters: Thrusters,
    course: Course,
    at: int,
    out: Array,
    pilot: Pilot | None,
    deviations: Deviations | None,
) -> int:
    """Integrate the motion of a vehicle from row `at` of its commands, and write the states to `out`.

    Args:
        motion: The vehicle in its initial state, changed.
        thrusters: State of the thrusters, prepared by `resume`.
        course: Commands of the whole segment.
        at: First row.
        out: Output: state of the body at each of K rows, (K, 13); NaN after the first row that is not finite.
        pilot: Pilot that computes the commands row by row; None if the commands are known.
        deviations: Small deviations of the state to integrate and record too; or None.

    Returns:
        Number of rows that stayed finite.
    """
    y, t, last, written = motion.y, course.t, out.shape[0] - 1, 0
    for k in range(last + 1):
        copy_kernel(y, out[k])
        if deviations is not None and deviations.carried and deviations.interval[COUNT] == 0.0:
            for i in range(DEVIATION):
                copy_kernel(deviations.delta[i], deviations.out[written, i])
            written += 1
        total = 0.0  # not finite if any value is not
        for i in range(y.size):
            total += y[i]
        if not math.isfinite(total):
            out[k + 1 :] = np.nan
            if deviations is not None and deviations.carried:
                deviations.out[max(written - 1, 0) :] = np.nan
            return k
        if pilot is not None:
            motion.s[TIME] = t[at + k]
            observe_state(motion.flat, y, motion.s)
            steer(pilot, at + k, motion.s, motion.work[0, :6], course.commands[at + k])
        if k < last:
            heed(course.commands[at + k], motion.s)
            now = t[at + k]
            length = course.length if course.length > 0.0 else (t[at + k + 1] - now) / course.steps
            if deviations is not None and deviations.carried:
                deviations.interval[LEFT] = course.steps if course.steps > 1 else last - k
            advance(motion, thrusters, course, now, length, deviations)
    return int(last + 1)
