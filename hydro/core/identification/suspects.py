"""Candidate effects of the whole catalogue, as columns of a linear problem.

An effect that is linear in its parameters gives one column per parameter.  An effect with a nonlinear
parameter, such as the place of a tether's anchor, gives several candidates, each with that parameter fixed at
a value of a grid.  A fit of the effect starts from the best of these candidates.  An effect with a threshold
or delay also gives several candidates, each a finite change, not a derivative.  A coarse grid shows whether
an effect deserves a closer look; a fine grid (`shapes`) supplies initial values.  The record of an effect
defines its shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE
from hydro.core.effects.catalogue import wholly_known
from hydro.core.effects.hull_laws import has_drag
from hydro.core.effects.record import Role, Shapes
from hydro.core.prediction.parameters import effect_table, free
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Suspect:
    """Candidate effect, with its nonlinear parameters at fixed values, as columns of a linear problem.

    A column is the change of the residual by one parameter of the effect.

    Attributes:
        effect: Name in the catalogue.
        changed: For each column, the vehicle with a small change of one parameter.
        steps: For each column, the size of the change, as a multiple of the parameter's significant size.
        begin: Function from the fitted coefficients of the columns, (columns,), to the `[[effect]]` table
            from which a nonlinear fit starts.
    """

    effect: str
    changed: tuple[Vehicle, ...]
    steps: tuple[float, ...]
    begin: Callable[[Array], dict[str, Any]]


def suspects(
    vehicle: Vehicle,
    *,
    without: Sequence[str] = (),
    reach: Array | None = None,
    completing: bool = False,
) -> list[Suspect]:
    """Return candidates for all effects that a vehicle may lack, or that may have other values.

    Args:
        vehicle: The vehicle.
        without: Names of effects to exclude; by default none.
        reach: Positions [m] and times [s] of the recording, (N, 4), for the place of an anchor.
        completing: Whether to add drag laws of the whole hull to a vehicle that has drag already.
    """
    found: list[Suspect] = []
    for name in (one for each in CATALOGUE for one in vehicle.names(each) or (each,)):
        if name in without or wholly_known(vehicle, name):
            continue
        if not (completing or vehicle.effects(name)) and replaces_drag(vehicle, name):
            continue
        if CATALOGUE[name].is_random or (CATALOGUE[name].is_written and not vehicle.effects(name)):
            continue
        if is_curved(name) and not vehicle.effects(name):
            found += _shaped(vehicle, name, CATALOGUE[name].identification.coarse, reach)
        elif not is_curved(name):
            found.append(of_entries(vehicle, name, reach=reach))
    return found


def replaces_drag(vehicle: Vehicle, name: str) -> bool:
    """Return whether an effect is a drag law of the whole hull and a vehicle has drag already.

    In any recording such a law would describe the hull better than the file does, and so hide what has
    changed.

    Args:
        vehicle: The vehicle.
        name: Name of the effect in the catalogue.
    """
    return has_drag(vehicle) and Role.WHOLE_HULL in CATALOGUE[name].roles


def is_curved(name: str) -> bool:
    """Return whether an effect of the catalogue is nonlinear in any parameter."""
    return not CATALOGUE[name].identification.linear


def choice(vehicle: Vehicle, effect: str) -> str:
    """Return the name of an effect with the parameter form to try, such as `linear_damping.diagonal`.

    It is the effect's name alone if the effect has one form only, or if the vehicle has the effect.

    Args:
        vehicle: The vehicle.
        effect: Name in the catalogue.
    """
    form = CATALOGUE[effect].identification.form
    return effect if form is None or vehicle.effects(effect) else f"{effect}.{form}"


def plainer(vehicle: Vehicle, effect: str, file: Vehicle) -> list[dict[str, Any]]:
    """Return `[[effect]]` tables of simpler effects with nearly the forces of an effect of a vehicle.

    Simpler effects that the vehicle has already are left out.

    Args:
        vehicle: The vehicle with the effect.
        effect: Name of the effect.
        file: The vehicle file without the effect.
    """
    reduced = CATALOGUE[effect].identification.plainer
    found = reduced(vehicle.effects(effect)[0], file) if reduced is not None else []
    return [table for table in found if not vehicle.effects(table["name"])]


def with_one_value(vehicle: Vehicle, effect: str, file: Vehicle) -> dict[str, Any] | None:
    """Return the `[[effect]]` table of an effect with one value for all thrusters, such as a common gain.

    Args:
        vehicle: The vehicle with the effect.
        effect: Name of the effect.
        file: The vehicle file.

    Returns:
        The table; None for an effect without such a form, or of the file, whose values may differ.
    """
    reduced = CATALOGUE[effect].identification.plainer
    if reduced is None or file.effects(effect):
        return None
    found = reduced(vehicle.effects(effect)[0], file)
    return next((table for table in found if table["name"] == effect), None)


def shapes(vehicle: Vehicle, effect: str, *, reach: Array | None = None) -> list[Suspect]:
    """Return candidates of one effect for a fine grid of its nonlinear parameters; empty if it needs no grid.

    Args:
        vehicle: The vehicle.
        effect: Name in the catalogue.
        reach: Positions [m] and times [s] of the recording, (N, 4), for the place of an anchor.
    """
    return _shaped(vehicle, effect, CATALOGUE[effect].identification.fine, reach)


def every_shape(vehicle: Vehicle, effect: str, *, reach: Array | None = None) -> list[Suspect]:
    """Return all candidates of a nonlinear effect that the vehicle lacks, for the coarse and the fine grid.

    A grid has fixed values of the effect's nonlinear parameters, one candidate for each.

    Args:
        vehicle: The vehicle.
        effect: Name in the catalogue.
        reach: Positions [m] and times [s] of the recording, (N, 4), for the place of an anchor.
    """
    coarse = _shaped(vehicle, effect, CATALOGUE[effect].identification.coarse, reach)
    return [*coarse, *shapes(vehicle, effect, reach=reach)]


def _shaped(vehicle: Vehicle, effect: str, made: Shapes | None, reach: Array | None) -> list[Suspect]:
    """Return one candidate per shape of an effect that the vehicle lacks."""

    def equipped(table: dict[str, Any]) -> Vehicle:
        return msgspec.structs.replace(vehicle, effect=(*vehicle.effect, table))

    return [
        Suspect(effect, tuple(map(equipped, shape.tables)), shape.steps, shape.begin)
        for shape in (made(vehicle, reach) if made is not None else ())
    ]


def of_entries(vehicle: Vehicle, effect: str, *, reach: Array | None = None) -> Suspect:
    """Return an effect that is (nearly) linear as one candidate with a column for each of its components.

    The columns are derivatives at the effect's present values, or at zero if the vehicle lacks the effect.

    Args:
        vehicle: The vehicle.
        effect: Name in the catalogue.
        reach: Positions [m] and times [s] of the recording, (N, 4), for the place of an anchor.
    """
    unknown = free(vehicle, [choice(vehicle, effect)], reach=reach)
    name = unknown.entries[0].effect
    start, (low, high) = unknown.starts[0], unknown.bounds
    steps = [
        e.step if v + e.step <= b else -e.step for e, v, b in zip(unknown.entries, start, high, strict=True)
    ]
    moved = [start + step * unit for step, unit in zip(steps, np.eye(len(start)), strict=True)]

    words = CATALOGUE[name].written(next(iter(vehicle.effects(name)), {}))

    def begin(amounts: Array) -> dict[str, Any]:
        values = np.clip(start + amounts * unknown.scales, low, high)
        return {"name": name} | words | effect_table(unknown, name, values)

    return Suspect(
        name,
        tuple(unknown.at(values) for values in moved),
        tuple(step / entry.scale for step, entry in zip(steps, unknown.entries, strict=True)),
        begin,
    )
