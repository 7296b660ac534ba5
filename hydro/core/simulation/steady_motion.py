"""Limits of the wrench at which hydrodynamic moments overturn a vehicle.

A hull in straight motion has moments that grow with the square of its speed and turn it broadside (Munk;
Fossen 2011, section 6.3.1).  Weight and buoyancy, and any attitude control, resist them.  Above some speed
the vehicle tumbles, and the recording is of no use.  The limits here keep excitation below that speed.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.effects.layout import ADDED_MASS, MOTION, POSITION, RELATIVE_VELOCITY, ROTATION, VELOCITY
from hydro.core.effects.program import HEADER, STATE_COUNT, Program, wrench
from hydro.core.vehicle.panels import panel_wrench_kernel
from hydro.core.vehicle.rigid_body import coriolis_kernel

MARGIN = 0.9
"""Maximum speed of excitation relative to the speed of overturning."""
TURN_RATE = 2.0
"""Maximum steady yaw rate [rad/s]."""
MOST_TILT = 0.5
"""Maximum steady roll and pitch of excitation against the righting moment [rad]."""


def wrench_limits(program: Program, facets: Array, righting: Array) -> Array:
    """Return the maximum wrench on each axis that keeps a vehicle upright.

    Args:
        program: The vehicle.
        facets: Facets of its hull (8, F), from `vehicle.panels.loaded_facets`.
        righting: Stiffness (2,) in roll and pitch [N m/rad].

    Returns:
        (6,) [N, N m], infinite without a limit.  In translation and yaw it is the drag at the maximum speed.
    """
    limits = np.full(6, np.inf)
    for axis in range(3):
        greatest = _upright_speed(program, facets, righting, axis)
        if np.isfinite(greatest):
            limits[axis] = abs(fluid_wrench(program, facets, MARGIN * greatest * np.eye(6)[axis])[axis])
    limits[3:5] = np.where(righting > 0.0, MOST_TILT * righting, np.inf)
    limits[5] = abs(fluid_wrench(program, facets, TURN_RATE * np.eye(6)[5])[5])
    return limits


def _upright_speed(program: Program, facets: Array, righting: Array, axis: int) -> float:
    """Return the speed along a translational axis [m/s] at which roll or pitch becomes unstable, or inf."""
    tilt = 1e-4
    speeds = [np.inf]
    for turn in (0, 1):
        if turn == axis or righting[turn] <= 0.0:
            continue
        for direction in (1.0, -1.0):
            motion = direction * np.eye(3)[axis]
            # A body tilted by a small angle about e, on the same course, has the inflow v - tilt e x v.
            tilted = motion - tilt * np.cross(np.eye(3)[turn], motion)
            moments = [
                fluid_wrench(program, facets, np.concatenate([v, np.zeros(3)]))[3 + turn]
                for v in (motion, tilted)
            ]
            overturning = (moments[1] - moments[0]) / tilt
            if overturning > 0.0:
                speeds.append(float(np.sqrt(righting[turn] / overturning)))
    return min(speeds)


def fluid_wrench(program: Program, facets: Array, nu_r: Array) -> Array:
    """Return the wrench (6,) [N, N m] of steady motion through still water on a level vehicle.

    It contains panels, the effects of its program and -C_A(nu_r) nu_r, minus their values at rest.
    """
    moving, resting = np.zeros(6), np.zeros(6)
    _add_fluid_wrench(program.flat, facets, np.ascontiguousarray(nu_r), moving)
    _add_fluid_wrench(program.flat, facets, np.zeros(6), resting)
    return moving - resting


@jit
def _add_fluid_wrench(flat: Array, facets: Array, nu_r: Array, tau: Array) -> None:
    """Add panels, effects and added-mass Coriolis terms at a level attitude, deep below the surface."""
    s, states = np.zeros(MOTION), int(flat[STATE_COUNT])
    for i in range(6):
        s[RELATIVE_VELOCITY + i] = s[VELOCITY + i] = nu_r[i]
    for i in range(3):
        s[ROTATION + 4 * i] = 1.0
    s[POSITION + 2] = 1e3
    panel_wrench_kernel(nu_r, facets, tau)
    wrench(flat, s, np.zeros(states), np.zeros(states), tau)
    coriolis = np.zeros(6)
    coriolis_kernel(flat[HEADER + ADDED_MASS : HEADER + ADDED_MASS + 36], nu_r, coriolis)
    tau -= coriolis
