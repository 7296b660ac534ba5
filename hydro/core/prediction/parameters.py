"""Conversion of the free components of named effects to one vector, and back to a vehicle.

A component is one number of a parameter.  Its scale is the size of a significant value, from the catalogue or
from dimensional analysis (`core.effects.units`).  Scales make components comparable: steps of derivatives and
standard errors are judged relative to them.
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
from hydro.core.effects import CATALOGUE, Effect, Parameter, sensor
from hydro.core.effects.catalogue import added_mass_matrix
from hydro.core.effects.record import BOOKKEEPING, Rest
from hydro.core.effects.sums import damping_in_sum
from hydro.core.errors import DataError
from hydro.core.simulation.estimates import with_numbers
from hydro.core.vehicle.description import Vehicle, catalogue_name

LONGEST_SENSOR_DELAY = sensor.LONGEST_DELAY
"""Largest delay of a DVL for which a fit searches [s]."""


@dataclass(frozen=True)
class Entry:
    """Free component: one number of a parameter that a fit may change.

    Attributes:
        effect: Name of the effect.
        parameter: Name of the parameter.
        index: Index of the number in the parameter's value; () for a scalar.
        unit: Unit of the number.
        scale: Size of a significant value, in `unit`.
        low: Minimum value.
        high: Maximum value.
        step: Step for numerical derivatives, in `unit`.
        resolution: Smallest useful step of a search, relative to `scale`, for a component that acts in whole
            rows of the log; else 0.
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
        """Name of the number, such as `linear_damping.diagonal[0]`."""
        return f"{self.effect}.{self.parameter}" + "".join(f"[{i}]" for i in self.index)


@dataclass(frozen=True)
class Free:
    """P free components of a vehicle: numbers of its parameters that a fit may change.

    Attributes:
        vehicle: The vehicle with every fitted effect; new effects have zero values.
        entries: The free components.
        starts: One or more vectors of initial values, (P,); several if the problem may have several local
            minima.
        known: Names of the effects that the vehicle file had before new effects were added.
    """

    vehicle: Vehicle
    entries: tuple[Entry, ...]
    starts: tuple[Array, ...]
    known: frozenset[str]

    def at(self, values: Array) -> Vehicle:
        """Return a copy of the vehicle with the free components set to `values`, (P,), in their units."""
        return with_numbers(self.vehicle, self.entries, values)

    def holding(self, values: Array, held: NDArray[np.bool_]) -> Free:
        """Return a new set in which a part of the components is fixed and no longer listed.

        Args:
            values: Value of each free component, (P,): those to fix, and initial values of those that stay
                free.
            held: Mask of the components to fix, (P,).
        """
        rest = tuple(entry for entry, stays in zip(self.entries, held, strict=True) if not stays)
        return replace(self, vehicle=self.at(values), entries=rest, starts=(values[~held],))

    def within(self, values: Array) -> Array:
        """Return a copy of `values`, (P,), clipped to the bounds of the components."""
        return np.clip(values, *self.bounds)

    @property
    def effects(self) -> list[str]:
        """Names of the effects with free components, in their order."""
        return list(dict.fromkeys(entry.effect for entry in self.entries))

    @property
    def has_thresholds(self) -> bool:
        """Whether any component acts in whole steps, so that fits end in local minima."""
        return any(entry.resolution for entry in self.entries)

    def places(self, effect: str) -> list[int]:
        """Return the indices, from 0 to P - 1, of the free components of one effect."""
        return [i for i, entry in enumerate(self.entries) if entry.effect == effect]

    @property
    def scales(self) -> Array:
        """Size of a significant value of each component, (P,), in its unit."""
        return np.array([entry.scale for entry in self.entries])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and greatest allowed value of each component, (P,) each."""
        low, high = [e.low for e in self.entries], [e.high for e in self.entries]
        return np.array(low) + 0.0, np.array(high) + 0.0  # no negative zeros


def free(vehicle: Vehicle, effects: Sequence[str | Mapping[str, Any]], *, reach: Array | None = None) -> Free:
    """Return the numbers of named effects that a fit may change, except those that the file marks as known.

    Args:
        vehicle: The vehicle.
        effects: Effects to fit: names in the catalogue, with `.parameter` behind the name where there is a
            choice (`linear_damping.matrix`), or `[[effect]]` tables with initial values.
        reach: Positions [m] and times [s] in the N rows of the recording, (N, 4), from which initial values
            of places follow, such as a tether's anchor.

    Raises:
        DataError: A name is unknown, given twice, or that of a random effect.
    """
    if not effects:
        raise DataError(f"name at least one effect to fit; there are {', '.join(CATALOGUE)}")
    grids: list[list[dict[str, Any]]] = []
    known = set()
    for wanted in (one for several in effects for one in _each(vehicle, several)):
        name, alternative, given = _wanted(vehicle, wanted)
        record = CATALOGUE[name]
        if any(grid[0]["name"] == name for grid in grids):
            raise DataError(f"effect {name} is named twice; name it once")
        if record.is_random:
            raise DataError(
                f"effect {name} acts by chance: no prediction shows it, `hydro diagnose` estimates it"
            )
        present = vehicle.effects(name)
        if len(present) > 1:
            raise DataError(f"effect: {len(present)} are named {name}: give each a label")
        if present:
            known.add(name)
        base = {k: v for k, v in present[0].items() if k not in BOOKKEEPING} if present else {}
        if given:
            grid = [base | given]
        elif present and alternative in (None, *present[0]):
            grid = [base]
        elif present:
            grid = [_converted(record, base, str(alternative), vehicle)]
        else:
            grid = _beginnings(record, alternative, vehicle, reach)
        grids.append([_complete(name, table, vehicle) for table in grid])
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
    """Return the `[[effect]]` table of one fitted effect, with given numbers in the place of its parameters.

    Args:
        free_: P free components.
        name: Name of the effect.
        values: Number of each free component, such as its value or its standard error, (P,).
    """
    shaped = next(iter(free_.at(values).effects(name)))
    return {p.name: shaped[p.name] for p in CATALOGUE[name].parameters if p.name in shaped}


def _each(vehicle: Vehicle, wanted: str | Mapping[str, Any]) -> list[str | Mapping[str, Any]]:
    """Return a requested effect, or each effect in the vehicle with the requested catalogue name."""
    name, point, alternative = wanted.partition(".") if isinstance(wanted, str) else ("", "", "")
    several = vehicle.names(name)
    return [f"{one}{point}{alternative}" for one in several] if len(several) > 1 else [wanted]


def _wanted(vehicle: Vehicle, wanted: str | Mapping[str, Any]) -> tuple[str, str | None, dict[str, Any]]:
    """Return name, chosen parameter and given values of a requested effect."""
    given = {} if isinstance(wanted, str) else {k: v for k, v in wanted.items() if k != "name"}
    text = wanted if isinstance(wanted, str) else str(wanted.get("name"))
    name, _, alternative = text.partition(".")
    there = vehicle.names(catalogue_name(name))
    if name != catalogue_name(name) and name not in there:
        hint = f"has {', '.join(there)}" if there else f"has no {catalogue_name(name)}"
        raise DataError(f"effect {name}: {vehicle.name} {hint}")
    if name not in CATALOGUE:
        near = difflib.get_close_matches(name, CATALOGUE, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(CATALOGUE)}"
        raise DataError(f"effect {name!r} is not in the catalogue; {hint}")
    record = CATALOGUE[name]
    if alternative and alternative not in record.one_of:
        choice = ", ".join(record.one_of) or "nothing to choose"
        raise DataError(f"effect {text}: {name} has {choice}")
    return name, alternative or None, given


def _converted(record: Effect, table: dict[str, Any], alternative: str, vehicle: Vehicle) -> dict[str, Any]:
    """Return an effect in its other form: a diagonal as a matrix, or one number as one per thruster."""
    given = next(name for name in record.one_of if name in table)
    parameter = next(p for p in record.parameters if p.name == alternative)
    shape = _shape(record, parameter, vehicle, table)
    values = np.asarray(table[given], float)
    if len(shape) == 2:
        values = np.diag(values)
    elif values.ndim == 2:
        values = np.diag(values).copy()
    elif not shape:
        values = values.mean()
    else:
        values = np.broadcast_to(values, shape)
    return {k: v for k, v in table.items() if k != given} | {alternative: values.tolist()}


def _beginnings(
    record: Effect, alternative: str | None, vehicle: Vehicle, reach: Array | None
) -> list[dict[str, Any]]:
    """Return tables with initial values of an effect that the vehicle lacks, one for each start of a fit."""
    if record.identification.starts is not None:
        return record.identification.starts(vehicle, reach)
    chosen = alternative or (record.one_of[0] if record.one_of else None)
    return [{chosen: None}] if chosen else [{}]


def _complete(name: str, table: dict[str, Any], vehicle: Vehicle) -> dict[str, Any]:
    """Return the checked table of an effect with missing parameters, or those that are None, set to zero."""
    record = CATALOGUE[name]
    full: dict[str, Any] = {"name": name} | {
        words.name: table.get(words.name, [])
        for words in record.words
        if words.name in table or not words.optional
    }
    if record.one_of and not any(name in table for name in record.one_of):
        table = {**table, record.one_of[0]: None}
    for parameter in record.parameters:
        if parameter.name in record.one_of and parameter.name not in table:
            continue
        value = table.get(parameter.name)
        if value is None:
            shape = _shape(record, parameter, vehicle, table)
            if 0 in shape:
                continue
            value = np.maximum(np.zeros(shape), parameter.low).tolist()
        full[parameter.name] = value
    unknown = {key: value for key, value in table.items() if key not in full}
    record.pack(full | unknown, thrusters=len(vehicle.thruster), where=f"effect {name}")
    return full


def _shape(record: Effect, parameter: Parameter, vehicle: Vehicle, table: Mapping[str, Any]) -> list[int]:
    """Return the shape of a parameter; the sizes of lists (thrusters, rates, terms) replace their names."""
    sizes = {"thrusters": len(vehicle.thruster), "rates": len(table.get("rates") or [1.0])}
    if record.structure is not None:
        sizes |= record.structure(table, f"effect {record.name}")[1]
    return [sizes[n] if isinstance(n, str) else n for n in parameter.shape]


def _shape_of(grids: Sequence[Sequence[Mapping[str, Any]]], name: str) -> Mapping[str, Any]:
    """Return the first table of an effect."""
    return next(grid[0] for grid in grids if grid[0]["name"] == name)


def _values(found: Sequence[Entry], choice: Sequence[Mapping[str, Any]]) -> Array:
    """Return the values of components in tables of effects, (P,)."""
    tables = {table["name"]: table for table in choice}
    return np.array([float(np.asarray(tables[e.effect][e.parameter])[e.index]) for e in found])


def _entries(table: Mapping[str, Any], vehicle: Vehicle, rest: Vehicle) -> list[Entry]:
    """Return the free components of a complete table.

    Symmetric components count once; known values and servos have none.
    """
    name, found = str(table["name"]), list[Entry]()
    record = CATALOGUE[name]
    known = record.known(next(iter(vehicle.effects(name)), {}))
    search, others = record.identification, _rest(vehicle, rest)
    for parameter in record.parameters:
        if parameter.name not in table:
            continue
        for index in np.ndindex(*np.shape(table[parameter.name])):
            if (parameter.symmetric and index[0] > index[1]) or parameter.name in known or parameter.held:
                continue
            if parameter.shape == ("thrusters",) and not vehicle.thruster[index[0]].pushes:
                continue
            scale = parameter.scale_at(index, vehicle)
            low, high = parameter.low, parameter.high
            if parameter.limits is not None:
                low, high = parameter.limits(index, others)
            found.append(
                Entry(
                    effect=name,
                    parameter=parameter.name,
                    index=index,
                    unit=parameter.unit_at(index),
                    scale=scale,
                    low=low,
                    high=high,
                    step=scale * search.step,
                    resolution=search.resolution,
                )
            )
    return found


def _rest(vehicle: Vehicle, rest: Vehicle) -> Rest:
    """Return sums of added mass and damping over the vehicle file without the fitted effects."""
    linear, quadratic, drag = damping_in_sum(rest)
    return Rest(vehicle, added_mass_matrix(rest), linear, quadratic, drag)


def unit_at(parameter: Parameter, index: tuple[int, ...]) -> str:
    """Return the unit of one component (one number) of a parameter.

    Args:
        parameter: The parameter.
        index: Index of the component in the parameter's array; () for a number.
    """
    return parameter.unit_at(index)
