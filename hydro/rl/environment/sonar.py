"""A sonar by closed forms: rays against walls, floor and vertical pillars, for all vehicles at once."""

from __future__ import annotations

import math

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.vehicle.description import Hull
from hydro.rl.environment.geometry import FLOOR, LENGTH, RADIUS, WIDTH
from hydro.rl.world.config import Sonar

BEAMS = 15


def beams(sonar: Sonar, hull: Hull) -> Array:
    """Where beams leave the hull and where they look, from port to starboard.

    They point away from the hull's centre, level in the body, and begin at its skin: a range is what is left
    before something touches there.

    Args:
        sonar: The fan.
        hull: The ellipsoid that carries them.

    Returns:
        Place x y z and direction x y z of every beam in the body (15, 6), FRD [m].
    """
    number = np.linspace(-1.0, 1.0, BEAMS)
    azimuth = 0.5 * sonar.fan * np.sign(number) * np.abs(number) ** sonar.crowding
    way = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(BEAMS)])
    skin = 1.0 / np.hypot(way[:, 0] / (0.5 * hull.length), way[:, 1] / (0.5 * hull.width))
    return np.column_stack([np.asarray(hull.center) + skin[:, None] * way, way])


@jit
def range_kernel(origin: Array, ray: Array, tank: Array, pillars: Array, reach: float) -> float:
    """Distance [m] along a unit ray (3,) from `origin` (3,), NED, to the first surface; at most `reach`.

    The water's surface gives no echo here.  From within a pillar or outside the tank the distance is 0.

    Args:
        origin: [m].
        ray: Direction.
        tank: Numbers of `rl.environment.geometry`.
        pillars: x y of their axes (P, 2), NaN where there is none.
        reach: [m].
    """
    nearest = reach
    for axis in range(3):
        end = tank[LENGTH] if axis == 0 else tank[WIDTH] if axis == 1 else tank[FLOOR]
        if ray[axis] > 0.0:
            nearest = min(nearest, (end - origin[axis]) / ray[axis])
        elif ray[axis] < 0.0 and axis < 2:
            nearest = min(nearest, -origin[axis] / ray[axis])
    level = ray[0] * ray[0] + ray[1] * ray[1]
    for i in range(pillars.shape[0]):
        x, y = origin[0] - pillars[i, 0], origin[1] - pillars[i, 1]
        toward = x * ray[0] + y * ray[1]
        outside = x * x + y * y - tank[RADIUS] * tank[RADIUS]
        if outside <= 0.0:
            nearest = 0.0
        elif toward < 0.0:  # never of a pillar that is not there, whose numbers are NaN
            hit = toward * toward - level * outside
            if hit > 0.0:
                nearest = min(nearest, outside / (-toward + math.sqrt(hit)))
    return max(nearest, 0.0)


@jit
def sonar_kernel(
    fan: Array, reach: float, tank: Array, position: Array, R: Array, pillars: Array, out: Array
) -> float:
    """Ranges of one vehicle's beams, and the least of them.

    Args:
        fan: Places and directions of the beams in the body (15, 6), FRD [m].
        reach: [m].
        tank: Numbers of `rl.environment.geometry`.
        position: Of CO (3,), NED.
        R: Body to NED (9,).
        pillars: (P, 2).
        out: (15,) written.
    """
    origin, ray = np.empty(3), np.empty(3)
    least = reach
    for beam in range(fan.shape[0]):
        place, way = fan[beam, :3], fan[beam, 3:]
        for i in range(3):
            row = R[3 * i : 3 * i + 3]
            origin[i] = position[i] + row[0] * place[0] + row[1] * place[1] + row[2] * place[2]
            ray[i] = row[0] * way[0] + row[1] * way[1] + row[2] * way[2]
        out[beam] = range_kernel(origin, ray, tank, pillars, reach)
        least = min(least, out[beam])
    return least
