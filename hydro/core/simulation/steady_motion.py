"""Limits of the wrench below which hydrodynamic moments do not overturn a vehicle.

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
"""Maximum speed of an excitation, relative to the speed at which the vehicle overturns."""
TURN_RATE = 2.0
"""Maximum steady yaw rate [rad/s]."""
MOST_TILT = 0.5
"""Maximum steady roll and pitch that an excitation may hold against the righting moment [rad]."""


def wrench_limits(program: Program, facets: Array, righting: Array) -> Array:
    """Return the maximum wrench on each axis that keeps a vehicle upright.

    Args:
        program: The compiled vehicle.
        facets: F facets of its hull, (8, F), from `vehicle.panels.loaded_facets`, or `NO_HULL`.
        righting: Righting stiffness in roll and pitch, (2,) [N m/rad].

    Returns:
        (6,) [N, N m], infinite without a limit.  In translation and yaw it is the drag at the highest speed
        at which the vehicle stays upright, in roll and pitch the righting moment at the tilt MOST_TILT.
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
    """Return the lowest speed along an axis [m/s] at which roll or pitch becomes unstable, or infinity."""
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
    """Return the wrench of the water on a level vehicle in steady motion, about CO, (6,) [N, N m].

    It contains the drag of the panels, the effects of the program and -C_A(nu_r) nu_r (Coriolis force of the
    added mass), minus their values at rest.

    Args:
        program: The compiled vehicle.
        facets: F facets of its hull, (8, F), or `NO_HULL`.
        nu_r: Velocity through still water, body axes, (6,) [m/s, rad/s].
    """
    moving, resting = np.zeros(6), np.zeros(6)
    _add_fluid_wrench(program.flat, facets, np.ascontiguousarray(nu_r), moving)
    _add_fluid_wrench(program.flat, facets, np.zeros(6), resting)
    return moving - resting


@jit
def _add_fluid_wrench(flat: Array, facets: Array, nu_r: Array, tau: Array) -> None:
    """Add panel drag, effects and added-mass Coriolis terms at velocity nu_r to `tau`, level and at depth."""
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
