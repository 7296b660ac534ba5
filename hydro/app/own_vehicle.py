"""Vehicle file from mass, size and thrusters, for a recording whose vehicle has no file yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hydro.core.errors import DataError
from hydro.core.geometry.estimate import Known, estimate
from hydro.core.geometry.layouts import LAYOUTS, Layout, driven, laid_out, parsed
from hydro.core.guessing.vehicle_choice import BLUEROV2, Hull, layouts_thrusters
from hydro.core.vehicle.names import usable_name
from hydro.io import new_vehicle
from hydro.io import vehicle as vehicles

ANY_THRUST = 1.0
"""Thrust of a layout [N] before the curve of the T200 replaces it."""
VOLTAGE = 16.0
"""Nominal supply voltage of T200 thrusters [V], as `hydro vehicle new` assumes."""


def layouts_with(thrusters: int) -> list[Layout]:
    """Return the known thruster layouts with a number of thrusters; all layouts if none has this number."""
    fitting = [one for one in LAYOUTS if layouts_thrusters(one) == thrusters]
    return fitting or [one for one in LAYOUTS if layouts_thrusters(one)]


def usual_hull(thrusters: int) -> Hull | None:
    """Return mass and size of the usual vehicle with this number of thrusters; None if none is known."""
    return BLUEROV2.hull if thrusters == BLUEROV2.thrusters else None


def write_estimated(path: Path, hull: Hull, layout: str, thrusters: Sequence[str] = ()) -> str:
    """Write a vehicle file estimated from mass, size and thrusters, and return its path.

    Args:
        path: The file; it must not exist.
        hull: Mass, box and maximum thrust; without a thrust the thrusters are T200s.
        layout: Layout of the thrusters; ignored if thrusters are given.
        thrusters: Each thruster as `x,y,z,dx,dy,dz,max`: position [m], direction and maximum thrust [N].

    Raises:
        DataError: The file exists, or a value is invalid.
    """
    if path.exists():
        raise DataError(f"{path.name}: the file exists already: choose another name")
    if thrusters:
        placed = parsed(thrusters)
    else:
        placed = laid_out(layout, hull.thrust or ANY_THRUST, hull.sides)  # type: ignore[arg-type]
        placed = driven(placed, None if hull.thrust else "t200", None)
    known = Known(name=usable_name(path.stem), mass=hull.mass, sides=hull.sides, thrusters=placed)
    if any(one.curve == "t200" for one in placed):
        known = replace(known, voltage=VOLTAGE)
    text = new_vehicle.text(estimate(known))
    vehicles.parse(text, path.name)
    vehicles.write(text, path)
    return str(path)
