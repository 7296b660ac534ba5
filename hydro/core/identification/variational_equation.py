"""How a motion answers to its beginning and to changes of its forces: the variational equation along it.

Along a predicted motion x(t) of x' = f(x, p) small deviations obey delta' = J delta + df/dp, J = df/dx.  J
is found once for each step, whatever the number of parameters, and df/dp of an effect costs the effect
alone, not a whole vehicle: a hundred parameters cost a few predictions and not a hundred (Hairer, Norsett
and Wanner 1993, section I.14).

A deviation has position in NED, small rotation about the body's axes, nu, and the internal states of the
effects: 12 + states numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Rows
from hydro.core.compiled import jit
from hydro.core.effects.layout import (
    INVERSE_MASS_MATRIX,
    MOTION,
    POSITION,
    RELATIVE_VELOCITY,
    ROTATION,
    VELOCITY,
)
from hydro.core.effects.program import HEADER, STATE_COUNT, relative_to_water, thrusters_of, wrench
from hydro.core.simulation.dynamics import accelerate, observe, propel
from hydro.core.simulation.integrate import BODY, NO_HULL, rates_kernel, resume, step, turn
from hydro.core.vehicle.thrusters import INFLOW

DEVIATION = 12
"""Numbers of a deviation of the body itself."""
LITTLE = 1e-3  # of the state, for J [m, rad, m/s, rad/s]
FORCES, THRUST, WHOLE = 0, 1, 2
"""What a parameter changes: wrenches of effects, thrusts of the same lag states, or any of a program."""


@jit
def vary(
    flat: Array,
    kinds: Rows,
    programs: Array,
    where: Rows,
    shares: Array,
    commands: Array,
    t: Array,
    bounds: Rows,
    resumed: NDArray[np.bool_],
    starts: Rows,
    substeps: int,
    first: Array,
    rotor: Array,
    memory: Array,
    ahead: Array,
    states: Array,
    out: Array,
) -> None:
    """Predict shots, and how they answer to their beginnings and to P parameters.

    Args:
        flat: The vehicle's program.
        kinds: Of each parameter, (P,).
        programs: Programs in a row.  Of FORCES, one with the effects that the changed vehicle has and this
            one has not, and one with those that it has not any more; of the others, the changed vehicle's.
        where: Beginning and end of both in `programs`, (P, 4).
        shares: Units of each parameter by which it is changed, (P,).
        commands: Of the recording, (N, n).
        t: Its times [s], (N,).
        bounds: Rows of each shot's segment, (S, 2).
        resumed: Whether that follows a gap, (S,).
        starts: First row of each shot, (S,).
        substeps: Steps of a row.
        first: State of the body at the beginning of each, (S, 13).
        rotor: Lag states, (S, n).
        memory: Internal states, (S, states).
        ahead: What a unit of each parameter changes them by, (S, states, P).
        states: Written: predicted state of the body, (S, K, 13).
        out: Written: deviations for a unit of the beginning and of each parameter, (S, K, 12, 12 + P).
    """
    table, own = thrusters_of(flat), int(flat[STATE_COUNT])
    count, size, total = table.shape[0], DEVIATION + own, out.shape[3]
    y, s, work = np.zeros(BODY + own), np.zeros(MOTION), np.zeros((4, BODY + own))
    target, upcoming, decay = np.zeros(count), np.zeros(count, np.int64), np.ones(count)
    rotors = np.zeros((3, count))
    slope, push = np.zeros((size, size)), np.zeros((size - 6, total - DEVIATION))
    delta, middle = np.zeros((size, total)), np.zeros((size, total))
    for m in range(starts.size):
        begin, end = bounds[m, 0], bounds[m, 1]
        clock, demand, at = t[begin:end], commands[begin:end], starts[m] - begin
        y[:BODY], y[BODY:] = first[m], memory[m]
        delta[:] = 0.0
        for i in range(DEVIATION):
            delta[i, i] = 1.0
        delta[DEVIATION:, DEVIATION:] = ahead[m]
        rotors[2] = rotor[m]
        due = resume(table, demand, clock, at, resumed[m], target, upcoming)
        for k in range(states.shape[1]):
            states[m, k] = y[:BODY]
            out[m, k] = delta[:DEVIATION]
            if k + 1 == states.shape[1]:
                break
            h = (clock[at + k + 1] - clock[at + k]) / substeps
            for j in range(substeps):
                now, stop = clock[at + k] + j * h, clock[at + k] + (j + 1) * h
                close = 1e-9 * (stop - now)
                while now < stop - close:
                    until, due = turn(
                        table, demand, clock, now, stop, close, due, target, upcoming, decay, rotors
                    )
                    length = until - now
                    _slopes(flat, kinds, programs, where, shares, length, y, s, rotors, work, slope, push)
                    _propagate(slope, push, length, delta, middle)
                    step(flat, NO_HULL, length, y, s, rotors, work)
                    now = until


@jit
def _slopes(
    flat: Array,
    kinds: Rows,
    programs: Array,
    where: Rows,
    shares: Array,
    h: float,
    y: Array,
    s: Array,
    rotors: Array,
    work: Array,
    slope: Array,
    push: Array,
) -> None:
    """J = df/dx (`slope`), and df/dp (`push`) without its rows of the pose, in the middle of a step."""
    middle, rates, changed = work[0], work[1], work[2]
    tau, thrust, x, dx = np.zeros(6), np.zeros(6), y[BODY:], rates[BODY:]
    rates_kernel(flat, NO_HULL, y, s, rotors[0], tau, rates)
    for i in range(y.size):
        middle[i] = y[i] + 0.5 * h * rates[i]
    observe(flat, middle[:3], middle[3:7], middle[7:BODY], s)
    propel(flat, s, rotors[1], thrust)
    tau[:] = thrust
    x = middle[BODY:]
    accelerate(flat, s, x, dx, tau, rates[7:BODY])
    _pose_slopes(s, slope)
    table, inflow = thrusters_of(flat), False
    for i in range(table.shape[0]):
        inflow = inflow or table[i, INFLOW] != 0.0
    for column in range(slope.shape[0]):
        if column < 3:
            s[POSITION + column] += LITTLE
        elif column < 6:
            _turned(middle, column - 3, changed)
            observe(flat, middle[:3], changed[:4], middle[7:BODY], s)
        elif column < DEVIATION:
            s[VELOCITY + column - 6] += LITTLE
            s[RELATIVE_VELOCITY + column - 6] += LITTLE
        else:
            x[column - DEVIATION] += LITTLE
        tau[:] = thrust
        if inflow:
            tau[:] = 0.0
            propel(flat, s, rotors[1], tau)
        accelerate(flat, s, x, changed[BODY:], tau, changed[7:BODY])
        for i in range(slope.shape[0] - 6):
            slope[6 + i, column] = (changed[7 + i] - rates[7 + i]) / LITTLE
        if column < 3:
            s[POSITION + column] -= LITTLE
        elif column == 5:
            observe(flat, middle[:3], middle[3:7], middle[7:BODY], s)
        elif column < DEVIATION and column > 5:
            s[VELOCITY + column - 6] -= LITTLE
            s[RELATIVE_VELOCITY + column - 6] -= LITTLE
        elif column >= DEVIATION:
            x[column - DEVIATION] -= LITTLE
    for j in range(kinds.size):
        changed[:] = 0.0
        one = programs[where[j, 0] : where[j, 1]]
        tau[:] = 0.0
        if kinds[j] == WHOLE:
            relative_to_water(one, s)
            propel(one, s, rotors[1], tau)
            accelerate(one, s, x, changed[BODY:], tau, changed[7:BODY])
            relative_to_water(flat, s)
            for i in range(push.shape[0]):
                push[i, j] = (changed[7 + i] - rates[7 + i]) / shares[j]
            continue
        if kinds[j] == THRUST:
            propel(one, s, rotors[1], tau)
            for i in range(6):
                tau[i] -= thrust[i]
        else:
            wrench(programs[where[j, 2] : where[j, 3]], s, x, changed, tau)
            for i in range(6):
                tau[i] = -tau[i]
            wrench(one, s, x, changed, tau)
        for i in range(push.shape[0]):
            push[i, j] = 0.0
        for i in range(6):
            row = HEADER + INVERSE_MASS_MATRIX + 6 * i
            for k in range(6):
                push[i, j] += flat[row + k] * tau[k] / shares[j]


@jit
def _pose_slopes(s: Array, slope: Array) -> None:
    """Rows of the pose: p' = R v turns with the body, and of a small rotation."""
    u, v, w = s[VELOCITY], s[VELOCITY + 1], s[VELOCITY + 2]
    p, q, r = s[VELOCITY + 3], s[VELOCITY + 4], s[VELOCITY + 5]
    for i in range(6):
        slope[i] = 0.0
    for i in range(3):
        a, b, c = s[ROTATION + 3 * i], s[ROTATION + 3 * i + 1], s[ROTATION + 3 * i + 2]
        slope[i, 3], slope[i, 4], slope[i, 5] = c * v - b * w, a * w - c * u, b * u - a * v
        slope[i, 6], slope[i, 7], slope[i, 8] = a, b, c
        slope[3 + i, 9 + i] = 1.0
    slope[3, 4], slope[3, 5] = r, -q
    slope[4, 3], slope[4, 5] = -r, p
    slope[5, 3], slope[5, 4] = q, -p


@jit
def _turned(y: Array, axis: int, quaternion: Array) -> None:
    """The quaternion of a state turned a little about an axis of the body; of any length."""
    w, half = 1.0, 0.5 * LITTLE
    a = half if axis == 0 else 0.0
    b = half if axis == 1 else 0.0
    c = half if axis == 2 else 0.0
    quaternion[0] = y[3] * w - y[4] * a - y[5] * b - y[6] * c
    quaternion[1] = y[3] * a + y[4] * w + y[5] * c - y[6] * b
    quaternion[2] = y[3] * b - y[4] * c + y[5] * w + y[6] * a
    quaternion[3] = y[3] * c + y[4] * b - y[5] * a + y[6] * w


def _added(slope: Array, push: Array, h: float, delta: Array, out: Array) -> None:
    """Add h (J delta + df/dp)."""
    size, total = delta.shape
    for i in range(size):
        for j in range(size):
            amount = h * slope[i, j]
            if amount == 0.0:
                continue
            for k in range(total):
                out[i, k] += amount * delta[j, k]
    for i in range(6, size):
        for k in range(DEVIATION, total):
            out[i, k] += h * push[i - 6, k - DEVIATION]


_add = jit(_added, reorder_sums=True)


@jit
def _propagate(slope: Array, push: Array, h: float, delta: Array, middle: Array) -> None:
    """Deviations after a step h, by the midpoint rule; `middle` is room for those in the middle of it."""
    middle[:] = delta
    _add(slope, push, 0.5 * h, delta, middle)
    _add(slope, push, h, middle, delta)
