"""Physically plausible ranges of a vehicle's parameters; values outside often imitate another effect.

The ranges follow from the vehicle's weight, displacement and the box of its hull.  They are generous: a value
inside may be wrong, but a value outside is reported.  Ranges of parameters that are added to a value of the
file contain 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array
from hydro.core.vehicle.description import Vehicle

Index = tuple[int, ...]
Range = Callable[[Index, Vehicle], tuple[float, float]]

MOST_DRAG = 2.5
"""Maximum drag coefficient of a bluff body or an open frame; slender bodies have 0.1."""
BOOMS = 2.0
"""Distance from CO, in half lengths of the box, at which fins, frames and booms still have drag."""
MOST_ADDED = 3.0
"""Maximum of added over displaced mass, for plates and frames; a sphere has 0.5, a long cylinder 1."""
DRAG_SOURCE = "Hoerner (1965), chapter 3 (bluff bodies)"
ADDED_SOURCE = "Newman (1977), section 4.14 (ellipsoids and plates)"
LIFT_SLOPE = 2.0 * math.pi
"""Lift slope of a thin wing of infinite span, dC_L/d(angle of attack) [1/rad]."""


@dataclass(frozen=True)
class Plausible:
    """Plausible range of a parameter.

    Attributes:
        at: Function from the index of a component (an entry of the parameter's array, () for a number) and
            the vehicle to the minimum and maximum plausible value, in the parameter's unit.
        words: The range in words, with its unit if it has one.
        source: Publication or reason of the range.
    """

    at: Range
    words: str
    source: str


def between(low: float, high: float, unit: str, source: str) -> Plausible:
    """Return a plausible range that is the same for every vehicle and every component.

    Args:
        low: Minimum.
        high: Maximum.
        unit: Unit of both, or empty.
        source: Publication or reason of the range.
    """
    words = f"{low:g} to {high:g}" + (f" {unit}" if unit else "")
    return Plausible(lambda index, vehicle: (low, high), words, source)


def of_weight(share: float, words: str, source: str) -> Plausible:
    """Return the plausible range of a force: plus or minus a fraction of the vehicle's weight [N].

    Args:
        share: The fraction of the weight, such as 0.1.
        words: The range in words, for reports.
        source: Publication or reason of the range.
    """

    def at(index: Index, vehicle: Vehicle) -> tuple[float, float]:
        most = share * vehicle.rigid_body.mass * vehicle.environment.gravity
        return -most, most

    return Plausible(at, words, source)


def within_box(times: float, words: str, source: str, axis: int | None = None) -> Plausible:
    """Return the plausible range of a coordinate of a point on the vehicle, on either side of CO [m].

    Args:
        times: Greatest distance in half lengths of the hull's box.
        words: The range in words, for reports.
        source: Publication or reason of the range.
        axis: Axis of the coordinate, 0 to 2 for x, y, z; by default the last index of the component.
    """

    def at(index: Index, vehicle: Vehicle) -> tuple[float, float]:
        reach = times * _half(vehicle)[index[-1] if axis is None else axis]
        return -float(reach), float(reach)

    return Plausible(at, words, source)


def symmetric(most: Callable[[Vehicle], Array]) -> Range:
    """Return a function that gives the plausible range of each entry of a symmetric 6 x 6 matrix.

    In a positive semi-definite matrix, an off-diagonal entry is at most the geometric mean of the two
    diagonal entries in its row and column (Cauchy-Schwarz).

    Args:
        most: Function from a vehicle to the maxima of the diagonal, (6,).

    Returns:
        Function from the index (row, column) of an entry and a vehicle to the entry's minimum and maximum.
    """

    def at(index: Index, vehicle: Vehicle) -> tuple[float, float]:
        diagonal = most(vehicle)
        i, j = index[0], index[-1]
        if i == j:
            return 0.0, float(diagonal[i])
        bound = math.sqrt(diagonal[i] * diagonal[j])
        return -bound, bound

    return at


def of_entry(range_: Range, i: int, j: int) -> Range:
    """Return a function that gives the plausible range of a parameter that is one entry of a matrix.

    Args:
        range_: Function that gives the range of an entry, such as the result of `symmetric`.
        i: Row of the entry.
        j: Column of the entry.

    Returns:
        Function from an index, which is ignored, and a vehicle to the entry's minimum and maximum.
    """
    return lambda index, vehicle: range_((i, j), vehicle)


def most_drag(vehicle: Vehicle) -> Array:
    """Return the maximum drag of the hull's box at 1 m/s along, or 1 rad/s about, each axis, (6,) [N, N m].

    It is 1/2 rho C_d A with the water density rho, C_d = MOST_DRAG and the area A.  At this speed a linear, a
    quadratic and a cubic damping coefficient are the same number.
    """
    sides = 2.0 * _half(vehicle)
    pressure = 0.5 * MOST_DRAG * vehicle.environment.water_density
    areas = np.array([sides[(i + 1) % 3] * sides[(i + 2) % 3] for i in range(3)])
    arms = BOOMS**3 * _half(vehicle) ** 4 / 2.0  # int |r|^3 dr over a face, the same area farther out
    turned = np.array([sides[i] * (arms[(i + 1) % 3] + arms[(i + 2) % 3]) for i in range(3)])
    return np.asarray(pressure * np.concatenate([areas, turned]))


def most_cross_drag(vehicle: Vehicle) -> Array:
    """Return the maximum coefficient of a drag along each axis that grows with the speed across, (6,).

    The drag is the coefficient times the speed across the axis times the velocity along it.  The coefficient
    is that of the hull's box, 1/2 rho C_d A for a force and 1/2 rho C_d int r^2 dA for a moment, with the
    water density rho, C_d = MOST_DRAG, the area A and the lever arm r.
    """
    sides = 2.0 * _half(vehicle)
    pressure = 0.5 * MOST_DRAG * vehicle.environment.water_density
    arms = BOOMS**2 * _half(vehicle) ** 3 * 2.0 / 3.0
    turned = [sides[i] * (arms[(i + 1) % 3] + arms[(i + 2) % 3]) for i in range(3)]
    return np.concatenate([most_drag(vehicle)[:3], pressure * np.array(turned)])


def most_added(vehicle: Vehicle) -> Array:
    """Return the maximum added mass along, and added inertia about, each axis, (6,) [kg, kg m^2].

    It is MOST_ADDED times the displaced mass, or times the inertia about CO of the displaced water, spread
    over the hull's box.
    """
    mass, sides = displaced_mass(vehicle), 2.0 * _half(vehicle)
    center = np.array(vehicle.hull.center)
    square = sides**2 / 12.0 + center**2
    turned = [mass * (square[(i + 1) % 3] + square[(i + 2) % 3]) for i in range(3)]
    return MOST_ADDED * np.concatenate([np.full(3, mass), turned])


def most_lift(vehicle: Vehicle) -> Array:
    """Return the maximum lift coefficients of the hull's side and of its bottom, (2,) [kg/m].

    The lift is the coefficient times the speed times the velocity across the surface.  The maximum is 1/2 rho
    2 pi A, with the water density rho and the area A: the lift slope of a thin wing is 2 pi.
    """
    length, width, height = 2.0 * _half(vehicle)
    pressure = 0.5 * vehicle.environment.water_density * LIFT_SLOPE
    return np.array([pressure * length * height, pressure * length * width])


def displaced_mass(vehicle: Vehicle) -> float:
    """Return the mass of the displaced water [kg]; the vehicle's mass if its file gives no buoyancy."""
    return vehicle.buoyancy.force / vehicle.environment.gravity or vehicle.rigid_body.mass


def _half(vehicle: Vehicle) -> Array:
    """Return the half lengths of the hull's box [m], (3,)."""
    return 0.5 * np.array([vehicle.hull.length, vehicle.hull.width, vehicle.hull.height])


HULL_DRAG = Plausible(
    symmetric(most_drag),
    "up to the drag of the hull's box at 1 m/s or 1 rad/s with C_d 2.5",
    DRAG_SOURCE,
)
ADDED_INERTIA = Plausible(
    symmetric(most_added),
    "up to 3 times the displaced mass, and the inertia of as much water in the hull's box",
    ADDED_SOURCE,
)
