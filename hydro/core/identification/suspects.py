"""What could be missing in a vehicle file: the whole catalogue, as columns to hold against a recording.

An effect that is linear in its parameters gives one column per parameter.  One that is not (the rate of a
memory, the place of an anchor) gives several suspects, each with that parameter held at one value of a grid;
the best of them is where a fit of the effect begins.  So does one that acts by a threshold or late (a dead
band, a delay): each of its suspects is a change of a size, not a derivative.  A few coarse ones tell whether
the effect is worth a closer look, and a fine grid (`shapes`) then where to begin.  Which shapes an effect has
its record says.
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
from hydro.core.effects.record import Shapes
from hydro.core.prediction.parameters import effect_table, free
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Suspect:
    """An effect, or one shape of it, as columns.

    Attributes:
        effect: Name in the catalogue.
        changed: The vehicle with a little of each parameter, one vehicle per column.
        steps: That little, in units in which 1 is plain to see.
        begin: Amounts (columns,) to the `[[effect]]` table that a fit begins from.
    """

    effect: str
    changed: tuple[Vehicle, ...]
    steps: tuple[float, ...]
    begin: Callable[[Array], dict[str, Any]]


def suspects(vehicle: Vehicle, *, without: Sequence[str] = (), reach: Array | None = None) -> list[Suspect]:
    """All effects that may be missing, or have other values than the vehicle file gives them.

    Args:
        vehicle: The vehicle.
        without: Effects that are not to be tried.
        reach: Positions and times of the recording, (N, 4), among which an anchor is looked for.
    """
    found: list[Suspect] = []
    for name in (one for each in CATALOGUE for one in vehicle.names(each) or (each,)):
        if name in without or wholly_known(vehicle, name):
            continue
        if CATALOGUE[name].is_random or (CATALOGUE[name].is_written and not vehicle.effects(name)):
            continue
        if is_curved(name) and not vehicle.effects(name):
            found += _shaped(vehicle, name, CATALOGUE[name].identification.coarse, reach)
        elif not is_curved(name):
            found.append(of_entries(vehicle, name, reach=reach))
    return found


def is_curved(name: str) -> bool:
    """Whether an effect is not linear in all of its parameters."""
    return not CATALOGUE[name].identification.linear


def choice(vehicle: Vehicle, effect: str) -> str:
    """The form of an effect that is tried, as `parameters.free` takes it."""
    form = CATALOGUE[effect].identification.form
    return effect if form is None or vehicle.effects(effect) else f"{effect}.{form}"


def plainer(vehicle: Vehicle, effect: str, file: Vehicle, *, itself: bool = False) -> list[dict[str, Any]]:
    """Return tables of plainer effects that one of a vehicle may nearly be, and that the vehicle has not.

    Args:
        vehicle: With the effect.
        effect: Its name.
        file: What it was looked for beside.
        itself: Also return the effect itself with fewer numbers, such as one gain for all thrusters.
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
    """A finer grid of one effect than `suspects` has; empty of those that need none."""
    return _shaped(vehicle, effect, CATALOGUE[effect].identification.fine, reach)


def every_shape(vehicle: Vehicle, effect: str, *, reach: Array | None = None) -> list[Suspect]:
    """All shapes, coarse and fine, of a curved effect that the vehicle has not."""
    coarse = _shaped(vehicle, effect, CATALOGUE[effect].identification.coarse, reach)
    return [*coarse, *shapes(vehicle, effect, reach=reach)]


def _shaped(vehicle: Vehicle, effect: str, made: Shapes | None, reach: Array | None) -> list[Suspect]:
    """One suspect per shape of an effect that the vehicle has not."""

    def equipped(table: dict[str, Any]) -> Vehicle:
        return msgspec.structs.replace(vehicle, effect=(*vehicle.effect, table))

    return [
        Suspect(effect, tuple(map(equipped, shape.tables)), shape.steps, shape.begin)
        for shape in (made(vehicle, reach) if made is not None else ())
    ]


def of_entries(vehicle: Vehicle, effect: str, *, reach: Array | None = None) -> Suspect:
    """One column per entry of an effect that is linear, or nearly so, about its absence or present values."""
    unknown = free(vehicle, [choice(vehicle, effect)], reach=reach)
    name = unknown.entries[0].effect
    start, (low, high) = unknown.starts[0], unknown.bounds
    steps = [
        e.step if v + e.step <= b else -e.step for e, v, b in zip(unknown.entries, start, high, strict=True)
    ]
    moved = [start + step * unit for step, unit in zip(steps, np.eye(len(start)), strict=True)]

    def begin(amounts: Array) -> dict[str, Any]:
        values = np.clip(start + amounts * unknown.scales, low, high)
        return {"name": name} | effect_table(unknown, name, values)

    return Suspect(
        name,
        tuple(unknown.at(values) for values in moved),
        tuple(step / entry.scale for step, entry in zip(steps, unknown.entries, strict=True)),
        begin,
    )
