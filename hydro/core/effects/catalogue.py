"""The catalogue: all effects by name, and what a vehicle's list of them amounts to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hydro.core.effects import inertia
from hydro.core.effects.record import Array, Effect
from hydro.core.errors import DataError
from hydro.core.vehicle import Vehicle

FAMILIES = (inertia,)
CATALOGUE: dict[str, Effect] = {effect.name: effect for family in FAMILIES for effect in family.EFFECTS}


class Entry(NamedTuple):
    """One `[[effect]]` of a vehicle: its record, packed parameters and path in the file."""

    effect: Effect
    parameters: Array
    where: str


def entries(vehicle: Vehicle) -> list[Entry]:
    """The vehicle's effects with their parameters, in the order of the file.

    Raises:
        DataError: An unknown effect, or parameters that its record does not admit.
    """
    found = []
    for index, table in enumerate(vehicle.effect):
        name = table.get("name")
        where = f"effect[{index}]"
        if name not in CATALOGUE:
            raise DataError(f"{where}.name: {name!r} is not in the catalogue; it has {', '.join(CATALOGUE)}")
        effect = CATALOGUE[name]
        where = f"{where} ({name})"
        found.append(Entry(effect, effect.pack(table, thrusters=len(vehicle.thruster), where=where), where))
    return found


def inertia_matrix(vehicle: Vehicle) -> Array:
    """What the effects add to the mass matrix: added mass, its couplings and the dry mass of payloads.

    Args:
        vehicle: The vehicle.

    Returns:
        (6, 6) symmetric matrix about CO [kg, kg m, kg m^2].

    Raises:
        DataError: Parameters that the catalogue does not admit.
    """
    return _sum_of_inertia(vehicle, "inertia", "wrench")


def added_mass_matrix(vehicle: Vehicle) -> Array:
    """M_A, the inertia of the water alone: `inertia_matrix` without payloads. (6, 6)."""
    return _sum_of_inertia(vehicle, "inertia")


def _sum_of_inertia(vehicle: Vehicle, *kinds: str) -> Array:
    total = np.zeros((6, 6))
    for effect, parameters, _ in entries(vehicle):
        if effect.inertia is not None and effect.kind in kinds:
            effect.inertia(parameters, total)
    return total
