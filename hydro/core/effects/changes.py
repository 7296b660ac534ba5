"""Changes of a vehicle that its file does not include: a current, a payload, a weak thruster.

Each change adds one table of the catalogue's effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from hydro.core.columns import Array
from hydro.core.effects.catalogue import thruster_table
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import GAIN


def in_current(vehicle: Vehicle, velocity: Array) -> Vehicle:
    """Return a copy of a vehicle in water that moves faster by a given velocity.

    Args:
        vehicle: The vehicle.
        velocity: Velocity that is added to the current of the file, NED, (3,) [m/s].
    """
    north, east, down = map(float, velocity)
    return _with(vehicle, {"name": "ocean_current", "v_N": north, "v_E": east, "v_D": down})


def with_payload(vehicle: Vehicle, mass: float, weight: float, place: Sequence[float]) -> Vehicle:
    """Return a copy of a vehicle with a payload added.

    Args:
        vehicle: The vehicle.
        mass: Dry mass [kg].
        weight: Weight in water [N].
        place: x y z from CO (3,), FRD [m].
    """
    x, y, z = map(float, place)
    return _with(
        vehicle, {"name": "payload", "mass": float(mass), "w": float(weight), "x": x, "y": y, "z": z}
    )


def weakened(vehicle: Vehicle, thruster: int, loss: float) -> Vehicle:
    """Return a copy of a vehicle with one weakened thruster.

    Args:
        vehicle: The vehicle.
        thruster: Index of the thruster, from 0.
        loss: Lost fraction of its present thrust; 1 for a dead thruster.
    """
    gains = [0.0] * len(vehicle.thruster)
    gains[thruster] = -loss * (1.0 + float(thruster_table(vehicle)[thruster, GAIN]))
    return _with(vehicle, {"name": "thruster_gain", "g": gains})


def _with(vehicle: Vehicle, table: Mapping[str, Any]) -> Vehicle:
    return msgspec.structs.replace(vehicle, effect=(*vehicle.effect, dict(table)))
