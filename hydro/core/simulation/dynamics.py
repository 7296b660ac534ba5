"""The balance of a vehicle in water, solved for its acceleration.

    M nu_r_dot + C(nu_r) nu_r = tau_prop + tau_restoring + sum of effect wrenches,  M = M_RB + M_A

In a steady, uniform current v_c the dry body may be written with nu_r as well, since Newton's law holds in
the frame that drifts with the water (Fossen 2011, property 8.1).  The current is at rest in the world and
turns in the body:

    nu_r = nu - [R^T v_c; 0],  nu_r_dot = nu_dot + [omega x R^T v_c; 0]

The kernels take a program's flat vector (`core.effects.program`) and the state of motion `s` of
`core.effects.layout`.
"""

from __future__ import annotations

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.effects.layout import (
    BALANCE,
    CONSTANTS,
    INVERSE_MASS_MATRIX,
    MASS_MATRIX,
    POSITION,
    RELATIVE_VELOCITY,
    ROTATION,
    VELOCITY,
)
from hydro.core.effects.program import (
    HEADER,
    THRUSTER_COUNT,
    THRUSTER_TABLE,
    relative_to_water,
    wrench,
)
from hydro.core.vehicle.frames import quaternion_kernel
from hydro.core.vehicle.rigid_body import coriolis_kernel, restoring_kernel
from hydro.core.vehicle.thrusters import COLUMNS, INFLOW, inflow_speed, state_to_thrust


@jit
def observe(flat: Array, position: Array, quaternion: Array, nu: Array, s: Array) -> None:
    """Write the state of motion `s`: R of a quaternion (w, x, y, z) of any length, nu_r of the current."""
    quaternion_kernel(quaternion, s[ROTATION : ROTATION + 9])
    for i in range(3):
        s[POSITION + i] = position[i]
    for i in range(6):
        s[VELOCITY + i] = nu[i]
    relative_to_water(flat, s)


@jit
def propel(flat: Array, s: Array, rotors: Array, tau: Array) -> None:
    """Add tau_prop = B f to `tau`, f the thrusts of the lag states `rotors` (n,) in the water's flow."""
    begin = int(flat[THRUSTER_TABLE])
    for i in range(int(flat[THRUSTER_COUNT])):
        row = flat[begin + i * COLUMNS : begin + (i + 1) * COLUMNS]
        inflow = (
            inflow_speed(row, s[RELATIVE_VELOCITY : RELATIVE_VELOCITY + 6]) if row[INFLOW] != 0.0 else 0.0
        )
        thrust = state_to_thrust(row, rotors[i], inflow)
        for j in range(6):
            tau[j] += row[j] * thrust


@jit
def accelerate(flat: Array, s: Array, x: Array, dx: Array, tau: Array, nu_dot: Array) -> None:
    """Acceleration of CO over ground in the body frame, under tau_prop, restoring forces and all effects.

    Args:
        flat: The program.
        s: State of motion.
        x: Internal states of the effects.
        dx: Written: their rates.
        tau: The thrusters' wrench about CO [N, N m] on entry; overwritten by all that M accelerates.
        nu_dot: Written: (6,) [m/s^2, rad/s^2].
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


@jit
def _turn_with_body(s: Array, nu_dot: Array) -> None:
    """From nu_r_dot to nu_dot = nu_r_dot - [omega x R^T v_c; 0]; R^T v_c is v - v_r."""
    x = s[VELOCITY] - s[RELATIVE_VELOCITY]
    y = s[VELOCITY + 1] - s[RELATIVE_VELOCITY + 1]
    z = s[VELOCITY + 2] - s[RELATIVE_VELOCITY + 2]
    p, q, r = s[VELOCITY + 3], s[VELOCITY + 4], s[VELOCITY + 5]
    nu_dot[0] -= q * z - r * y
    nu_dot[1] -= r * x - p * z
    nu_dot[2] -= p * y - q * x
