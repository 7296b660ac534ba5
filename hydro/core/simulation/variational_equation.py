"""Variational equation: responses of a motion to its initial state and to changes of its forces.

Along a predicted motion x(t) of x' = f(x, p), with the state x and the parameters p, small deviations obey
delta' = J delta + df/dp, J = df/dx.  J is computed once per interval for any number of parameters.  df/dp of
an effect costs only the effect, not a whole vehicle.  So a hundred parameters cost a few predictions instead
of a hundred (Hairer, Norsett and Wanner 1993, section I.14).

An interval has one or more steps of the motion, as `Deviations.stride` says.  Deviations need no more than
1 % accuracy, the motion a millionth, so they are content with longer intervals.

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
    COMMANDS,
    INVERSE_MASS_MATRIX,
    MOST_COMMANDS,
    MOTION,
    POSITION,
    RELATIVE_VELOCITY,
    ROTATION,
    TIME,
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
STIFF = 0.15
"""Greatest decay h |J_ii| of a velocity or an internal state within a step h of the midpoint rule.

An interval with more is divided.  With 0.5, twice as much error of a fast roll stays unexplained, and an
error of 3 % in a damping is no longer significant in a minute; above 2 the rule is unstable.
"""
MIDDLE, SPAN, KEPT, COUNT, LEFT = 0, 1, 2, 3, 4
"""Places in `Deviations.interval`."""
MOST_PARTS = 100
"""Most steps of one interval; a vehicle that decays faster diverges in any case."""
CLOSE = 1e-6  # shares of a step up to which two times count as equal
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
        stride: Steps of the motion in one interval, after which the deviations advance.
        interval: Time of the interval's middle [s], its length so far [s], whether the motion in its middle
            is kept (0 or 1), number of steps so far, and number of steps before the interval must end, (5,).
        delta: The deviations, (12 + states, 12 + P): a column for each initial value and each parameter.
        own: Internal states of added effects, now and in the middle of an interval, and their rates,
            (3, all).
        s: State of motion in the middle of the interval, in the layout of `core.effects.layout`.
        y: Integrated state there, and its rates, (2, 13 + states).
        rotors: Lag states of the n thrusters there, and their mean over the interval, (2, n).
        commands: Sum of the commands over the interval, times its length [s], (n,).
        middle: Workspace for deviations within an interval, (12 + states, 12 + P).
        slope: Workspace for J, (12 + states, 12 + states).
        push: Workspace for df/dp without its rows of the pose, (6 + states, P).
        changed: Workspace for the rates of a changed state, (13 + states,).
        tau: Workspace for three wrenches, (3, 6).
        out: Output: deviations at the end of each of K - 1 intervals, and at the beginning, without internal
            states, (K, 12, 12 + P).
        carried: Whether the deviations are integrated.
    """

    changes: Changes
    stride: int
    interval: Array
    delta: Array
    own: Array
    s: Array
    y: Array
    rotors: Array
    commands: Array
    middle: Array
    slope: Array
    push: Array
    changed: Array
    tau: Array
    out: Array
    carried: bool


class Middle(NamedTuple):
    """Motion in the middle of an interval.

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
def deviations_of(
    changes: Changes, stride: int, thrusters: int, ahead: Array, own: Array, out: Array, carried: bool
) -> Deviations:
    """Return the deviations at the start of a motion, with their workspace.

    Args:
        changes: The P parameters.
        stride: Steps of the motion in one interval.
        thrusters: Number of thrusters.
        ahead: Initial change of the internal states per unit of each parameter, (states, P).
        own: Initial internal states of the added effects, (all,).
        out: Output for the deviations at the ends of K - 1 intervals, (K, 12, 12 + P).
        carried: Whether the deviations are integrated.
    """
    size, total = DEVIATION + ahead.shape[0], out.shape[2]
    delta, every = np.zeros((size, total)), np.zeros((3, own.size))
    for i in range(DEVIATION):
        delta[i, i] = 1.0
    for i in range(ahead.shape[0]):
        copy_kernel(ahead[i], delta[DEVIATION + i, DEVIATION:])
    copy_kernel(own, every[0])
    return Deviations(
        changes,
        stride,
        np.zeros(5),
        delta,
        every,
        np.zeros(MOTION),
        np.zeros((2, size + 1)),
        np.zeros((2, thrusters)),
        np.zeros(thrusters),
        np.zeros((size, total)),
        np.zeros((size, size)),
        np.zeros((size - 6, total - DEVIATION)),
        np.zeros(size + 1),
        np.zeros((3, 6)),
        out,
        carried,
    )


@kernel
def begin_step(deviations: Deviations, now: float, length: float) -> None:
    """Begin an interval if the last one has ended.

    Args:
        deviations: The deviations, changed.
        now: Time at which a step of the motion begins [s].
        length: Length of a step [s].
    """
    interval = deviations.interval
    if interval[COUNT] == 0.0:
        steps = min(float(deviations.stride), interval[LEFT])
        interval[MIDDLE], interval[SPAN], interval[KEPT] = now + 0.5 * length * steps, 0.0, 0.0
        deviations.rotors[1] = 0.0
        deviations.commands[:] = 0.0


@separate
def carry(flat: Array, deviations: Deviations) -> None:
    """Advance deviations by the interval that ends, by the midpoint rule, with J and df/dp in its middle.

    df/dp of thrusts and of single effects is that of the mean lag states and commands of the interval, since
    commands may jump within it.

    Args:
        flat: Compiled vehicle (`effects.program`).
        deviations: The deviations, changed.
    """
    delta, slope, push, h = deviations.delta, deviations.slope, deviations.push, deviations.interval[SPAN]
    y, rates, tau = deviations.y[0], deviations.y[1], deviations.tau
    here = Middle(flat, deviations.s, deviations.rotors[0], y, rates, tau[0], tau[1], deviations.changed)
    here.thrust[:] = 0.0
    propel(flat, here.s, here.rotors, here.thrust)
    _pose_slopes(here.s, slope)
    _balance_slopes(here, slope)
    _pushes_of_programs(here, deviations, push)
    for i in range(here.rotors.size):
        deviations.rotors[1, i] /= h
    for i in range(min(here.rotors.size, MOST_COMMANDS)):
        here.s[COMMANDS + i] = deviations.commands[i] / h
    _pushes(here, h, deviations, push)
    parts = _parts(slope, h)
    for _ in range(parts):
        _onward(slope, push, 0.5 * h / parts, delta, delta, deviations.middle)
        _add(slope, push, h / parts, deviations.middle, delta)


@kernel
def end_step(flat: Array, deviations: Deviations) -> None:
    """Advance the deviations if an interval ends with a step of the motion.

    Args:
        flat: Compiled vehicle (`effects.program`).
        deviations: The deviations, changed.
    """
    interval = deviations.interval
    interval[COUNT] += 1.0
    interval[LEFT] -= 1.0
    if interval[COUNT] == deviations.stride or interval[LEFT] == 0.0:
        carry(flat, deviations)
        interval[COUNT] = 0.0


@kernel
def keep_middle(deviations: Deviations, s: Array, work: Array, rotors: Array, h: float, stage: int) -> None:
    """Keep the motion in the middle of the interval, and add up the lag states and commands of a step.

    Args:
        deviations: The deviations, whose kept motion is changed.
        s: State of motion at a stage of the integration step.
        work: Workspace of `dynamics.Motion`: row 2 is the integrated state at the stage, row 0 its rates.
        rotors: Lag states of the n thrusters at the stage, (n,).
        h: Step [s].
        stage: Stage of the method of the motion: 0 at the beginning of the step, 1 in its middle.
    """
    interval, total, commands = deviations.interval, deviations.rotors[1], deviations.commands
    if stage == 1:
        interval[SPAN] += h
        for i in range(total.size):
            total[i] += h * rotors[i]
        for i in range(min(total.size, MOST_COMMANDS)):
            commands[i] += h * s[COMMANDS + i]
    if interval[KEPT] == 0.0 and s[TIME] >= interval[MIDDLE] - CLOSE * h:
        interval[KEPT] = 1.0
        copy_kernel(s[:MOTION], deviations.s)
        copy_kernel(work[2], deviations.y[0])
        copy_kernel(work[0], deviations.y[1])
        copy_kernel(rotors, deviations.rotors[0])


@kernel
def _parts(slope: Array, h: float) -> int:
    """Return the number of steps of an interval h [s] in which no velocity or internal state decays fast."""
    most = 0.0
    for i in range(6, slope.shape[0]):
        most = max(most, abs(slope[i, i]))
    return 1 + min(int(h * most / STIFF), MOST_PARTS)


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
def _pushes_of_programs(here: Middle, deviations: Deviations, push: Array) -> None:
    """Write df/dp of the parameters that may change any part of a program."""
    flat, s, rotors, y, rates, tau, _, changed = here
    changes = deviations.changes
    for j in range(changes.kinds.size):
        if changes.kinds[j] != WHOLE:
            continue
        program, per_unit = (
            changes.programs[changes.where[j, 0] : changes.where[j, 1]],
            1.0 / changes.shares[j],
        )
        tau[:] = 0.0
        relative_to_water(program, s)
        propel(program, s, rotors, tau)
        accelerate(program, s, y[BODY:], changed[BODY:], tau, changed[7:BODY])
        for i in range(push.shape[0]):
            push[i, j] = (changed[7 + i] - rates[7 + i]) * per_unit
    relative_to_water(flat, s)


@kernel
def _pushes(here: Middle, h: float, deviations: Deviations, push: Array) -> None:
    """Write df/dp of thrusts and effects; internal states of added effects advance by the interval h [s]."""
    flat, s, _, y, _, tau, thrust, changed = here
    changes, own, gone, mean = deviations.changes, deviations.own, deviations.tau[2], deviations.rotors[1]
    x, lost = y[BODY:], -1
    thrust[:] = 0.0
    propel(flat, s, mean, thrust)
    for j in range(changes.kinds.size):
        kind, at = changes.kinds[j], changes.where[j]
        if kind == WHOLE:
            continue
        program = changes.programs[at[0] : at[1]]
        if kind == THRUST:
            tau[:] = 0.0
            propel(program, s, mean, tau)
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
        for i in range(6):
            push[i, j] = tau[i] / changes.shares[j]
    _accelerated(flat, changes.kinds, push)


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
def _accelerated(flat: Array, kinds: Rows, push: Array) -> None:
    """Replace wrenches in columns of `push` by the changes of nu_dot; no internal state changes."""
    begin = HEADER + INVERSE_MASS_MATRIX
    for j in range(kinds.size):
        if kinds[j] == WHOLE:
            continue
        x, y, z, k, m, n = push[0, j], push[1, j], push[2, j], push[3, j], push[4, j], push[5, j]
        for i in range(6):
            row = begin + 6 * i
            linear = flat[row] * x + flat[row + 1] * y + flat[row + 2] * z
            push[i, j] = linear + flat[row + 3] * k + flat[row + 4] * m + flat[row + 5] * n


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
