"""Variational equation: responses of a motion to its initial state and to changes of its forces.

Along a predicted motion x(t) of x' = f(x, p), with the state x and the parameters p, small deviations obey
delta' = J delta + df/dp, J = df/dx.  J is computed once per step for any number of parameters.  df/dp of an
effect costs only the effect, not a whole vehicle.  So a hundred parameters cost a few predictions instead of
a hundred (Hairer, Norsett and Wanner 1993, section I.14).

A deviation consists of position in NED, small rotation about body axes, nu, and the internal states of the
effects: 12 + states values.  `simulation.integrate` integrates deviations together with a motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.compiled import copy_kernel, jit, kernel, separate
from hydro.core.effects.layout import (
    INVERSE_MASS_MATRIX,
    POSITION,
    RELATIVE_VELOCITY,
    ROTATION,
    VELOCITY,
)
from hydro.core.effects.program import HEADER, THRUSTER_COUNT, THRUSTER_TABLE, relative_to_water, wrench
from hydro.core.simulation.dynamics import (
    BODY,
    accelerate,
    observe,
    observe_state,
    propel,
)
from hydro.core.vehicle.frames import quaternion_product_kernel
from hydro.core.vehicle.thrusters import COLUMNS, INFLOW

Rows = NDArray[np.int64]

DEVIATION = 12
"""Number of components of a deviation of the body."""
LITTLE = 1e-3  # step of the state for J [m, rad, m/s, rad/s]
STIFF = 1.0
"""Decay of a velocity within a step of length h, h |J_ii|, above which deviations use a method of order 4.

The midpoint rule of order two is unstable above 2, where the method of the motion is still stable.
"""
FORCES, THRUST, WHOLE = 0, 1, 2
"""Kinds of parameter changes: wrenches of effects, thrusts at equal lag states, or any part of a program."""


class Changes(NamedTuple):
    """Changes of a compiled vehicle by P parameters, for the derivatives of its motion.

    Attributes:
        kinds: Kind of each parameter, (P,): FORCES, THRUST or WHOLE.
        programs: Concatenated programs of the changed vehicles, each once.  A change of kind FORCES has a
            program with the added effects, and another with the removed effects; a change of another kind has
            the program of the whole changed vehicle.
        where: Start and end of the program, and of that with the removed effects, in `programs`, (P, 4).
        own: Start and end of the internal states of the added effects among those of all changes, (P, 2).
        shares: Size of each change in units of the parameter, (P,).
    """

    kinds: Rows
    programs: Array
    where: Rows
    own: Rows
    shares: Array


NO_CHANGES = Changes(
    np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 4), np.int64), np.zeros((0, 2), np.int64), np.zeros(0)
)


class Deviations(NamedTuple):
    """Derivatives of a motion's state by its initial state and by P parameters, integrated with the motion.

    Attributes:
        changes: The parameters.
        delta: The derivatives, (12 + states, 12 + P): a column for each initial value and each parameter.
        own: Internal states of added effects, now and in the middle of a step, and their rates, (3, all).
        middle: Workspace for derivatives within a step, (2, 12 + states, 12 + P).
        slope: Workspace for the derivative J of the rates by the state, (12 + states, 12 + states).
        push: Workspace for the derivative of the rates by the parameters, without the pose, (6 + states, P).
        changed: Workspace for the rates of a changed state, (13 + states,).
        gone: Workspace for the wrench of removed effects, (6,).
        out: Output: derivatives in each of K rows, without internal states, (K, 12, 12 + P).
        carried: Whether the derivatives are integrated.
    """

    changes: Changes
    delta: Array
    own: Array
    middle: Array
    slope: Array
    push: Array
    changed: Array
    gone: Array
    out: Array
    carried: bool


class Middle(NamedTuple):
    """Motion in the middle of an integration step.

    Attributes:
        flat: Compiled vehicle (`effects.program`).
        s: State of motion of `core.effects.layout`.
        rotors: Lag states of the n thrusters, (n,).
        y: Integrated state, (13 + states,).
        rates: Rates of `y`.
        tau: Workspace for a wrench, (6,).
        thrust: Wrench of the thrusters tau_prop, (6,).
        changed: Workspace for the rates of a changed state.
    """

    flat: Array
    s: Array
    rotors: Array
    y: Array
    rates: Array
    tau: Array
    thrust: Array
    changed: Array


@jit
def deviations_of(changes: Changes, ahead: Array, own: Array, out: Array, carried: bool) -> Deviations:
    """Return the derivatives of a state at the start of a motion, with their workspace.

    Args:
        changes: The P parameters.
        ahead: Initial change of the internal states per unit of each parameter, (states, P).
        own: Initial internal states of the added effects, (all,).
        out: Output for the derivatives in K rows, (K, 12, 12 + P).
        carried: Whether the derivatives are integrated.
    """
    size, total = DEVIATION + ahead.shape[0], out.shape[2]
    delta, every = np.zeros((size, total)), np.zeros((3, own.size))
    for i in range(DEVIATION):
        delta[i, i] = 1.0
    for i in range(ahead.shape[0]):
        copy_kernel(ahead[i], delta[DEVIATION + i, DEVIATION:])
    copy_kernel(own, every[0])
    middle, slope, push = (
        np.zeros((2, size, total)),
        np.zeros((size, size)),
        np.zeros((size - 6, total - DEVIATION)),
    )
    changed, gone = np.zeros(size + 1), np.zeros(6)
    return Deviations(changes, delta, every, middle, slope, push, changed, gone, out, carried)


@separate
def carry(flat: Array, s: Array, work: Array, rotors: Array, h: float, deviations: Deviations) -> None:
    """Advance the derivatives of a state by a step, by the midpoint rule.

    The matrices of the variational equation, derivatives of the rates by state and by parameters, are taken
    at the middle of the step.  The arguments are the arrays of a motion (`dynamics.Motion`, without facets),
    in the state in which `integrate.step` has them at the middle of a step.

    Args:
        flat: Compiled vehicle (`effects.program`).
        s: State of motion at the middle.
        work: Workspace of `Motion`: row 2 is the integrated state at the middle, row 0 its rates.
        rotors: Lag states of the n thrusters at the middle, (n,).
        h: Step [s].
        deviations: The derivatives, changed.
    """
    delta, middle, slope, push = deviations.delta, deviations.middle, deviations.slope, deviations.push
    here = Middle(flat, s, rotors, work[2], work[0], work[3, :6], work[3, 6:12], deviations.changed)
    here.thrust[:] = 0.0
    propel(flat, s, rotors, here.thrust)
    _pose_slopes(s, slope)
    _balance_slopes(here, slope)
    _pushes(here, h, deviations, push)
    if _is_stiff(slope, h):
        _onward(slope, push, 0.25 * h, delta, delta, middle[1])
        _onward(slope, push, h / 3.0, delta, middle[1], middle[0])
        _onward(slope, push, 0.5 * h, delta, middle[0], middle[1])
        _add(slope, push, h, middle[1], delta)
        return
    _onward(slope, push, 0.5 * h, delta, delta, middle[0])
    _add(slope, push, h, middle[0], delta)


@kernel
def _is_stiff(slope: Array, h: float) -> bool:
    """Return whether a velocity decays too fast within a step h [s] for the midpoint rule."""
    most = 0.0
    for i in range(6, DEVIATION):
        most = max(most, abs(slope[i, i]))
    return h * most > STIFF


@kernel
def _onward(slope: Array, push: Array, h: float, delta: Array, at: Array, out: Array) -> None:
    """Write delta + h (J at + df/dp) to `out`: the deviations h [s] later, with their rates at `at`."""
    for i in range(delta.shape[0]):
        copy_kernel(delta[i], out[i])
    _add(slope, push, h, at, out)


@kernel
def _balance_slopes(here: Middle, slope: Array) -> None:
    """Fill the rows of J for nu and for internal states, by finite differences of their rates."""
    flat, s, rotors, middle, rates, tau, thrust, changed = here
    inflow, still = _feels_inflow(flat), not _feels_place(here)
    for column in range(slope.shape[0]):
        if still and column < 3:
            slope[6:, column] = 0.0
            continue
        _displace(here, column, LITTLE)
        copy_kernel(thrust, tau)
        if inflow:
            tau[:] = 0.0
            propel(flat, s, rotors, tau)
        accelerate(flat, s, middle[BODY:], changed[BODY:], tau, changed[7:BODY])
        for i in range(slope.shape[0] - 6):
            slope[6 + i, column] = (changed[7 + i] - rates[7 + i]) / LITTLE
        _displace(here, column, -LITTLE)


@kernel
def _feels_place(here: Middle) -> bool:
    """Return whether any rate depends on the position; if not, three columns of J are skipped.

    Each coordinate is displaced by a different amount, so that their effects cannot cancel.
    """
    flat, s, _, middle, rates, tau, thrust, changed = here
    x, y, z = s[POSITION], s[POSITION + 1], s[POSITION + 2]
    s[POSITION], s[POSITION + 1], s[POSITION + 2] = x + LITTLE, y + 1.7 * LITTLE, z + 2.9 * LITTLE
    relative_to_water(flat, s)
    copy_kernel(thrust, tau)
    accelerate(flat, s, middle[BODY:], changed[BODY:], tau, changed[7:BODY])
    s[POSITION], s[POSITION + 1], s[POSITION + 2] = x, y, z
    relative_to_water(flat, s)
    feels = False
    for i in range(7, middle.size):
        feels = feels or changed[i] != rates[i]
    return feels


@kernel
def _feels_inflow(flat: Array) -> bool:
    """Return whether the thrust of any thruster depends on the motion."""
    begin, feels = int(flat[THRUSTER_TABLE]), False
    for i in range(int(flat[THRUSTER_COUNT])):
        feels = feels or flat[begin + i * COLUMNS + INFLOW] != 0.0
    return feels


@kernel
def _displace(here: Middle, column: int, little: float) -> None:
    """Displace component `column` of the state by a small step; the negative step reverts this."""
    flat, s, middle, turned = here.flat, here.s, here.y, here.changed[:4]
    if column < 3:
        s[POSITION + column] += little
        relative_to_water(flat, s)
    elif column < 6:
        if little > 0.0:
            _turn(middle, column - 3, little, turned)
            observe(flat, middle[:3], turned, middle[7:BODY], s)
        else:
            observe_state(flat, middle, s)
    elif column < DEVIATION:
        s[VELOCITY + column - 6] += little
        s[RELATIVE_VELOCITY + column - 6] += little
    else:
        middle[BODY + column - DEVIATION] += little


@kernel
def _turn(y: Array, axis: int, angle: float, quaternion: Array) -> None:
    """Write the quaternion of state `y` rotated by a small angle about a body axis; not normalised."""
    half = 0.5 * angle
    a = half if axis == 0 else 0.0
    b = half if axis == 1 else 0.0
    c = half if axis == 2 else 0.0
    quaternion_product_kernel(y[3:7], 1.0, a, b, c, quaternion)


@kernel
def _pushes(here: Middle, h: float, deviations: Deviations, push: Array) -> None:
    """Write df/dp, parameter by parameter; internal states of added effects advance by the step h [s]."""
    flat, s, rotors, y, rates, tau, thrust, changed = here
    changes, own, gone = deviations.changes, deviations.own, deviations.gone
    x, lost = y[BODY:], -1
    for j in range(changes.kinds.size):
        kind, per_unit, at = changes.kinds[j], 1.0 / changes.shares[j], changes.where[j]
        program = changes.programs[at[0] : at[1]]
        changed[:] = 0.0
        tau[:] = 0.0
        if kind == WHOLE:
            relative_to_water(program, s)
            propel(program, s, rotors, tau)
            accelerate(program, s, x, changed[BODY:], tau, changed[7:BODY])
            relative_to_water(flat, s)
            for i in range(push.shape[0]):
                push[i, j] = (changed[7 + i] - rates[7 + i]) * per_unit
            continue
        if kind == THRUST:
            propel(program, s, rotors, tau)
            for i in range(6):
                tau[i] -= thrust[i]
        else:
            if at[2] != lost:  # all parameters of an effect remove the same effects
                lost = at[2]
                gone[:] = 0.0
                wrench(changes.programs[at[2] : at[3]], s, x, changed, gone)
            for i in range(6):
                tau[i] = -gone[i]
            begin, end = changes.own[j, 0], changes.own[j, 1]
            if begin == end:
                wrench(program, s, x, changed, tau)
            else:
                now, middle, slopes = own[0, begin:end], own[1, begin:end], own[2, begin:end]
                _remembering(program, s, h, now, middle, slopes, changed[:6], tau)
        _accelerated(flat, tau, per_unit, push[:, j])


@kernel
def _remembering(
    program: Array, s: Array, h: float, now: Array, middle: Array, rates: Array, unused: Array, tau: Array
) -> None:
    """Add the wrench of effects with internal states to `tau`, and advance these states by the step h [s]."""
    wrench(program, s, now, rates, unused)
    for i in range(now.size):
        middle[i] = now[i] + 0.5 * h * rates[i]
    wrench(program, s, middle, rates, tau)
    for i in range(now.size):
        now[i] += h * rates[i]


@kernel
def _accelerated(flat: Array, tau: Array, per_unit: float, out: Array) -> None:
    """Write the change of nu_dot by a wrench `tau`, per unit of a parameter; no internal state changes."""
    out[:] = 0.0
    for i in range(6):
        row, total = HEADER + INVERSE_MASS_MATRIX + 6 * i, 0.0
        for k in range(6):
            total += flat[row + k] * tau[k]
        out[i] = total * per_unit


@kernel
def _pose_slopes(s: Array, slope: Array) -> None:
    """Fill the rows of J for the position, p' = R v, and for the small rotation about body axes."""
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
    """Add h (J delta + df/dp) to `out`; J is `slope`, df/dp is `push`."""
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
