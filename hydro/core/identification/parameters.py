"""What can be fitted of a vehicle: the entries of named effects as one vector, and back.

An entry has a natural scale, by dimensional analysis from the vehicle's mass m, mean moment of inertia J and
length L: a size at which it would be plain to see.  It makes entries comparable and says what a standard
error is large against.
"""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE, Effect, Parameter
from hydro.core.effects.catalogue import added_mass_matrix
from hydro.core.effects.record import BOOKKEEPING
from hydro.core.effects.validate import damping_in_sum
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

LEAST_POWER, MOST_POWER = 0.5, 4.0
"""Bounds of the power of a thrust curve."""
LONGEST_SENSOR_DELAY = 0.5
"""Greatest delay of a velocity log that is looked for [s]."""
ROUGH = {"thruster_deadband": 5e-2, "command_delay": 1e-2, "sensor_delay": 1e-2, "tether": 1e-2}
"""Share of the scale that derivatives are taken over where an effect has kinks; of others, a thousandth."""
RESOLUTION = {"thruster_deadband": 1e-4}
"""Share of the scale to which an effect is searched for that acts on a row of the log or does not."""
GRIDS: dict[str, tuple[dict[str, Any], ...]] = {
    "fluid_memory": tuple({"K": [[0.0] * 6], "rates": [rate]} for rate in (0.3, 1.0, 3.0, 8.0)),
    "surface_suction": tuple({"A": 0.0, "decay": decay} for decay in (0.5, 1.5, 4.0)),
}
"""Where to begin with an effect that the vehicle has not, where one beginning is not as good as another."""


@dataclass(frozen=True)
class Entry:
    """One number of a vehicle file that is free.

    Attributes:
        effect: Name of the effect.
        parameter: Name of the parameter.
        index: Place in it; () of a number.
        unit: Its unit.
        scale: A plainly visible size.
        low: Least value.
        high: Greatest value.
        step: For derivatives.
        resolution: Share of the scale to which it is searched for, where it acts in steps; 0 of others.
    """

    effect: str
    parameter: str
    index: tuple[int, ...]
    unit: str
    scale: float
    low: float
    high: float
    step: float
    resolution: float = 0.0

    @property
    def name(self) -> str:
        """As it is written: `linear_damping.diagonal[0]`."""
        return f"{self.effect}.{self.parameter}" + "".join(f"[{i}]" for i in self.index)


@dataclass(frozen=True)
class Free:
    """The free entries of a vehicle.

    Attributes:
        vehicle: The vehicle with every fitted effect in it, new ones absent in size.
        entries: The free numbers.
        starts: Values to begin from, (P,) each; several where the problem has several valleys.
        known: Names of the effects that the vehicle had already.
    """

    vehicle: Vehicle
    entries: tuple[Entry, ...]
    starts: tuple[Array, ...]
    known: frozenset[str]

    def at(self, values: Array) -> Vehicle:
        """The vehicle with these values (P,)."""
        tables = {entry.effect: {} for entry in self.entries}  # type: dict[str, dict[str, Any]]
        for entry, value in zip(self.entries, values, strict=True):
            table = tables[entry.effect]
            if not entry.index:
                table[entry.parameter] = float(value)
                continue
            if entry.parameter not in table:
                current = next(iter(self.vehicle.effects(entry.effect)))
                table[entry.parameter] = np.array(current[entry.parameter], float).tolist()
            _put(table[entry.parameter], entry.index, float(value))
            if (entry.effect, entry.parameter) == ("added_mass", "matrix"):
                _put(table[entry.parameter], entry.index[::-1], float(value))
        changed = tuple({**e, **tables.get(e["name"], {})} for e in self.vehicle.effect)
        return msgspec.structs.replace(self.vehicle, effect=changed)

    def holding(self, values: Array, held: NDArray[np.bool_]) -> Free:
        """The same begun at these values (P,), without the entries that are to stay there."""
        rest = tuple(entry for entry, stays in zip(self.entries, held, strict=True) if not stays)
        return replace(self, vehicle=self.at(values), entries=rest, starts=(values[~held],))

    def within(self, values: Array) -> Array:
        """Values (P,) moved to the nearest within the bounds."""
        return np.clip(values, *self.bounds)

    @property
    def scales(self) -> Array:
        """Scale of each entry, (P,)."""
        return np.array([entry.scale for entry in self.entries])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and greatest values, (P,) each."""
        low, high = [e.low for e in self.entries], [e.high for e in self.entries]
        return np.array(low) + 0.0, np.array(high) + 0.0  # no negative zeros


def free(vehicle: Vehicle, effects: Sequence[str | Mapping[str, Any]], *, reach: Array | None = None) -> Free:
    """The entries of named effects, free.

    Args:
        vehicle: The vehicle.
        effects: Names in the catalogue, each with `.parameter` behind it where there is a choice
            (`linear_damping.matrix`), or tables with values to begin from.
        reach: Positions of the recording, (N, 3), in which an unknown anchor is looked for.

    Raises:
        DataError: An unknown name, a name given twice, or one that the vehicle file has several of.
    """
    if not effects:
        raise DataError(f"name at least one effect to fit; there are {', '.join(CATALOGUE)}")
    grids: list[list[dict[str, Any]]] = []
    known = set()
    for wanted in effects:
        record, alternative, given = _wanted(wanted)
        if any(grid[0]["name"] == record.name for grid in grids):
            raise DataError(f"effect {record.name} is named twice; name it once")
        present = vehicle.effects(record.name)
        if len(present) > 1:
            raise DataError(f"effect: {len(present)} are named {record.name}: merge them first")
        if present:
            known.add(record.name)
        base = {k: v for k, v in present[0].items() if k not in BOOKKEEPING} if present else {}
        if given:
            grid = [base | given]
        elif present and alternative in (None, *present[0]):
            grid = [base]
        elif present:
            grid = [_converted(record, base, str(alternative))]
        else:
            grid = _beginnings(record, alternative, vehicle, reach)
        grids.append([_complete(record, table, vehicle) for table in grid])
    others = tuple(e for e in vehicle.effect if e["name"] not in {grid[0]["name"] for grid in grids})
    rest = msgspec.structs.replace(vehicle, effect=others)
    first = {grid[0]["name"]: grid[0] for grid in grids}
    kept = [dict(e) | first.pop(e["name"], {}) for e in vehicle.effect]
    for table in kept:
        for name in CATALOGUE[table["name"]].one_of:
            if table["name"] in {g[0]["name"] for g in grids} and name not in _shape_of(grids, table["name"]):
                table.pop(name, None)
    full = msgspec.structs.replace(vehicle, effect=(*kept, *first.values()))
    found = tuple(entry for grid in grids for entry in _entries(grid[0], vehicle, rest))
    low, high = np.array([e.low for e in found]), np.array([e.high for e in found])
    starts = tuple(np.clip(_values(found, choice), low, high) for choice in itertools.product(*grids))
    return Free(full, found, starts, frozenset(known))


def effect_table(free_: Free, name: str, values: Array) -> dict[str, Any]:
    """The `[[effect]]` table of one fitted effect, with other numbers (standard errors) or its own."""
    shaped = next(iter(free_.at(values).effects(name)))
    return {p.name: shaped[p.name] for p in CATALOGUE[name].parameters if p.name in shaped}


def _wanted(wanted: str | Mapping[str, Any]) -> tuple[Effect, str | None, dict[str, Any]]:
    """Record, alternative parameter and given values of what a caller named."""
    given = {} if isinstance(wanted, str) else {k: v for k, v in wanted.items() if k != "name"}
    text = wanted if isinstance(wanted, str) else str(wanted.get("name"))
    name, _, alternative = text.partition(".")
    if name not in CATALOGUE:
        near = difflib.get_close_matches(name, CATALOGUE, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(CATALOGUE)}"
        raise DataError(f"effect {name!r} is not in the catalogue; {hint}")
    record = CATALOGUE[name]
    if alternative and alternative not in record.one_of:
        choice = ", ".join(record.one_of) or "nothing to choose"
        raise DataError(f"effect {text}: {name} has {choice}")
    return record, alternative or None, given


def _converted(record: Effect, table: dict[str, Any], alternative: str) -> dict[str, Any]:
    """The same effect in its other form: a diagonal as a matrix, one scale as three."""
    given = next(name for name in record.one_of if name in table)
    shape = next(p.shape for p in record.parameters if p.name == alternative)
    values = np.asarray(table[given], float)
    if len(shape) == 2:
        values = np.diag(values)
    elif values.ndim == 2:
        values = np.diag(values).copy()
    elif not shape:
        values = values.mean()
    else:
        values = np.broadcast_to(values, [int(n) for n in shape])
    return {k: v for k, v in table.items() if k != given} | {alternative: values.tolist()}


def _beginnings(
    record: Effect, alternative: str | None, vehicle: Vehicle, reach: Array | None
) -> list[dict[str, Any]]:
    """Tables to begin from, of an effect that the vehicle has not."""
    if record.name in GRIDS:
        return [dict(table) for table in GRIDS[record.name]]
    if record.name == "payload":
        weight = 0.005 * vehicle.rigid_body.mass * vehicle.environment.gravity
        return [{"w": weight}, {"w": -weight}]
    if record.name == "tether":
        return _tethers(vehicle, reach)
    chosen = alternative or (record.one_of[0] if record.one_of else None)
    return [{chosen: None}] if chosen else [{}]


def _tethers(vehicle: Vehicle, reach: Array | None) -> list[dict[str, Any]]:
    """Anchors amid the recorded track and on its edges, cables that pull always or far out only."""
    track = np.zeros((1, 3)) if reach is None else reach
    middle, half = np.median(track, axis=0), np.maximum(0.5 * np.ptp(track, axis=0), 2.0)
    anchors = [middle, track[0]]
    anchors += [middle + sign * half[i] * np.eye(3)[i] for i in range(3) for sign in (-1.0, 1.0)]
    found = []
    for anchor in anchors:
        distance = np.linalg.norm(track - anchor, axis=1)
        for slack in np.quantile(distance, [0.0, 0.5]):
            k = 0.002 * vehicle.rigid_body.mass * vehicle.environment.gravity
            found.append({"k": k, "slack": float(slack), "anchor": anchor.tolist()})
    return found


def _complete(record: Effect, table: dict[str, Any], vehicle: Vehicle) -> dict[str, Any]:
    """The table with every parameter that it leaves out, or that is None, as zeros; checked."""
    full: dict[str, Any] = {"name": record.name}
    if record.one_of and not any(name in table for name in record.one_of):
        table = {**table, record.one_of[0]: None}
    for parameter in record.parameters:
        if parameter.name in record.one_of and parameter.name not in table:
            continue
        value = table.get(parameter.name)
        if value is None:
            value = np.maximum(np.zeros(_shape(parameter, vehicle, table)), parameter.low).tolist()
        full[parameter.name] = value
    unknown = {key: value for key, value in table.items() if key not in full}
    record.pack(full | unknown, thrusters=len(vehicle.thruster), where=f"effect {record.name}")
    return full


def _shape(parameter: Parameter, vehicle: Vehicle, table: Mapping[str, Any]) -> list[int]:
    """Lengths of a parameter, numbers of thrusters and rates put in."""
    rates = len(table.get("rates") or [1.0])
    sizes = {"thrusters": len(vehicle.thruster), "rates": rates}
    return [sizes[n] if isinstance(n, str) else n for n in parameter.shape]


def _shape_of(grids: Sequence[Sequence[Mapping[str, Any]]], name: str) -> Mapping[str, Any]:
    return next(grid[0] for grid in grids if grid[0]["name"] == name)


def _values(found: Sequence[Entry], choice: Sequence[Mapping[str, Any]]) -> Array:
    tables = {table["name"]: table for table in choice}
    return np.array([float(np.asarray(tables[e.effect][e.parameter])[e.index]) for e in found])


def _entries(table: Mapping[str, Any], vehicle: Vehicle, rest: Vehicle) -> list[Entry]:
    """Free entries of a complete table; a symmetric matrix has those on and above its diagonal."""
    record, found = CATALOGUE[table["name"]], []
    for parameter in record.parameters:
        if parameter.name not in table:
            continue
        shape = np.shape(table[parameter.name])
        for index in np.ndindex(*shape):
            if (record.name, parameter.name) == ("added_mass", "matrix") and index[0] > index[1]:
                continue
            unit = unit_at(parameter, index)
            scale = SCALES.get((record.name, parameter.name)) or _natural(unit, vehicle)
            low, high = _limits(record.name, parameter, index, vehicle, rest)
            step = scale * ROUGH.get(record.name, 1e-3)
            sharp = RESOLUTION.get(record.name, 0.0)
            found.append(Entry(record.name, parameter.name, index, unit, scale, low, high, step, sharp))
    return found


def unit_at(parameter: Parameter, index: tuple[int, ...]) -> str:
    """Unit of one entry of a parameter."""
    units = parameter.unit
    if len(units) == 3:
        return units[sum(i >= 3 for i in index)]
    return units[index[-1] >= 3] if len(units) == 2 else units[0]


SCALES = {
    ("buoyancy_offset", "dx"): 0.02,
    ("buoyancy_offset", "dy"): 0.02,
    ("buoyancy_offset", "dz"): 0.02,
    ("tether", "slack"): 5.0,
    ("tether", "anchor"): 10.0,
    ("surface_suction", "decay"): 1.0,
    ("thruster_deadband", "d"): 0.1,
    ("sensor_scale", "s"): 0.1,
    ("sensor_scale", "axes"): 0.1,
    ("crossflow_drag", "Cd_y"): 1.0,
    ("crossflow_drag", "Cd_z"): 1.0,
}
"""Scales that the unit alone does not give."""


def _natural(unit: str, vehicle: Vehicle) -> float:
    """A plainly visible size of a quantity of this unit on this vehicle, at speeds about 1 m/s."""
    body, length = vehicle.rigid_body, vehicle.hull.length
    m = body.mass
    J = float(np.trace(np.array(body.inertia))) / 3.0
    cross = float(np.sqrt(m * J))  # between a force and a moment
    return {
        "1": 0.3,
        "m": 0.3 * length,
        "rad": 0.1,
        "s": 0.1,
        "s/m": 0.1,
        "1/s": 1.0,
        "m/s": 0.2,
        "N": 0.01 * m * vehicle.environment.gravity,
        "N/m": 0.005 * m * vehicle.environment.gravity,
        "kg": 0.3 * m,
        "kg m": 0.1 * cross,
        "kg m^2": 0.3 * J,
        "kg/m": 0.5 * m,
        "N s/m": 0.3 * m,
        "N s": 0.3 * cross,
        "N m s": 0.5 * J,
        "N s^2/m^2": 1.0 * m,
        "N s^2": 1.0 * J,  # a moment per rate and speed, not one per speed squared
        "N m s^2": 1.0 * J,
    }[unit]


def _limits(
    name: str, parameter: Parameter, index: tuple[int, ...], vehicle: Vehicle, rest: Vehicle
) -> tuple[float, float]:
    """Bounds of an entry: the catalogue's, and those that the sum with the rest of the file must keep."""
    low, high = parameter.low, parameter.high
    if len(index) == 2 and index[0] != index[1] and parameter.name == "matrix":
        return low, high
    axis = index[0] if index else 0
    linear, quadratic, drag = damping_in_sum(rest)
    if name == "linear_damping":
        low = -float(linear[axis, axis])
    elif name == "quadratic_damping":
        low = -float(quadratic[axis])
    elif name == "crossflow_drag":
        low = -float(drag[0 if parameter.name == "Cd_y" else 1])
    elif name == "added_mass":
        low = -float(added_mass_matrix(rest)[axis, axis])
    elif name == "fluid_memory" and parameter.name == "rates":
        high = 25.0
    elif name == "surface_suction" and parameter.name == "decay":
        low, high = 0.1, 30.0
    elif name == "sensor_delay":
        high = LONGEST_SENSOR_DELAY
    elif name == "thruster_lag":
        shortest = [t.time_constant - 2.0 * (t.lag_step or 0.0) for t in vehicle.thruster]
        low, high = -max(min(shortest, default=0.0), 0.0), 3.0
    elif name == "command_delay":
        low, high = -min((t.delay for t in vehicle.thruster), default=0.0), 2.0
    elif name == "thruster_deadband":
        bands = [t.deadband for t in vehicle.thruster] or [0.0]
        low, high = -min(bands), 0.9 - max(bands)
    elif name == "thruster_curve":
        powers = [2.0 if t.curve == "quadratic" else 1.0 for t in vehicle.thruster] or [1.0]
        low, high = LEAST_POWER - min(powers), MOST_POWER - max(powers)
    elif name == "payload" and parameter.name in ("x", "y", "z"):
        low, high = -2.0 * vehicle.hull.length, 2.0 * vehicle.hull.length
    elif parameter.name == "attachment":
        low, high = -vehicle.hull.length, vehicle.hull.length
    return low, high


def _put(nested: list[Any], index: tuple[int, ...], value: float) -> None:
    for i in index[:-1]:
        nested = nested[i]
    nested[index[-1]] = value
