"""Differences of two vehicle files, part by part in words, and the file with one difference undone."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.difference.ahead import ERROR, Errors
from hydro.core.effects.catalogue import CATALOGUE
from hydro.core.effects.record import BOOKKEEPING, Index, Table
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Thruster, Vehicle

Unit = Callable[[str, Index], str]
"""Function from a key of a table and an index within its value to the unit of that number."""
PARTS = ("environment", "rigid_body", "buoyancy", "hull", "battery")
"""Tables of a vehicle file that occur at most once."""
UNITS = {
    "water_density": "kg/m^3",
    "gravity": "m/s^2",
    "mass": "kg",
    "center_of_gravity": "m",
    "inertia": "kg m^2",
    "force": "N",
    "center": "m",
    "length": "m",
    "width": "m",
    "height": "m",
    "voltage": "V",
    "max_thrust": "N",
    "max_reverse_thrust": "N",
    "position": "m",
    "time_constant": "s",
    "lag_step": "s",
    "delay": "s",
}
"""Units of the keys of a vehicle file outside effects; effects name their units in the catalogue."""
NOTHING, EVERYTHING = "nothing", "everything"
"""Rows of the table in `table` with no difference undone, and with all differences undone."""


@dataclass(frozen=True)
class Change:
    """Part of a vehicle file that differs from the same part of another file.

    Attributes:
        part: `rigid_body`, `thruster T1, T2`, or `effect` and its name.
        words: Values of the first and of the second file, as text.
        undone: Copy of the second vehicle in which this part is that of the first; None if no file can have
            it.
    """

    part: str
    words: str
    undone: Vehicle | None


def changes(first: Vehicle, second: Vehicle) -> list[Change]:
    """Return the differences between two vehicle files, part by part.

    Standard errors, other records of a fit, and the mark `known` are not compared.

    Args:
        first: First vehicle file.
        second: Second vehicle file.
    """
    found = []
    for part in PARTS:
        was, now = getattr(first, part), getattr(second, part)
        if was != now:
            words = _words(_table(was), _table(now), _own_unit)
            found.append(Change(part, words, msgspec.structs.replace(second, **{part: was})))
    return [*found, *_of_thrusters(first, second), *_of_effects(first, second)]


def table(first: Vehicle, second: Vehicle, raw: pl.DataFrame | None = None) -> pl.DataFrame:
    """Return the differences of two vehicle files, with the prediction error that each difference causes.

    Args:
        first: First vehicle file.
        second: Second vehicle file; without a recording it is the truth.
        raw: Raw table of a recording, which is then the truth.

    Returns:
        Columns `undone` (part), `change` (words) and the error 5 s ahead [m/s] of the second file with this
        part as in the first file.  The first row is the unchanged second file, the last the first file.
        Errors are null where the files have different numbers of commands.  No rows if the files agree.

    Raises:
        DataError: The motion of the second vehicle diverges, or the recording does not fit it.
    """
    found = changes(first, second)
    same = len(first.thruster) == len(second.thruster)
    errors = Errors(second, raw) if found and same else None

    def error(vehicle: Vehicle | None) -> float | None:
        if errors is None or vehicle is None:
            return None
        try:
            return errors.of(vehicle)
        except DataError:  # a partly changed file may not be a valid vehicle
            return None

    rows = [(NOTHING, "the second file as it is", None if errors is None else errors.own)]
    rows += [(change.part, change.words, error(change.undone)) for change in found]
    rows.append((EVERYTHING, "the first file", error(first)))
    schema = {"undone": pl.String, "change": pl.String, ERROR: pl.Float64}
    return pl.DataFrame(rows if found else [], schema=schema, orient="row")


def _of_thrusters(first: Vehicle, second: Vehicle) -> Iterator[Change]:
    """Yield the differences of thrusters; thrusters with the same difference share one entry."""
    if len(first.thruster) != len(second.thruster):
        words = f"{len(first.thruster)} -> {len(second.thruster)}: the files do not share commands"
        yield Change("thruster", words, None)
        return
    alike: dict[str, list[int]] = {}
    for i, (was, now) in enumerate(zip(first.thruster, second.thruster, strict=True)):
        if was != now:
            words = _words(_table(was), _table(now), _own_unit)
            alike.setdefault(words, []).append(i)
    for words, places in alike.items():
        thrusters: list[Thruster] = list(second.thruster)
        for i in places:
            thrusters[i] = first.thruster[i]
        names = ", ".join(second.thruster[i].name for i in places)
        undone = msgspec.structs.replace(second, thruster=tuple(thrusters))
        yield Change(f"thruster {names}", words, undone)


def _of_effects(first: Vehicle, second: Vehicle) -> Iterator[Change]:
    """Yield differences of effects, one entry for each name, in the order of the file."""
    names = dict.fromkeys(str(table["name"]) for table in (*first.effect, *second.effect))
    for name in names:
        was, now = ([_values(one) for one in vehicle.effects(name)] for vehicle in (first, second))
        if was == now:
            continue
        place = min((i for i, one in enumerate(second.effect) if one["name"] == name), default=None)
        rest = [one for one in second.effect if one["name"] != name]
        at = len(rest) if place is None else place
        effects = (*rest[:at], *first.effects(name), *rest[at:])
        words = _effect_words(name, was, now)
        yield Change(f"effect {name}", words, msgspec.structs.replace(second, effect=effects))


def _effect_words(name: str, was: Sequence[Table], now: Sequence[Table]) -> str:
    """Return the differences between all effects of one name in words, numbered if there are several."""

    def unit(key: str, index: Index) -> str:
        given = [one.unit_at(index) for one in CATALOGUE[name].parameters if one.name == key]
        return "" if given in ([], ["1"]) else given[0]

    several, parts = max(len(was), len(now)) > 1, []
    for i, (before, after) in enumerate(itertools.zip_longest(was, now)):
        if before == after:
            continue
        number = f"{i + 1}: " if several else ""
        if before is None or after is None:
            head = "gone" if after is None else "new"
            parts.append(f"{number}{head}: {_listed(before or after or {}, unit)}")
        else:
            parts.append(number + _words(before, after, unit))
    return "; ".join(parts)


def _values(table: Mapping[str, Any]) -> Table:
    """Return an effect's table without standard errors and other records of a fit."""
    return {key: value for key, value in table.items() if key not in BOOKKEEPING}


def _table(part: Any) -> Table:
    """Return a part of a vehicle file as a mapping; empty if the part is missing."""
    return {} if part is None else dict(msgspec.structs.asdict(part))


def _own_unit(key: str, index: Index) -> str:
    """Return the unit of a key outside effects; empty for a key without unit."""
    return UNITS.get(key, "")


def _listed(table: Table, unit: Unit) -> str:
    """Return all values of a table with their units, in words."""
    kept = (key for key in table if key != "name")
    return ", ".join(f"{key} {_said(table[key])}{_common(key, table[key], unit)}" for key in kept)


def _words(was: Table, now: Table, unit: Unit) -> str:
    """Return the differences of two tables in words, entry by entry."""
    said = []
    for key in dict.fromkeys((*was, *now)):
        if was.get(key) != now.get(key):
            said += _entries(key, was.get(key), now.get(key), unit)
    return ", ".join(said)


def _entries(key: str, was: Any, now: Any, unit: Unit) -> list[str]:
    """Return the differences of two values of one key; arrays of equal shape are compared entry by entry."""
    before, after = _numbers(was), _numbers(now)
    if before is None or after is None or before.shape != after.shape:
        one = was if now is None else now
        return [f"{key} {_said(was)} -> {_said(now)}{_common(key, one, unit)}"]
    different = (index for index in np.ndindex(*before.shape) if before[index] != after[index])
    return [
        f"{key}{''.join(f'[{i}]' for i in index)} {_apart(float(before[index]), float(after[index]))}"
        f"{_behind(unit(key, index))}"
        for index in different
    ]


def _apart(was: float, now: float) -> str:
    """Return two numbers with enough digits to distinguish them, at least four."""
    digits = next((n for n in range(4, 17) if f"{was:.{n}g}" != f"{now:.{n}g}"), 17)
    return f"{was:.{digits}g} -> {now:.{digits}g}"


def _numbers(value: Any) -> Array | None:
    """Return a value as an array of numbers; None if it contains anything else."""
    if value is None or isinstance(value, str | Mapping | msgspec.Struct):
        return None
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return None


def _said(value: Any) -> str:
    """Return a value in short, as in a vehicle file."""
    if value is None:
        return "none"
    if isinstance(value, msgspec.Struct):
        return "a table"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_said, value))}]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _common(key: str, value: Any, unit: Unit) -> str:
    """Return the unit of all numbers of a value after a blank; empty if their units differ."""
    numbers = _numbers(value)
    units = set() if numbers is None else {unit(key, index) for index in np.ndindex(*numbers.shape)}
    return _behind(units.pop()) if len(units) == 1 else ""


def _behind(unit: str) -> str:
    """Return a unit after a blank; empty without unit."""
    return f" {unit}" if unit else ""
