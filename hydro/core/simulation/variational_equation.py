"""How a motion answers to its beginning and to changes of its forces: the variational equation along it.

Along a predicted motion x(t) of x' = f(x, p) small deviations obey delta' = J delta + df/dp, J = df/dx.  J
is found once for each step, whatever the number of parameters, and df/dp of an effect costs the effect
alone, not a whole vehicle: a hundred parameters cost a few predictions and not a hundred (Hairer, Norsett
and Wanner 1993, section I.14).

A deviation has position in NED, small rotation about the body's axes, nu, and the internal states of the
effects: 12 + states numbers.  `simulation.integrate` carries deviations along with a motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.compiled import copy_kernel, jit, kernel
from hydro.core.effects.layout import (
    INVERSE_MASS_MATRIX,
    POSITION,
    RELATIVE_VELOCITY,
    ROTATION,
    TIME,
    VELOCITY,
)
from hydro.core.effects.program import HEADER, THRUSTER_COUNT, THRUSTER_TABLE, relative_to_water, wrench
from hydro.core.simulation.dynamics import (
    BODY,
    Motion,
    accelerate,
    observe,
    observe_state,
    propel,
    rates_kernel,
)
from hydro.core.vehicle.frames import quaternion_product_kernel
from hydro.core.vehicle.thrusters import COLUMNS, INFLOW

Rows = NDArray[np.int64]

DEVIATION = 12
"""Numbers of a deviation of the body itself."""
LITTLE = 1e-3  # of the state, for J [m, rad, m/s, rad/s]
FORCES, THRUST, WHOLE = 0, 1, 2
"""What a parameter changes: wrenches of effects, thrusts of the same lag states, or any of a program."""


class Changes(NamedTuple):
    """How P parameters change a vehicle.

    Attributes:
        kinds: Of each parameter, (P,): FORCES, THRUST or WHOLE.
        programs: Programs in a row.  Of FORCES, one with the effects that the changed vehicle has and this
            one has not, and one with those that it has not any more; of the others, the changed vehicle's.
        where: Beginning and end of both in `programs`, (P, 4).
        shares: Units of each parameter by which it is changed, (P,).
    """

    kinds: Rows
    programs: Array
    where: Rows
    shares: Array


class Deviations(NamedTuple):
    """Small deviations on their way: for a unit of the beginning, and of each of P parameters.

    Attributes:
        changes: The parameters.
        delta: (12 + states, 12 + P).
        middle: Room for those in the middle of a step, likewise.
        slope: Room for J, (12 + states, 12 + states).
        push: Room for df/dp without its rows of the pose, (6 + states, P).
        out: (K, 12, 12 + P) written, row by row, without internal states.
    """

    changes: Changes
    delta: Array
    middle: Array
    slope: Array
    push: Array
    out: Array


@jit
def deviations_of(changes: Changes, ahead: Array, out: Array) -> Deviations:
    """Deviations at a beginning; `ahead` (states, P) is what a unit of each parameter changes states by."""
    size, total = DEVIATION + ahead.shape[0], out.shape[2]
    delta = np.zeros((size, total))
    for i in range(DEVIATION):
        delta[i, i] = 1.0
    delta[DEVIATION:, DEVIATION:] = ahead
    slope, push = np.zeros((size, size)), np.zeros((size - 6, total - DEVIATION))
    return Deviations(changes, delta, np.zeros((size, total)), slope, push, out)


@kernel
def carry(motion: Motion, rotors: Array, h: float, deviations: Deviations) -> None:
    """Carry deviations through the step h [s] that a motion is about to make, by the midpoint rule.

    `rotors` (3, n) are the lag states at the beginning, middle and end of the step.
    """
    delta, middle, slope, push = deviations.delta, deviations.middle, deviations.slope, deviations.push
    now = motion.s[TIME]
    _look_ahead(motion, rotors, h)
    _pose_slopes(motion.s, slope)
    _balance_slopes(motion, rotors[1], slope)
    _pushes(motion, rotors[1], deviations.changes, push)
    for i in range(delta.shape[0]):
        copy_kernel(delta[i], middle[i])
    _add(slope, push, 0.5 * h, delta, middle)
    _add(slope, push, h, middle, delta)
    motion.s[TIME] = now


@kernel
def _look_ahead(motion: Motion, rotors: Array, h: float) -> None:
    """The state and its rates in the middle of a step, and tau_prop there, into the room of the motion."""
    flat, y, s, work = motion.flat, motion.y, motion.s, motion.work
    middle, rates, tau, thrust = work[0], work[1], work[3, :6], work[3, 6:12]
    rates_kernel(flat, motion.facets, y, s, rotors[0], tau, rates)
    for i in range(y.size):
        middle[i] = y[i] + 0.5 * h * rates[i]
    s[TIME] += 0.5 * h
    observe_state(flat, middle, s)
    thrust[:] = 0.0
    propel(flat, s, rotors[1], thrust)
    copy_kernel(thrust, tau)
    accelerate(flat, s, middle[BODY:], rates[BODY:], tau, rates[7:BODY])


@kernel
def _balance_slopes(motion: Motion, rotors: Array, slope: Array) -> None:
    """Rows of nu and of the internal states: differences of their rates in the middle of a step."""
    flat, s, work = motion.flat, motion.s, motion.work
    middle, rates, changed, tau, thrust = work[0], work[1], work[2], work[3, :6], work[3, 6:12]
    inflow, still = _feels_inflow(flat), not _feels_place(motion)
    for column in range(slope.shape[0]):
        if still and column < 3:
            slope[6:, column] = 0.0
            continue
        _displace(motion, column, LITTLE)
        copy_kernel(thrust, tau)
        if inflow:
            tau[:] = 0.0
            propel(flat, s, rotors, tau)
        accelerate(flat, s, middle[BODY:], changed[BODY:], tau, changed[7:BODY])
        for i in range(slope.shape[0] - 6):
            slope[6 + i, column] = (changed[7 + i] - rates[7 + i]) / LITTLE
        _displace(motion, column, -LITTLE)


@kernel
def _feels_place(motion: Motion) -> bool:
    """Whether any rate in the middle of a step changes with the position; three columns less where none does.

    Each coordinate is displaced by its own amount, so that what they do cannot cancel.
    """
    s, work = motion.s, motion.work
    middle, rates, changed, tau, thrust = work[0], work[1], work[2], work[3, :6], work[3, 6:12]
    x, y, z = s[POSITION], s[POSITION + 1], s[POSITION + 2]
    s[POSITION], s[POSITION + 1], s[POSITION + 2] = x + LITTLE, y + 1.7 * LITTLE, z + 2.9 * LITTLE
    relative_to_water(motion.flat, s)
    copy_kernel(thrust, tau)
    accelerate(motion.flat, s, middle[BODY:], changed[BODY:], tau, changed[7:BODY])
    s[POSITION], s[POSITION + 1], s[POSITION + 2] = x, y, z
    relative_to_water(motion.flat, s)
    feels = False
    for i in range(7, middle.size):
        feels = feels or changed[i] != rates[i]
    return feels


@kernel
def _feels_inflow(flat: Array) -> bool:
    """Whether the thrust of any thruster depends on the motion."""
    begin, feels = int(flat[THRUSTER_TABLE]), False
    for i in range(int(flat[THRUSTER_COUNT])):
        feels = feels or flat[begin + i * COLUMNS + INFLOW] != 0.0
    return feels


@kernel
def _displace(motion: Motion, column: int, little: float) -> None:
    """Displace the state in the middle of a step a little, and by its negative put it back."""
    s, middle, turned = motion.s, motion.work[0], motion.work[2, :4]
    if column < 3:
        s[POSITION + column] += little
        relative_to_water(motion.flat, s)
    elif column < 6:
        if little > 0.0:
            _turn(middle, column - 3, little, turned)
            observe(motion.flat, middle[:3], turned, middle[7:BODY], s)
        else:
            observe_state(motion.flat, middle, s)
    elif column < DEVIATION:
        s[VELOCITY + column - 6] += little
        s[RELATIVE_VELOCITY + column - 6] += little
    else:
        middle[BODY + column - DEVIATION] += little


@kernel
def _turn(y: Array, axis: int, angle: float, quaternion: Array) -> None:
    """The quaternion of a state turned a little about an axis of the body; of any length."""
    half = 0.5 * angle
    a = half if axis == 0 else 0.0
    b = half if axis == 1 else 0.0
    c = half if axis == 2 else 0.0
    quaternion_product_kernel(y[3:7], 1.0, a, b, c, quaternion)


@kernel
def _pushes(motion: Motion, rotors: Array, changes: Changes, push: Array) -> None:
    """df/dp in the middle of a step, parameter by parameter."""
    flat, s, x = motion.flat, motion.s, motion.work[0, BODY:]
    rates, changed, tau, thrust = motion.work[1], motion.work[2], motion.work[3, :6], motion.work[3, 6:12]
    for j in range(changes.kinds.size):
        kind, share, at = changes.kinds[j], changes.shares[j], changes.where[j]
        program = changes.programs[at[0] : at[1]]
        changed[:] = 0.0
        tau[:] = 0.0
        if kind == WHOLE:
            relative_to_water(program, s)
            propel(program, s, rotors, tau)
            accelerate(program, s, x, changed[BODY:], tau, changed[7:BODY])
            relative_to_water(flat, s)
            for i in range(push.shape[0]):
                push[i, j] = (changed[7 + i] - rates[7 + i]) / share
            continue
        if kind == THRUST:
            propel(program, s, rotors, tau)
            for i in range(6):
                tau[i] -= thrust[i]
        else:
            wrench(changes.programs[at[2] : at[3]], s, x, changed, tau)
            for i in range(6):
                tau[i] = -tau[i]
            wrench(program, s, x, changed, tau)
        _accelerated(flat, tau, share, push[:, j])


@kernel
def _accelerated(flat: Array, tau: Array, share: float, out: Array) -> None:
    """What a wrench changes of nu_dot, for a unit of what it is a share of; internal states feel nothing."""
    out[:] = 0.0
    for i in range(6):
        row, total = HEADER + INVERSE_MASS_MATRIX + 6 * i, 0.0
        for k in range(6):
            total += flat[row + k] * tau[k]
        out[i] = total / share


@kernel
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


_add = kernel(_added, reorder_sums=True)
