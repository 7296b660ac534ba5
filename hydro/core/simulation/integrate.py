"""One Runge-Kutta step of a vehicle in water, and its thrusters through the step.

The state y is position (3), unit quaternion (4), nu (6) and the internal states of the effects.  The
thrusters' lags depend on the commands alone and are advanced exactly, to the beginning, middle and end of a
step; a step should end where a command takes effect, so that delays of any length keep the order.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.effects.layout import RELATIVE_VELOCITY, ROTATION
from hydro.core.simulation.dynamics import accelerate, observe, propel
from hydro.core.vehicle.panels import panel_wrench_kernel
from hydro.core.vehicle.thrusters import DELAY, lag_decay, settled_state

BODY = 13
"""Length of the state of the body itself, before the effects' internal states."""
NO_HULL: Array = np.zeros((8, 0))
"""Facets of a vehicle whose file alone says what the water does."""


@jit
def obey(
    table: Array, commands: Array, t: Array, now: float, target: Array, upcoming: NDArray[np.int64]
) -> float:
    """Take up the commands felt at `now`; rows later than `now` are not read.

    Args:
        table: Thruster table (n, columns).
        commands: (N, n); row k acts on [t_k, t_k+1), later by each thruster's delay.
        t: Times of the rows [s].
        now: Time [s].
        target: (n,) written: the lag states that the commands lead to.
        upcoming: (n,) next row that each thruster will feel, advanced.

    Returns:
        Time of the next change [s], infinite after the last.
    """
    change = np.inf
    for i in range(target.size):
        while upcoming[i] < t.size and t[upcoming[i]] + table[i, DELAY] <= now:
            target[i] = settled_state(table[i], commands[upcoming[i], i])
            upcoming[i] += 1
        if upcoming[i] < t.size:
            change = min(change, t[upcoming[i]] + table[i, DELAY])
    return change


@jit
def spin(target: Array, decay: Array, rotors: Array) -> None:
    """Lag states (3, n) at the beginning, middle and end of a step, from those at the end of the last.

    `decay` (n,) is what half a step leaves of the distance to `target`: 0 without lag.
    """
    for i in range(target.size):
        away = rotors[2, i] - target[i] if decay[i] > 0.0 else 0.0
        rotors[0, i] = target[i] + away
        rotors[1, i] = target[i] + away * decay[i]
        rotors[2, i] = target[i] + away * decay[i] * decay[i]


@jit
def step(flat: Array, facets: Array, h: float, y: Array, s: Array, rotors: Array, work: Array) -> None:
    """Advance the state by one step of the classical method of order 4.

    Args:
        flat: The vehicle's program.
        facets: (8, F) hull of the panel method, or `NO_HULL`.
        h: Step [s].
        y: State, advanced; its quaternion is normalised.
        s: State of motion, overwritten.
        rotors: (3, n) lag states at the beginning, middle and end of the step.
        work: (4, y.size) room for three states and a wrench.
    """
    rates, total, trial, tau = work[0], work[1], work[2], work[3, :6]
    total[:] = 0.0
    trial[:] = y
    for stage in range(4):
        rates_kernel(flat, facets, trial, s, rotors[(stage + 1) // 2], tau, rates)
        weight = 1.0 if stage == 0 or stage == 3 else 2.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(y.size):
            total[i] += weight * rates[i]
            trial[i] = y[i] + ahead * rates[i]
    for i in range(y.size):
        y[i] += h / 6.0 * total[i]
    norm = math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5] + y[6] * y[6])
    for i in range(3, 7):
        y[i] /= norm


@jit
def resume(
    table: Array,
    commands: Array,
    t: Array,
    at: int,
    settled: bool,
    target: Array,
    upcoming: NDArray[np.int64],
) -> tuple[float, float]:
    """Take a motion up at row `at` of a segment: late commands from before it are still to be felt.

    Args:
        table: Thruster table (n, columns).
        commands: Of the segment, (N, n).
        t: Its times [s].
        at: Row.
        settled: Whether the rotors had settled on the first command when the segment began, as after a gap.
        target: (n,) written, as in `obey`.
        upcoming: (n,) written, as in `obey`.

    Returns:
        `due`, as `advance` takes it.
    """
    for i in range(target.size):
        target[i] = settled_state(table[i], commands[0, i]) if settled else 0.0
        row = at
        while row > 0 and t[row] + table[i, DELAY] > t[at]:
            row -= 1
        upcoming[i] = row
    return t[at], 0.0


@jit
def turn(
    table: Array,
    commands: Array,
    t: Array,
    now: float,
    end: float,
    close: float,
    due: tuple[float, float],
    target: Array,
    upcoming: NDArray[np.int64],
    decay: Array,
    rotors: Array,
) -> tuple[float, tuple[float, float]]:
    """Turn the rotors on from `now`, to `end` or to where the next command takes effect before it.

    What is not told here is as in `obey`, `spin` and `advance`; times nearer than `close` are one moment.

    Returns:
        Time to which they were turned, and `due` as it is then.
    """
    change, decayed = due
    if change <= now + close:
        change = obey(table, commands, t, now + close, target, upcoming)
    until = change if change < end - close else end
    length = until - now
    if abs(length - decayed) > 1e-9 * length:
        decayed = length
        for i in range(target.size):
            decay[i] = lag_decay(table[i], 0.5 * length)
    spin(target, decay, rotors)
    return until, (change, decayed)


@jit
def advance(
    flat: Array,
    facets: Array,
    table: Array,
    commands: Array,
    t: Array,
    now: float,
    end: float,
    due: tuple[float, float],
    target: Array,
    upcoming: NDArray[np.int64],
    decay: Array,
    rotors: Array,
    y: Array,
    s: Array,
    work: Array,
) -> tuple[float, float]:
    """Advance the state from `now` to `end`, in two steps or more where a command takes effect between.

    What is not told here is as in `step`, `obey` and `spin`; times nearer than a billionth of the distance
    from `now` to `end` are one moment.  `due` is when the next command takes effect, and the step
    that `decay` is of [s].

    Returns:
        `due` as it is at the end.
    """
    close = 1e-9 * (end - now)
    while now < end - close:
        until, due = turn(table, commands, t, now, end, close, due, target, upcoming, decay, rotors)
        step(flat, facets, until - now, y, s, rotors, work)
        now = until
    return due


@jit
def rates_kernel(
    flat: Array, facets: Array, y: Array, s: Array, rotors: Array, tau: Array, rates: Array
) -> None:
    """Rates of the state: kinematics by quaternion (Fossen 2011, section 2.2.2), and the balance.

    Args:
        flat: The vehicle's program.
        facets: (8, F), or `NO_HULL`.
        y: State.
        s: State of motion, overwritten.
        rotors: (n,) lag states.
        tau: (6,) overwritten.
        rates: (y.size,) written; nu_dot of CO stands in 7 to 12.
    """
    observe(flat, y[0:3], y[3:7], y[7:BODY], s)
    u, v, w, p, q, r = y[7], y[8], y[9], y[10], y[11], y[12]
    for i in range(3):
        row = ROTATION + 3 * i
        rates[i] = s[row] * u + s[row + 1] * v + s[row + 2] * w
    rates[3] = -0.5 * (y[4] * p + y[5] * q + y[6] * r)
    rates[4] = 0.5 * (y[3] * p - y[6] * q + y[5] * r)
    rates[5] = 0.5 * (y[6] * p + y[3] * q - y[4] * r)
    rates[6] = 0.5 * (-y[5] * p + y[4] * q + y[3] * r)
    tau[:] = 0.0
    propel(flat, s, rotors, tau)
    panel_wrench_kernel(s[RELATIVE_VELOCITY : RELATIVE_VELOCITY + 6], facets, tau)
    accelerate(flat, s, y[BODY:], rates[BODY:], tau, rates[7:BODY])
