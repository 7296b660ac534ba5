"""Effects that are laws of the hull's forces, such as drag, lift and added mass.

No formula describes a hull exactly.  In one recording, a hull law may only describe the error of the
file's drag.  So where no model reaches the noise, other rules apply to a hull law than to weight,
thrust, current or a sensor.
"""

from __future__ import annotations

from hydro.core.effects.catalogue import CATALOGUE, with_role
from hydro.core.effects.record import Role
from hydro.core.vehicle.description import Vehicle

DRAG = frozenset(with_role(Role.DRAG))
"""Effects that are drag which grows faster than speed."""
HULLS = ("inertia", "damping", "hull", "memory")
"""Families of effects that are hull laws."""


def is_hull_law(effect: str) -> bool:
    """Return whether an effect is a law of the hull's forces."""
    return CATALOGUE[effect].family in HULLS


def has_drag(file: Vehicle) -> bool:
    """Return whether a file has drag that grows faster than speed."""
    return any(file.effects(name) for name in DRAG)
