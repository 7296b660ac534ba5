"""What could be missing in a vehicle file: the whole catalogue, as columns to hold against a recording.

An effect that is linear in its parameters gives one column per parameter.  One that is not (the rate of a
memory, the place of an anchor) gives several suspects, each with that parameter held at one value of a grid;
the best of them is where a fit of the effect begins.  A few coarse ones tell whether the effect is worth a
closer look, and a fine grid (`shapes`) then where to begin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE
from hydro.core.identification.parameters import GRIDS, Free, effect_table, free
from hydro.core.vehicle.description import Vehicle

CURVED = ("fluid_memory", "surface_suction", "tether", "payload")
"""Effects that are not linear in all of their parameters."""
CHOICES = {"sensor_scale": "sensor_scale.axes"}
"""Which form of an effect that the vehicle has not is tried, where the first is not the most general."""
COARSE_RATES = (0.5, 4.0)  # 1/s
LEVER = 0.25  # of the hull's length: where a payload is tried besides CO


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
        reach: Positions of the recording, (N, 3), among which an anchor is looked for.
    """
    found: list[Suspect] = []
    for name in CATALOGUE:
        if name in without:
            continue
        if name in CURVED and not vehicle.effects(name):
            found += _COARSE[name](vehicle, reach)
        elif name not in CURVED:
            found.append(_linear(vehicle, choice(vehicle, name)))
    return found


def choice(vehicle: Vehicle, effect: str) -> str:
    """The form of an effect that is tried, as `parameters.free` takes it."""
    return effect if vehicle.effects(effect) else CHOICES.get(effect, effect)


def shapes(vehicle: Vehicle, effect: str, *, reach: Array | None = None) -> list[Suspect]:
    """A finer grid of one effect than `suspects` has; empty of those that need none."""
    return list(_FINE[effect](vehicle, reach)) if effect in _FINE else []


def every_shape(vehicle: Vehicle, effect: str, *, reach: Array | None = None) -> list[Suspect]:
    """All shapes, coarse and fine, of an effect of CURVED that the vehicle has not."""
    return [*_COARSE[effect](vehicle, reach), *shapes(vehicle, effect, reach=reach)]


def _linear(vehicle: Vehicle, choice: str) -> Suspect:
    """One column per entry of an effect that is linear, or nearly so, about its absence or present values."""
    unknown = free(vehicle, [choice])
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


def _few_memories(vehicle: Vehicle, reach: Array | None) -> Iterator[Suspect]:
    """Six strengths for a slow and a quick memory."""
    for rate in COARSE_RATES:
        yield _memory(vehicle, {"K": [[0.0] * 6], "rates": [rate]})


def _memories(vehicle: Vehicle, reach: Array | None) -> Iterator[Suspect]:
    """Six strengths for each rate of the grid."""
    for table in GRIDS["fluid_memory"]:
        yield _memory(vehicle, table)


def _memory(vehicle: Vehicle, table: dict[str, Any]) -> Suspect:
    unknown = free(vehicle, [{"name": "fluid_memory"} | table])
    return _some(unknown, [i for i, entry in enumerate(unknown.entries) if entry.parameter == "K"])


def _suctions(vehicle: Vehicle, reach: Array | None) -> Iterator[Suspect]:
    """The force at the surface for each depth of decay of the grid."""
    for table in GRIDS["surface_suction"]:
        unknown = free(vehicle, [{"name": "surface_suction"} | table])
        yield _some(unknown, [0])


def _some(unknown: Free, chosen: Sequence[int]) -> Suspect:
    """Some entries of an effect, the others held where they are."""
    name, start, entries = unknown.entries[0].effect, unknown.starts[0], unknown.entries
    columns = np.eye(len(start))[list(chosen)]
    scales = np.array([entries[i].scale for i in chosen])
    low, high = unknown.bounds

    def begin(amounts: Array) -> dict[str, Any]:
        values = np.clip(start + (amounts * scales) @ columns, low, high)
        return {"name": name} | effect_table(unknown, name, values)

    return Suspect(
        name,
        tuple(
            unknown.at(start + entries[i].step * column) for i, column in zip(chosen, columns, strict=True)
        ),
        tuple(entries[i].step / entries[i].scale for i in chosen),
        begin,
    )


def _spring(vehicle: Vehicle, reach: Array | None) -> Iterator[Suspect]:
    """A cable without slack: the stiffness k, k times the anchor, and the moments of k at one anchor.

    Without slack the force is k (anchor - position), linear in all of them, so that anchors amid the track
    and to three sides of it stand for any.
    """
    unknown = free(vehicle, ["tether"], reach=reach)
    names = [(entry.parameter, entry.index) for entry in unknown.entries]
    stiffness, slack = names.index(("k", ())), names.index(("slack", ()))
    places = [names.index(("attachment", (i,))) for i in range(3)]
    corners = [names.index(("anchor", (i,))) for i in range(3)]
    scale, lever, little = unknown.entries[stiffness].scale, LEVER * vehicle.hull.length, 0.01
    held = np.array(unknown.starts[0])
    held[stiffness], held[slack] = little * scale, 0.0
    side = max(float(np.ptp(reach, axis=0).max()), 2.0) if reach is not None else 2.0
    ways = [held] + [held + side * np.eye(len(held))[corner] for corner in corners]
    ways += [held + lever * np.eye(len(held))[place] for place in places]
    low, high = unknown.bounds

    def begin(amounts: Array) -> dict[str, Any]:
        stiff = max(float(amounts.sum()), 1e-3)
        begun = held.copy()
        begun[stiffness] = stiff * scale
        begun[corners] += np.clip(amounts[1:4] / stiff, -3.0, 3.0) * side
        begun[places] = np.clip(amounts[4:] / stiff, -4.0, 4.0) * lever
        return {"name": "tether"} | effect_table(unknown, "tether", np.clip(begun, low, high))

    yield Suspect("tether", tuple(unknown.at(v) for v in ways), (little,) * 7, begin)


def _tethers(vehicle: Vehicle, reach: Array | None) -> Iterator[Suspect]:
    """For each anchor and slack, the stiffness k and its moments k a about CO: linear in all four."""
    unknown = free(vehicle, ["tether"], reach=reach)
    names = [(entry.parameter, entry.index) for entry in unknown.entries]
    stiffness, places = names.index(("k", ())), [names.index(("attachment", (i,))) for i in range(3)]
    scale, lever = unknown.entries[stiffness].scale, LEVER * vehicle.hull.length
    little = 0.01
    low, high = unknown.bounds
    for values in unknown.starts:
        held = np.array(values)
        held[stiffness] = little * scale
        tried = [held] + [held + lever * np.eye(len(held))[place] for place in places]

        def begin(amounts: Array, held: Array = held) -> dict[str, Any]:
            stiff = max(float(amounts.sum()), 1e-3)
            begun = held.copy()
            begun[stiffness] = stiff * scale
            begun[places] = amounts[1:] / stiff * lever
            return {"name": "tether"} | effect_table(unknown, "tether", np.clip(begun, low, high))

        yield Suspect("tether", tuple(unknown.at(v) for v in tried), (little,) * 4, begin)


def _payloads(vehicle: Vehicle, reach: Array | None) -> Iterator[Suspect]:
    """Weight, its three moments and the dry mass: linear in w, w x, w y, w z and m."""
    weight = 0.01 * vehicle.rigid_body.mass * vehicle.environment.gravity
    mass, lever = 0.3 * vehicle.rigid_body.mass, LEVER * vehicle.hull.length
    little = 0.01
    at_origin = {"name": "payload", "w": little * weight}
    pairs = [at_origin | {axis: lever} for axis in ("x", "y", "z")]
    dry = {"name": "payload", "mass": little * mass}
    tables = (at_origin, *pairs, dry)

    def begin(amounts: Array) -> dict[str, Any]:
        total = float(amounts[:4].sum())
        heavy = total if abs(total) > 1e-3 else 1e-3
        places = np.clip(amounts[1:4] / heavy * lever, -vehicle.hull.length, vehicle.hull.length)
        return {
            "name": "payload",
            "w": heavy * weight,
            **dict(zip(("x", "y", "z"), places.tolist(), strict=True)),
            "mass": max(float(amounts[4]), 0.0) * mass,
        }

    changed = tuple(msgspec.structs.replace(vehicle, effect=(*vehicle.effect, table)) for table in tables)
    yield Suspect("payload", changed, (little,) * 5, begin)


_COARSE: dict[str, Callable[[Vehicle, Array | None], Iterator[Suspect]]] = {
    "fluid_memory": _few_memories,
    "surface_suction": _suctions,
    "tether": _spring,
    "payload": _payloads,
}
_FINE: dict[str, Callable[[Vehicle, Array | None], Iterator[Suspect]]] = {
    "fluid_memory": _memories,
    "tether": _tethers,
}
