"""A sonar by closed forms: rays against walls, floor and vertical pillars, for all vehicles at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hydro.core.compiled import jit
from hydro.rl.config import Sonar
from hydro.rl.geometry import FLOOR, LENGTH, RADIUS, WIDTH

Array = NDArray[np.float64]

BEAMS = 15


def beams(sonar: Sonar) -> Array:
    """Directions of the beams (15, 2), x forward and y to starboard in the body, from port to starboard."""
    azimuth = np.linspace(-0.5 * sonar.fan, 0.5 * sonar.fan, BEAMS)
    return np.column_stack([np.cos(azimuth), np.sin(azimuth)])


@jit
def range_kernel(origin: Array, ray: Array, tank: Array, pillars: Array, reach: float) -> float:
    """Distance [m] along a unit ray (3,) from `origin` (3,), NED, to the first surface; at most `reach`.

    The water's surface gives no echo here.  From within a pillar or outside the tank the distance is 0.

    Args:
        origin: [m].
        ray: Direction.
        tank: Numbers of `rl.geometry`.
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
    bow: Array, fan: Array, reach: float, tank: Array, position: Array, R: Array, pillars: Array, out: Array
) -> float:
    """Ranges of one vehicle's beams, and the least of them.

    Args:
        bow: Where the sonar sits in the body (3,), FRD [m].
        fan: Directions of the beams (15, 2).
        reach: [m].
        tank: Numbers of `rl.geometry`.
        position: Of CO (3,), NED.
        R: Body to NED (9,).
        pillars: (P, 2).
        out: (15,) written.
    """
    origin, ray = np.empty(3), np.empty(3)
    for i in range(3):
        origin[i] = position[i] + R[3 * i] * bow[0] + R[3 * i + 1] * bow[1] + R[3 * i + 2] * bow[2]
    least = reach
    for beam in range(fan.shape[0]):
        for i in range(3):
            ray[i] = R[3 * i] * fan[beam, 0] + R[3 * i + 1] * fan[beam, 1]
        out[beam] = range_kernel(origin, ray, tank, pillars, reach)
        least = min(least, out[beam])
    return least
