"""Equation of motion of a vehicle in water, solved for its acceleration.

    M nu_r_dot + C(nu_r) nu_r = tau_prop + tau_restoring + sum of effect wrenches,  M = M_RB + M_A

In a steady, uniform current v_c the rigid-body terms may use nu_r as well, since Newton's law holds in the
frame that drifts with the water (Fossen 2011, property 8.1).  The current is constant in the world and
rotates in the body:

    nu_r = nu - [R^T v_c; 0],  nu_r_dot = nu_dot + [omega x R^T v_c; 0]

The kernels take a program's flat vector (`core.effects.program`) and the state of motion `s` of
`core.effects.layout`.  The integrated state y is position (3), unit quaternion (4), nu (6) and the internal
states of the effects.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import jit, kernel, separate
from hydro.core.effects.layout import (
    BALANCE,
    CONSTANTS,
    INVERSE_MASS_MATRIX,
    MASS_MATRIX,
    MOTION,
    POSITION,
    RELATIVE_VELOCITY,
    ROTATION,
    VELOCITY,
)
from hydro.core.effects.program import (
    HEADER,
    STATE_COUNT,
    THRUSTER_COUNT,
    THRUSTER_TABLE,
    relative_to_water,
    start,
    wrench,
)
from hydro.core.simulation.held import exert_held
from hydro.core.vehicle.frames import quaternion_kernel
from hydro.core.vehicle.panels import panel_wrench_kernel
from hydro.core.vehicle.rigid_body import coriolis_kernel, restoring_kernel
from hydro.core.vehicle.thrusters import COLUMNS, INFLOW, inflow_speed, state_to_thrust

BODY = 13
"""Length of the state of the body itself, before the effects' internal states."""
NO_HULL: Array = np.zeros((8, 0))
"""Facets of a vehicle without the panel method."""


class Motion(NamedTuple):
    """State and workspace of a moving vehicle, changed by the kernels in place.

    Attributes:
        flat: Compiled vehicle (`effects.program`).
        facets: Hull of the panel method, F facets, (8, F), from `vehicle.panels.loaded_facets`, or `NO_HULL`.
        y: Integrated state: position, unit quaternion, nu and internal states of the effects, (13 + states,).
        s: State of motion of `core.effects.layout` at the last evaluation, optionally followed by a held
            wrench (`simulation.held`).
        work: Workspace for three states and a wrench, (4, y.size).
    """

    flat: Array
    facets: Array
    y: Array
    s: Array
    work: Array


@jit
def afloat(flat: Array, facets: Array) -> Motion:
    """Return the `Motion` of a vehicle with all states 0, which the caller then initialises.

    Args:
        flat: Compiled vehicle (`effects.program`).
        facets: Hull of the panel method, F facets, (8, F), or `NO_HULL`.
    """
    size = BODY + int(flat[STATE_COUNT])
    return Motion(flat, facets, np.zeros(size), np.zeros(MOTION), np.zeros((4, size)))


@kernel
def observe(flat: Array, position: Array, quaternion: Array, nu: Array, s: Array) -> None:
    """Write to `s` the quantities of motion that the effects read, computed from pose and velocity.

    The time in `s` is kept, for the current.

    Args:
        flat: Compiled vehicle (`effects.program`), for the current.
        position: Position, NED, (3,) [m].
        quaternion: Body to NED (w, x, y, z), of any length but 0.
        nu: Velocity of CO over ground, body axes, (6,) [m/s, rad/s].
        s: Output: rotation, position, nu and nu_r, in the layout of `effects.layout`.
    """
    quaternion_kernel(quaternion, s[ROTATION : ROTATION + 9])
    for i in range(3):
        s[POSITION + i] = position[i]
    for i in range(6):
        s[VELOCITY + i] = nu[i]
    relative_to_water(flat, s)


@kernel
def observe_state(flat: Array, y: Array, s: Array) -> None:
    """Write to `s` the quantities of motion that the effects read, computed from an integrated state.

    Args:
        flat: Compiled vehicle (`effects.program`), for the current.
        y: Integrated state: position, unit quaternion, nu, and internal states of the effects.
        s: Output: state of motion in the layout of `effects.layout`; the time is read.
    """
    observe(flat, y[:3], y[3:7], y[7:BODY], s)


@kernel
def settle(motion: Motion) -> None:
    """Set the internal states of the effects to their steady values at the present motion and time.

    Args:
        motion: State of the vehicle; its `y` and `s` are changed in place.
    """
    observe_state(motion.flat, motion.y, motion.s)
    start(motion.flat, motion.s, motion.y[BODY:])


@kernel
def thrust_of(row: Array, rotor: float, s: Array) -> float:
    """Return the thrust of one thruster [N], with losses by the water's inflow.

    Args:
        row: Row of the thruster table.
        rotor: Lag state of the thruster: thrust [N] before losses, or normalised rotor speed.
        s: State of motion (`effects.layout`), for the inflow speed.
    """
    inflow = inflow_speed(row, s[RELATIVE_VELOCITY : RELATIVE_VELOCITY + 6]) if row[INFLOW] != 0.0 else 0.0
    return state_to_thrust(row, rotor, inflow)


@kernel
def propel(flat: Array, s: Array, rotors: Array, tau: Array) -> None:
    """Add to `tau` the wrench of all thrusters about CO, B f with the configuration matrix B and thrusts f.

    Args:
        flat: Compiled vehicle (`effects.program`).
        s: State of motion, for the inflow speed.
        rotors: Lag states of the n thrusters, (n,).
        tau: Wrench in body axes, (6,) [N, N m], added to.
    """
    begin = int(flat[THRUSTER_TABLE])
    # six variables, since elements of an array would be stored and loaded again for every thruster
    x, y, z, k, m, n = tau[0], tau[1], tau[2], tau[3], tau[4], tau[5]
    for i in range(int(flat[THRUSTER_COUNT])):
        row = flat[begin + i * COLUMNS : begin + (i + 1) * COLUMNS]
        thrust = thrust_of(row, rotors[i], s)
        x, y, z = x + row[0] * thrust, y + row[1] * thrust, z + row[2] * thrust
        k, m, n = k + row[3] * thrust, m + row[4] * thrust, n + row[5] * thrust
    tau[0], tau[1], tau[2], tau[3], tau[4], tau[5] = x, y, z, k, m, n


@kernel
def accelerate(flat: Array, s: Array, x: Array, dx: Array, tau: Array, nu_dot: Array) -> None:
    """Write to `nu_dot` the acceleration of CO over ground, from thrust, restoring forces and effects.

    Args:
        flat: Compiled vehicle (`effects.program`).
        s: State of motion.
        x: Internal states of the effects.
        dx: Output: rates of the internal states.
        tau: The thrusters' wrench about CO [N, N m] on entry; overwritten by the total wrench that
            accelerates the mass, added mass included.
        nu_dot: Output: acceleration in body axes, (6,) [m/s^2, rad/s^2].
    """
    c, nu_r = flat[HEADER : HEADER + CONSTANTS], s[RELATIVE_VELOCITY : RELATIVE_VELOCITY + 6]
    restoring_kernel(c[BALANCE : BALANCE + 4], s[ROTATION + 6 : ROTATION + 9], tau)
    wrench(flat, s, x, dx, tau)
    nu_dot[:] = 0.0
    coriolis_kernel(c[MASS_MATRIX : MASS_MATRIX + 36], nu_r, nu_dot)
    for i in range(6):
        tau[i] -= nu_dot[i]
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += c[INVERSE_MASS_MATRIX + 6 * i + j] * tau[j]
        nu_dot[i] = total
    _turn_with_body(s, nu_dot)


@separate
def respond(flat: Array, s: Array, rotors: Array, x: Array, dx: Array, tau: Array, nu_dot: Array) -> None:
    """Write to `nu_dot` the acceleration of CO over ground, from rotor states, restoring forces and effects.

    Args:
        flat: Compiled vehicle (`effects.program`).
        s: State of motion.
        rotors: Lag states of the n thrusters, (n,).
        x: Internal states of the effects.
        dx: Output: rates of the internal states.
        tau: Output: the total wrench about CO that accelerates the mass, added mass included, (6,) [N, N m].
        nu_dot: Output: acceleration in body axes, (6,) [m/s^2, rad/s^2].
    """
    tau[:] = 0.0
    propel(flat, s, rotors, tau)
    accelerate(flat, s, x, dx, tau, nu_dot)


@kernel
def _turn_with_body(s: Array, nu_dot: Array) -> None:
    """Convert nu_r_dot to nu_dot = nu_r_dot - [omega x R^T v_c; 0], with the current v_c in place.

    R^T v_c is the velocity over ground minus that through the water.
    """
    x = s[VELOCITY] - s[RELATIVE_VELOCITY]
    y = s[VELOCITY + 1] - s[RELATIVE_VELOCITY + 1]
    z = s[VELOCITY + 2] - s[RELATIVE_VELOCITY + 2]
    p, q, r = s[VELOCITY + 3], s[VELOCITY + 4], s[VELOCITY + 5]
    nu_dot[0] -= q * z - r * y
    nu_dot[1] -= r * x - p * z
    nu_dot[2] -= p * y - q * x


@separate
def rates_kernel(
    flat: Array, facets: Array, y: Array, s: Array, rotors: Array, tau: Array, rates: Array
) -> None:
    """Write the time derivatives of the integrated state `y` to `rates`.

    They follow from quaternion kinematics (Fossen 2011, section 2.2.2) and the equation of motion.

    Args:
        flat: Compiled vehicle (`effects.program`).
        facets: Hull of the panel method, F facets, (8, F), or `NO_HULL`.
        y: Integrated state: position, unit quaternion, nu and internal states of the effects.
        s: State of motion; the time is read, the rest is overwritten.
        rotors: Lag states of the n thrusters, (n,).
        tau: Workspace, (6,).
        rates: Output: rates of `y`; components 7 to 12 are nu_dot of CO.
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
    if s.size > MOTION:
        exert_held(s, tau)
    accelerate(flat, s, y[BODY:], rates[BODY:], tau, rates[7:BODY])
