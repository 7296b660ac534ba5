"""Units as powers of kilogram, metre, second and radian, and the significant size of a quantity of a unit.

A size is significant if its effect is obvious: a third of the vehicle's mass or length, a hundredth of its
weight.  It follows from the dimension alone, with the vehicle's mass m, mean moment of inertia J and length
L, at speeds about 1 m/s.  Remaining powers of metres and seconds count as 1.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hydro.core.vehicle.description import Vehicle

Size = float | Callable[[Vehicle], float]
"""Significant size, or a rule for it."""


class Dimension(NamedTuple):
    """Dimension of a unit as powers of the base units.

    Attributes:
        mass: Power of kg.
        length: Power of m.
        time: Power of s.
        angle: Power of rad.
    """

    mass: int = 0
    length: int = 0
    time: int = 0
    angle: int = 0


BASE = {
    "1": Dimension(),
    "kg": Dimension(mass=1),
    "m": Dimension(length=1),
    "s": Dimension(time=1),
    "rad": Dimension(angle=1),
    "N": Dimension(mass=1, length=1, time=-2),
}


def dimension(unit: str) -> Dimension:
    """Return the powers of kg, m, s and rad in a unit such as `N s^3/m^3`.

    Args:
        unit: Factors separated by blanks, divisors after a slash.

    Raises:
        ValueError: A factor is not one of `BASE` with a whole exponent.
    """
    total = np.zeros(4, int)
    for place, part in enumerate(unit.split("/")):
        for factor in part.split() or [""]:
            read = re.fullmatch(r"(\w+)(?:\^(\d+))?", factor)
            if read is None or read[1] not in BASE:
                raise ValueError(f"unit {unit!r}: {factor!r} is none of {', '.join(BASE)} with a whole power")
            total += (-1 if place else 1) * int(read[2] or "1") * np.array(BASE[read[1]])
    return Dimension(*(int(power) for power in total))


def plain_size(unit: str, vehicle: Vehicle) -> float:
    """Return the significant size of a quantity with a given unit, for a vehicle.

    With the vehicle's mass m and mean moment of inertia J, inertia and damping of the unit kg m^b s^c scale
    with m for b <= 0, sqrt(m J) for b = 1 and J for b = 2.  Static forces scale with the weight, lengths with
    the hull's length.

    Args:
        unit: Unit as in the catalogue, such as `N s/m`.
        vehicle: The vehicle.

    Returns:
        The size, in that unit.
    """
    mass, length, time, angle = dimension(unit)
    if mass == 1 and time == -2:
        return of_weight(0.01)(vehicle) * vehicle.hull.length ** (length - 1)
    if mass:
        return 0.3 * _inertia(max(length, 0), vehicle) ** mass
    if time:
        return 0.1 if time > 0 else 0.2
    return float((0.1 if angle else 0.3) * vehicle.hull.length**length)


def of_mass(share: float) -> Size:
    """Return a function from a vehicle to a size [kg], `share` times the vehicle's mass."""
    return lambda vehicle: share * _inertia(0, vehicle)


def of_mixed(share: float) -> Size:
    """Return a function from a vehicle to a size [kg m], `share` times sqrt(m J).

    m is the vehicle's mass, J its mean moment of inertia.  This is the significant size of couplings between
    a force and a moment.
    """
    return lambda vehicle: share * _inertia(1, vehicle)


def of_moment(share: float) -> Size:
    """Return a function from a vehicle to a size [kg m^2], `share` times its mean moment of inertia."""
    return lambda vehicle: share * _inertia(2, vehicle)


def of_weight(share: float) -> Callable[[Vehicle], float]:
    """Return a function from a vehicle to a size [N], `share` times the vehicle's weight."""
    return lambda vehicle: share * vehicle.rigid_body.mass * vehicle.environment.gravity


def _inertia(length: int, vehicle: Vehicle) -> float:
    """Return the vehicle's inertia in kg m^length: m, sqrt(m J), J, then by the radius of gyration."""
    m, J = vehicle.rigid_body.mass, float(np.trace(np.array(vehicle.rigid_body.inertia))) / 3.0
    if length < 2:
        return float(np.sqrt(m * J)) if length else m
    return float(J * (J / m) ** (0.5 * (length - 2)))
