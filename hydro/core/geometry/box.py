"""Added mass of a rectangular box in an unbounded ideal fluid, from tables for plates and rectangles.

The source is DNV-RP-C205 (2010), appendix D.  Table D-1 has two-dimensional rectangles: added mass per length
and added moment of inertia.  Table D-2 has rectangular plates, broadside on.  No table has boxes of three
unequal sides, so each axis combines two table values (rho is the water density):

    along an axis    rho C_plate(q/p) pi/4 p^2 q C_rect(d/p)/C_rect(0), face p x q (p <= q), depth d
    about an axis    rho pi beta(a/b) a^4 s R, section 2a x 2b (a >= b), length s along the axis

R, the reduction by the ends, is that of an ellipsoid of the same sides (Lamb's k-factor over that of the
elliptic cylinder).  Compared with boundary element solutions of boxes with sides up to 1 : 4, the error is up
to 20 % along the axes and 30 % about them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.vehicle.ellipsoid import lamb_factors

PLATE = (
    (1.0, 1.25, 1.5, 1.59, 2.0, 2.5, 3.0, 3.17, 4.0, 5.0, 6.25, 8.0, 10.0, 100.0),
    (0.579, 0.642, 0.69, 0.704, 0.757, 0.801, 0.83, 0.84, 0.872, 0.897, 0.917, 0.934, 0.947, 1.0),
)
"""C_A of a rectangular plate by the ratio of its sides q/p, relative to rho pi/4 p^2 q; table D-2."""
RECTANGLE = (
    (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0),
    (1.0, 1.14, 1.21, 1.36, 1.51, 1.70, 1.98, 2.23),
)
"""C_A of a rectangle by its depth along the motion over its width, over rho pi (width/2)^2; table D-1."""
TURNED = ((1.0, 2.0, 5.0, 100.0), (0.234, 0.15, 0.15, 0.125))
"""beta of a rectangle that turns about its middle by the ratio of its sides, over rho pi a^4; table D-1."""
NUDGE = 0.02
"""Minimum relative difference of two sides: a cylinder of round section has no added inertia."""


def box_added_mass(sides: Sequence[float], density: float) -> Array:
    """Return the added mass of a solid box about the centre of the box.

    Args:
        sides: Length, width, height [m] along body x, y, z.
        density: Water density [kg/m^3].

    Returns:
        Diagonal of the added-mass matrix, (6,) [kg, kg m^2]; all other entries are 0 by symmetry.

    Raises:
        DataError: A side is not a positive finite number.
    """
    size = checked_sides(sides)
    along = [_along(size[i], size[(i + 1) % 3], size[(i + 2) % 3]) for i in range(3)]
    about = [_about(size[i], size[(i + 1) % 3], size[(i + 2) % 3]) for i in range(3)]
    return density * np.array([*along, *about])


def checked_sides(sides: Sequence[float]) -> Array:
    """Return length, width and height as an array, (3,) [m], after a check.

    Args:
        sides: Length, width, height [m].

    Raises:
        DataError: A side is not a positive finite number.
    """
    size = np.array([float(side) for side in sides])
    if size.shape != (3,) or not np.all(np.isfinite(size)) or size.min() <= 0.0:
        raise DataError(
            f"a hull's box needs positive, finite length, width and height in metres, not {size.tolist()}"
        )
    return size


def _along(depth: float, one: float, other: float) -> float:
    """Return the added mass over density [m^3] of a box that moves along its side `depth`; sides in [m]."""
    p, q = min(one, other), max(one, other)
    plate = np.interp(np.log(q / p), np.log(PLATE[0]), PLATE[1])
    return float(plate * np.pi / 4.0 * p * p * q * np.interp(depth / p, *RECTANGLE))


def _about(length: float, one: float, other: float) -> float:
    """Return the added inertia over density [m^5] of a box about its side `length`, reduced for its ends."""
    a, b = max(one, other) / 2.0, min(one, other) / 2.0
    section = np.pi * np.interp(np.log(a / b), np.log(TURNED[0]), TURNED[1]) * a**4
    return float(section * length * _ends(length / 2.0, a, b))


def _ends(half: float, a: float, b: float) -> float:
    """Return the ratio of the added inertia of an ellipsoid to that of an infinite elliptic cylinder.

    Args:
        half: Semi-axis of the ellipsoid along the axis of rotation [m].
        a: Larger semi-axis of the section [m].
        b: Smaller semi-axis of the section [m].
    """
    b = min(b, a * (1.0 - NUDGE))
    cylinder = (a * a - b * b) ** 2 / (2.0 * a * b * (a * a + b * b))
    return float(lamb_factors((half, a, b))[3] / cylinder)
