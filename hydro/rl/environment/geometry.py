"""What a hull can touch: walls, floor and pillars; and the surface, which it is not to break.

The hull is the ellipsoid of the vehicle file's size, as it is in MuJoCo.
"""

from __future__ import annotations

import math

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.vehicle.description import Hull
from hydro.rl.world.config import World

LENGTH, WIDTH, FLOOR, RADIUS = range(4)
"""Where the tank's numbers stand: its far walls, its floor, and the radius of its pillars [m]."""

_ROUNDS = 60  # bisections: the distance to an ellipse to the last digit


def tank(world: World) -> Array:
    """The tank's numbers, (4,)."""
    return np.array([world.length, world.width, world.depth, world.pillar_radius])


def hull_numbers(hull: Hull) -> Array:
    """Centre and semi-axes of the hull's ellipsoid in the body, (6,) [m]."""
    return np.array([*hull.center, 0.5 * hull.length, 0.5 * hull.width, 0.5 * hull.height])


@kernel
def collision_kernel(hull: Array, tank: Array, position: Array, R: Array, pillars: Array) -> bool:
    """Whether a hull touches a wall, the floor, the surface or a pillar.

    Args:
        hull: From `hull_numbers`.
        tank: From `tank`.
        position: Of CO (3,), NED.
        R: Body to NED (9,).
        pillars: x y of their axes (P, 2), NaN where there is none.
    """
    for i in range(3):
        center, extent = shadow_kernel(hull, position, R, i)
        far = tank[LENGTH] if i == 0 else tank[WIDTH] if i == 1 else tank[FLOOR]
        if center - extent <= 0.0 or center + extent >= far:
            return True
    north, long = shadow_kernel(hull, position, R, 0)
    east, wide = shadow_kernel(hull, position, R, 1)
    for i in range(pillars.shape[0]):
        x, y = pillars[i, 0] - north, pillars[i, 1] - east
        near = abs(x) < long + tank[RADIUS] and abs(y) < wide + tank[RADIUS]
        if near and shadow_distance(hull, R, x, y) <= tank[RADIUS]:
            return True
    return False


@kernel
def shadow_kernel(hull: Array, position: Array, R: Array, axis: int) -> tuple[float, float]:
    """Middle of a hull's shadow on an axis of the world, and half its length: the support of an ellipsoid."""
    row = R[3 * axis : 3 * axis + 3]
    center = position[axis] + row[0] * hull[0] + row[1] * hull[1] + row[2] * hull[2]
    extent = math.sqrt((row[0] * hull[3]) ** 2 + (row[1] * hull[4]) ** 2 + (row[2] * hull[5]) ** 2)
    return center, extent


@kernel
def shadow_distance(hull: Array, R: Array, x: float, y: float) -> float:
    """Horizontal distance [m] from the hull to a vertical line at (x, y) from its centre; 0 if pierced.

    A vertical line is as far from an ellipsoid as its foot from the ellipsoid's shadow from above: the
    ellipse z^T S^-1 z = 1 with S = sum of a_i^2 r_i r_i^T, r_i the horizontal parts of the body's axes.
    """
    xx = xy = yy = 0.0
    for i in range(3):
        a, b = R[i] * hull[3 + i], R[3 + i] * hull[3 + i]
        xx, xy, yy = xx + a * a, xy + a * b, yy + b * b
    # Principal axes of the ellipse: squares of its semi-axes, and the point in them.
    half, spread = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    long, short = half + spread, half - spread
    turn = 0.5 * math.atan2(2.0 * xy, xx - yy)
    u = abs(math.cos(turn) * x + math.sin(turn) * y)
    v = abs(-math.sin(turn) * x + math.cos(turn) * y)
    if u * u / long + v * v / short <= 1.0:
        return 0.0
    # The nearest point is (u A/(A + t), v B/(B + t)) for the t >= 0 that puts it on the ellipse.
    low, high = 0.0, math.sqrt(long * u * u + short * v * v)
    for _ in range(_ROUNDS):
        t = 0.5 * (low + high)
        if long * (u / (long + t)) ** 2 + short * (v / (short + t)) ** 2 > 1.0:
            low = t
        else:
            high = t
    t = 0.5 * (low + high)
    return math.hypot(u * t / (long + t), v * t / (short + t))
