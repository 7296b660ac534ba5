"""Analytic sonar: rays against walls, floor and vertical pillars, for all vehicles at once."""

from __future__ import annotations

import math

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.vehicle.description import Hull
from hydro.rl.environment.geometry import FLOOR, LENGTH, RADIUS, WIDTH
from hydro.rl.world.config import Sonar

BEAMS = 15  # paper III-D

Point = tuple[float, float, float]
"""x y z [m]; a tuple, because threads of a GPU cannot allocate arrays."""


def beams(sonar: Sonar, hull: Hull) -> Array:
    """Return origin and direction of every beam of the sonar in the body, from port to starboard.

    The beams point away from the hull's centre, level in the body, and start at its surface.  A range is
    therefore the distance to a contact.

    Args:
        sonar: Angle, spacing and reach of the beams.
        hull: Ellipsoid that carries the sonar.

    Returns:
        Origin x y z [m] and unit direction x y z of every beam in the body (15, 6), FRD.
    """
    number = np.linspace(-1.0, 1.0, BEAMS)
    azimuth = 0.5 * sonar.fan * np.sign(number) * np.abs(number) ** sonar.crowding
    way = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(BEAMS)])
    skin = 1.0 / np.hypot(way[:, 0] / (0.5 * hull.length), way[:, 1] / (0.5 * hull.width))
    return np.column_stack([np.asarray(hull.center) + skin[:, None] * way, way])


@kernel
def range_kernel(origin: Point, ray: Point, tank: Array, pillars: Array, reach: float) -> float:
    """Return the distance [m] along a ray to the first wall, floor or pillar; at most `reach`.

    The water's surface gives no echo.  From inside a pillar or outside the tank the distance is 0.

    Args:
        origin: x y z, NED [m].
        ray: Direction, NED, a unit vector.
        tank: Sizes of the tank from `rl.environment.geometry.tank`.
        pillars: x y of the pillars' axes (P, 2) [m], NaN in unused rows, which come last.
        reach: Greatest range [m].
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
        if math.isnan(pillars[i, 0]):
            break
        x, y = origin[0] - pillars[i, 0], origin[1] - pillars[i, 1]
        toward = x * ray[0] + y * ray[1]
        outside = x * x + y * y - tank[RADIUS] * tank[RADIUS]
        if outside <= 0.0:
            nearest = 0.0
        elif toward < 0.0:
            hit = toward * toward - level * outside
            if hit > 0.0:
                nearest = min(nearest, outside / (-toward + math.sqrt(hit)))
    return max(nearest, 0.0)


@kernel
def sonar_kernel(beam: Array, reach: float, tank: Array, position: Array, R: Array, pillars: Array) -> float:
    """Return the range of one beam of a vehicle [m].

    Args:
        beam: Origin [m] and unit direction of the beam in the body (6,), FRD.
        reach: Greatest range [m].
        tank: Sizes of the tank from `rl.environment.geometry.tank`.
        position: Position of CO (3,), NED [m].
        R: Rotation from body to NED, flat (9,).
        pillars: x y of the pillars' axes (P, 2) [m], NaN in unused rows, which come last.
    """
    here = position[0], position[1], position[2]
    origin, ray = displaced(here, R, beam[:3]), displaced((0.0, 0.0, 0.0), R, beam[3:])
    return float(range_kernel(origin, ray, tank, pillars, reach))


@kernel
def displaced(point: Point, R: Array, vector: Array) -> tuple[float, float, float]:
    """Return a point moved by a vector in body axes, NED [m].

    Args:
        point: North, east and down of the point [m].
        R: Rotation from body to NED, flat (9,).
        vector: Displacement in body axes (3,) [m].
    """
    x, y, z = vector[0], vector[1], vector[2]
    return (
        point[0] + R[0] * x + R[1] * y + R[2] * z,
        point[1] + R[3] * x + R[4] * y + R[5] * z,
        point[2] + R[6] * x + R[7] * y + R[8] * z,
    )
