"""Collision test of a hull with walls, floor, surface and pillars.

The hull is the ellipsoid of the vehicle file's size, as in MuJoCo.
"""

from __future__ import annotations

import math

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.vehicle.description import Hull
from hydro.rl.world.config import World

LENGTH, WIDTH, FLOOR, RADIUS = range(4)
"""Columns of the tank's numbers: its far walls, its floor, and the radius of its pillars [m]."""

_ROUNDS = 60  # bisections that find the distance to an ellipse to machine precision


def tank(world: World) -> Array:
    """Return the sizes of the tank as one array (4,) [m]: length, width, depth, radius of the pillars."""
    return np.array([world.length, world.width, world.depth, world.pillar_radius])


def hull_numbers(hull: Hull) -> Array:
    """Return the hull's ellipsoid in body axes as one array (6,) [m]: centre x y z, three semi-axes."""
    return np.array([*hull.center, 0.5 * hull.length, 0.5 * hull.width, 0.5 * hull.height])


@kernel
def collision_kernel(hull: Array, tank: Array, position: Array, R: Array, pillars: Array) -> bool:
    """Return whether a hull touches a wall, the floor, the surface or a pillar.

    Args:
        hull: From `hull_numbers`.
        tank: From `tank`.
        position: Position of CO (3,), NED [m].
        R: Rotation from body to NED (9,).
        pillars: x y of the pillars' axes (P, 2), NaN in unused rows, which come last.
    """
    for i in range(3):
        center, extent = projection_kernel(hull, position, R, i)
        far = tank[LENGTH] if i == 0 else tank[WIDTH] if i == 1 else tank[FLOOR]
        if center - extent <= 0.0 or center + extent >= far:
            return True
    north, long = projection_kernel(hull, position, R, 0)
    east, wide = projection_kernel(hull, position, R, 1)
    for i in range(pillars.shape[0]):
        if math.isnan(pillars[i, 0]):
            break
        x, y = pillars[i, 0] - north, pillars[i, 1] - east
        near = abs(x) < long + tank[RADIUS] and abs(y) < wide + tank[RADIUS]
        if near and line_distance(hull, R, x, y) <= tank[RADIUS]:
            return True
    return False


@kernel
def projection_kernel(hull: Array, position: Array, R: Array, axis: int) -> tuple[float, float]:
    """Return the centre [m] and the half length [m] of an ellipsoidal hull's projection on a world axis.

    Args:
        hull: From `hull_numbers`.
        position: Position of CO (3,), NED [m].
        R: Rotation from body to NED, flat (9,).
        axis: World axis: 0 north, 1 east, 2 down.
    """
    row = R[3 * axis : 3 * axis + 3]
    center = position[axis] + row[0] * hull[0] + row[1] * hull[1] + row[2] * hull[2]
    extent = math.sqrt((row[0] * hull[3]) ** 2 + (row[1] * hull[4]) ** 2 + (row[2] * hull[5]) ** 2)
    return center, extent


@kernel
def line_distance(hull: Array, R: Array, x: float, y: float) -> float:
    """Return the horizontal distance [m] from an ellipsoidal hull to a vertical line.

    0 if the line pierces it. The result is the distance of the point (x, y) from the ellipsoid's projection
    on the horizontal plane. That projection is the ellipse q^T S^-1 q = 1 of horizontal vectors q [m], where
    S is the sum of a_i^2 r_i r_i^T over the three semi-axes a_i [m], and r_i are the horizontal parts of the
    body's axes.

    Args:
        hull: Ellipsoid; its entries 3 to 5 are the semi-axes [m].
        R: Rotation from body to world, flat, (9,).
        x: Place of the line relative to the hull's centre, north [m].
        y: Place of the line relative to the hull's centre, east [m].
    """
    xx = xy = yy = 0.0
    for i in range(3):
        a, b = R[i] * hull[3 + i], R[3 + i] * hull[3 + i]
        xx, xy, yy = xx + a * a, xy + a * b, yy + b * b
    # Principal axes of the ellipse: squares of its semi-axes, and the point in these axes.
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
