"""Warnings about values of a vehicle file, or of a recording's clock, that are likely in another unit.

`vehicle.plausible` bounds the parameters of effects by the vehicle.  Here the vehicle itself is checked, by
wide bounds that hold for every vehicle in water: fresh water and the Dead Sea, a hand-sized robot and a rig.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST, thruster_table

DENSITY = (900.0, 1300.0)
"""Density of water [kg/m^3]: hot fresh water has 958, the Dead Sea 1240."""
GRAVITY = (9.7, 9.9)
"""Gravity at the Earth's surface [m/s^2]: 9.78 at the equator, 9.83 at the poles."""
MASS = (0.01, 1e8)
"""Mass of a vehicle [kg]: from a hand-sized robot to the largest submarines, 5e7."""
LENGTH = (0.02, 300.0)
"""Sides of a hull [m]: from a hand-sized robot to the largest submarines, 175."""
FILLED = (0.02, 3.0)
"""Mass over that of the water in the hull's box: frames have a fifth, bodies 0.5 to 1, landers up to 2."""
UNBALANCE = 0.3
"""Maximum difference of buoyancy and weight over weight: free vehicles keep within 0.05, crawlers 0.2."""
THRUST = (1e-4, 10.0)
"""Sum of all thrusts over the weight: small ROVs have 4, a glider 1e-2."""
INERTIA = (1e-3, 2.0)
"""Sum of the moments of inertia over m d^2/2, m the mass, d the box's diagonal: 1 for mass at corners."""
REACH = 3.0
"""Maximum distance of thrusters and centres from the box's middle over its diagonal; includes booms."""
RATE = (0.5, 2000.0)
"""Rows of a recording per second: fewer show no motion of a vehicle, and no sensor gives more."""


def doubts(vehicle: Vehicle) -> list[str]:
    """Return one sentence of warning for each value of a vehicle that is likely in another unit.

    Usually none. Relations between values are checked only if each value alone is possible.
    """
    alone = list(_alone(vehicle))
    together = [] if alone else list(_together(vehicle))
    none = [] if vehicle.thruster else ["thruster: there is none: no command can move this vehicle"]
    return [*alone, *together, *none]


def sampling(step: float) -> str:
    """Return a warning if the sample time of a recording is likely in another unit; else an empty string.

    Args:
        step: Sample time [s].
    """
    low, high = RATE
    if low <= 1.0 / step <= high:
        return ""
    unit = "milliseconds" if step > 1.0 else "minutes"
    return f"t steps by {step:.3g} s, {1.0 / step:.3g} rows per second: is it in seconds, or in {unit}?"


def _alone(vehicle: Vehicle) -> Iterator[str]:
    """Yield warnings about single values, each against its own bounds."""
    water, body, hull = vehicle.environment, vehicle.rigid_body, vehicle.hull
    if _beyond(water.water_density, DENSITY):
        yield (
            f"environment.water_density is {water.water_density:g} kg/m^3; water has 958 to 1240"
            f"{_hint(water.water_density, DENSITY, {'g/cm^3 or t/m^3': 1e3})}"
        )
    if _beyond(water.gravity, GRAVITY):
        yield (
            f"environment.gravity is {water.gravity:g} m/s^2; the Earth has 9.78 to 9.83"
            f"{_hint(water.gravity, GRAVITY, {'g': 9.81, 'cm/s^2': 0.01})}"
        )
    if _beyond(body.mass, MASS):
        units = {"t": 1e3} if body.mass < 1.0 else {"g": 1e-3, "mg": 1e-6}
        yield f"rigid_body.mass is {body.mass:g} kg{_hint(body.mass, MASS, units)}"
    for name in ("length", "width", "height"):
        if _beyond(size := getattr(hull, name), LENGTH):
            units = {"km": 1e3} if size < 1.0 else {"mm": 1e-3, "cm": 1e-2}
            yield f"hull.{name} is {size:g} m{_hint(size, LENGTH, units)}"


def _together(vehicle: Vehicle) -> Iterator[str]:
    """Yield warnings about values that contradict each other."""
    water, body, hull = vehicle.environment, vehicle.rigid_body, vehicle.hull
    sides = np.array([hull.length, hull.width, hull.height])
    weight, diagonal = body.mass * water.gravity, float(np.linalg.norm(sides))
    filled = body.mass / (water.water_density * float(np.prod(sides)))
    if _beyond(filled, FILLED):
        yield (
            f"rigid_body.mass is {filled:.3g} times that of the water in the hull's box: "
            "is mass in kg, and are the hull's lengths in m?"
        )
    yield from _balance(vehicle.buoyancy.force, body.mass, weight)
    spread = float(np.trace(np.array(body.inertia))) / (0.5 * body.mass * diagonal**2)
    if _beyond(spread, INERTIA):
        yield (
            f"rigid_body.inertia is {spread:.3g} times that of the mass at the corners of the hull's box: "
            "is it in kg m^2?"
        )
    points = {
        "rigid_body.center_of_gravity": body.center_of_gravity,
        "buoyancy.center": vehicle.buoyancy.center,
    }
    points |= {
        f"thruster[{i}].position": one.position for i, one in enumerate(vehicle.thruster) if one.position
    }
    for path, point in points.items():
        if (away := math.dist(point, hull.center)) > REACH * diagonal:
            yield f"{path} is {away:.3g} m from the hull's middle: is it in m, or in mm?"
    if vehicle.thruster:
        table = thruster_table(vehicle)
        thrust = float(np.maximum(table[:, MAX_THRUST], table[:, MAX_REVERSE]).sum())
        if _beyond(thrust / weight, THRUST):
            yield (
                f"thruster: all together push with {thrust:.3g} N, {thrust / weight:.3g} times the weight: "
                "is max_thrust in N?"
            )


def _balance(force: float, mass: float, weight: float) -> Iterator[str]:
    """Yield a warning if buoyancy is far from the weight; a force of 0 means that the file does not give it.

    Args:
        force: Buoyant force [N].
        mass: Mass [kg].
        weight: Weight [N].
    """
    if force and abs(force - weight) > UNBALANCE * weight:
        kilograms = abs(force - mass) <= UNBALANCE * mass
        unit = "is it in kg? it is a force, in N" if kilograms else "is mass in kg, and force in N?"
        yield f"buoyancy.force is {force:.4g} N and the weight {weight:.4g} N: {unit}"


def _beyond(value: float, bounds: tuple[float, float]) -> bool:
    return not bounds[0] <= value <= bounds[1]


def _hint(value: float, bounds: tuple[float, float], units: dict[str, float]) -> str:
    """Return the end of a warning: the unit in which a value would be possible, and the value to write.

    Args:
        value: The value in the file.
        bounds: Possible range.
        units: Size of other units in the file's unit, by name.
    """
    for unit, size in units.items():
        if not _beyond(value * size, bounds):
            return f": is it in {unit}? write {value * size:g}"
    return ": check the number and its unit"
