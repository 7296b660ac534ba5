"""Candidate effects of the whole catalogue, as columns of a linear problem.

An effect that is linear in its parameters gives one column per parameter.  A nonlinear effect (the rate of a
memory, the place of an anchor) gives several candidates, each with that parameter fixed at a grid value.  A
fit of the effect starts from the best of them.  An effect with a threshold or delay also gives several
candidates, each a finite change, not a derivative.  A coarse grid shows whether an effect deserves a closer
look; a fine grid (`shapes`) supplies initial values.  The record of an effect defines its shapes.
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
from hydro.core.effects.record import Role, Shapes
from hydro.core.prediction.parameters import effect_table, free
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Suspect:
    """Candidate effect, or one shape of it, as columns of a linear problem.

    Attributes:
        effect: Name in the catalogue.
        changed: The vehicle with a small change of each parameter, one vehicle per column.
        steps: Size of the changes, in units in which 1 is a significant change.
        begin: Function from amounts (columns,) to the `[[effect]]` table of initial values.
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
    """Return all effects that may be missing, or have other values than in the vehicle file.

    Args:
        vehicle: The vehicle.
        without: Effects to exclude.
        reach: Positions and times of the recording, (N, 4), candidates for the place of an anchor.
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
    """Return whether an effect is a drag law of the whole hull, and the vehicle has drag already.

    Such a law would describe the hull better than the file in any recording, so it hides what has changed.
    """
    has_drag = any(Role.DRAG in CATALOGUE[str(table["name"])].roles for table in vehicle.effect)
    return has_drag and Role.WHOLE_HULL in CATALOGUE[name].roles


def is_curved(name: str) -> bool:
    """Return whether an effect is nonlinear in any of its parameters."""
    return not CATALOGUE[name].identification.linear


def choice(vehicle: Vehicle, effect: str) -> str:
    """Return the form of an effect to try, as `parameters.free` takes it."""
    form = CATALOGUE[effect].identification.form
    return effect if form is None or vehicle.effects(effect) else f"{effect}.{form}"


def plainer(vehicle: Vehicle, effect: str, file: Vehicle, *, itself: bool = False) -> list[dict[str, Any]]:
    """Return tables of simpler effects that an effect of a vehicle may approximate and the vehicle lacks.

    Args:
        vehicle: The vehicle with the effect.
        effect: Its name.
        file: The vehicle file without it.
        itself: Also return the effect itself with fewer parameters, such as one gain for all thrusters.
    """
    reduced = CATALOGUE[effect].identification.plainer
    if reduced is None:
        return []
    return [
        table
        for table in reduced(vehicle.effects(effect)[0], file)
        if not vehicle.effects(table["name"]) or (itself and table["name"] == effect)
    ]


def shapes(vehicle: Vehicle, effect: str, *, reach: Array | None = None) -> list[Suspect]:
    """Return a finer grid of one effect than `suspects`; empty for effects that need none."""
    return _shaped(vehicle, effect, CATALOGUE[effect].identification.fine, reach)


def every_shape(vehicle: Vehicle, effect: str, *, reach: Array | None = None) -> list[Suspect]:
    """Return all candidates for a nonlinear effect that the vehicle lacks: the coarse and the fine grid."""
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
    """Return one column per component of a (nearly) linear effect, about zero or its present values."""
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
