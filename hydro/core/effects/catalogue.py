"""Catalogue of all effects by name, and sums over a vehicle's list of effects."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import (
    actuator,
    currents,
    damping,
    formula,
    hull,
    inertia,
    layout,
    memory,
    restoring,
    sensor,
    surroundings,
    waves,
)
from hydro.core.effects.record import Effect, Parameter, Role, Table
from hydro.core.errors import DataError
from hydro.core.vehicle import thrusters
from hydro.core.vehicle.description import Vehicle, called, catalogue_name

FAMILIES = (
    inertia,
    damping,
    hull,
    restoring,
    currents,
    waves,
    surroundings,
    memory,
    actuator,
    sensor,
    formula,
)


DOUBT = 3.0
"""Standard errors within which a value counts as plausible although its estimate is not."""


class Catalogue(dict[str, Effect]):
    """Mapping from names to effects; a label, as in `payload:camera`, is ignored."""

    def __missing__(self, name: str) -> Effect:
        plain = catalogue_name(name)
        if plain == name or not (plain in self and self[plain].repeatable):
            raise KeyError(name)
        return self[plain]

    def __contains__(self, name: object) -> bool:
        plain = catalogue_name(name) if isinstance(name, str) else name
        return super().__contains__(plain) and (plain == name or self[str(plain)].repeatable)


CATALOGUE = Catalogue({effect.name: effect for family in FAMILIES for effect in family.EFFECTS})

REMEMBERED = 4096
"""Maximum number of tables whose packed parameters are cached."""
ROUNDING = 1e-6
"""Rounding tolerance of the ends of a plausible range, relative to half of it."""


def with_role(role: Role) -> tuple[str, ...]:
    """Return the names of the catalogue's effects that have a given role."""
    return tuple(name for name, effect in CATALOGUE.items() if role in effect.roles)


class Entry(NamedTuple):
    """Effect in a vehicle file: its record in the catalogue and its parameters.

    Attributes:
        effect: Record of the effect in the catalogue.
        parameters: Packed parameters, a vector in the order of the record.
        where: Path of the effect's table in the vehicle file, such as `effect[0]`.
    """

    effect: Effect
    parameters: Array
    where: str


def entries(vehicle: Vehicle) -> list[Entry]:
    """Return the vehicle's effects with their parameters, in the order of the file.

    Raises:
        DataError: An unknown effect, or parameters that its record does not allow.
    """
    found = []
    for index, table in enumerate(vehicle.effect):
        name = table.get("name")
        where = f"effect[{index}]"
        if not isinstance(name, str) or name not in CATALOGUE:
            raise DataError(f"{where}.name: {name!r} is not in the catalogue; it has {', '.join(CATALOGUE)}")
        effect = CATALOGUE[name]
        found.append(Entry(effect, _packed(effect, table, len(vehicle.thruster), where), where))
    return found


def _packed(effect: Effect, table: Mapping[str, Any], thrusters: int, where: str) -> Array:
    """Pack a table by `Effect.pack` with a cache: a fit tries many vehicles that differ in one table."""
    try:
        return _remembered(effect.name, msgspec.json.encode(table), thrusters).copy()
    except (DataError, TypeError):  # not packable, or not numbers: report the error with its place
        return effect.pack(table, thrusters=thrusters, where=where)


@lru_cache(maxsize=REMEMBERED)
def _remembered(name: str, text: bytes, thrusters: int) -> Array:
    return CATALOGUE[name].pack(msgspec.json.decode(text), thrusters=thrusters)


def inertia_matrix(vehicle: Vehicle, listed: Sequence[Entry] | None = None) -> Array:
    """Return the contribution of the effects to the mass matrix: added mass, couplings, dry mass of payloads.

    Args:
        vehicle: The vehicle.
        listed: Result of `entries` for this vehicle, if already computed.

    Returns:
        (6, 6) symmetric matrix about CO [kg, kg m, kg m^2].

    Raises:
        DataError: A parameter of an effect has an invalid value.
    """
    total = np.zeros((6, 6))
    for effect, parameters, _ in entries(vehicle) if listed is None else listed:
        if effect.inertia is not None:
            effect.inertia(parameters, total)
    return total


def added_mass_matrix(vehicle: Vehicle, listed: Sequence[Entry] | None = None) -> Array:
    """Return the added mass M_A of a vehicle about CO, (6, 6) [kg, kg m, kg m^2].

    Dry mass of payloads is excluded.

    Args:
        vehicle: The vehicle.
        listed: Result of `entries` for this vehicle, if already computed.
    """
    total = np.zeros((6, 6))
    for effect, parameters, _ in entries(vehicle) if listed is None else listed:
        if effect.kind == "inertia" and effect.inertia is not None:
            effect.inertia(parameters, total)
    return total


def current(vehicle: Vehicle, listed: Sequence[Entry] | None = None) -> Array:
    """Return the motion of the water as 7 numbers, (7,), from the sum of the vehicle's `flow` effects.

    Args:
        vehicle: The vehicle.
        listed: Result of `entries` for this vehicle, if already computed.

    Returns:
        Three components of the velocity at depth z = 0 and time t = 0, NED [m/s], then the gradients of the
        north and east components with depth [1/s], two, and with time [m/s^2], two.
    """
    flow = np.zeros(layout.FLOW.stop - layout.FLOW.start)
    for effect, parameters, _ in entries(vehicle) if listed is None else listed:
        if effect.flow is not None:
            effect.flow(parameters, flow)
    return flow


def thruster_table(vehicle: Vehicle, listed: Sequence[Entry] | None = None) -> Array:
    """Return the thruster table of a vehicle, changed by its effects of kind `actuator`, (n, COLUMNS).

    A row has the constants of one thruster, see `vehicle.thrusters`.  The effects do not change rows of
    servos.

    Args:
        vehicle: The vehicle, with n thrusters and servos.
        listed: Result of `entries` for this vehicle, if already computed.

    Raises:
        DataError: A thruster is misplaced, or the effects in sum give an impossible time constant, delay or
            dead band.
    """
    plain = thrusters.thruster_table(vehicle)
    table = plain.copy()
    for effect, parameters, _ in entries(vehicle) if listed is None else listed:
        if effect.actuator is not None:
            effect.actuator(parameters, table)
    for row, before, thruster in zip(table, plain, vehicle.thruster, strict=True):
        if not thruster.pushes:
            row[:] = before
    _require_possible(table)
    return table


def velocity_log(vehicle: Vehicle, listed: Sequence[Entry] | None = None) -> Array:
    """Return the errors of a vehicle's DVL and the logged reference point as one vector, (16,).

    The vector comes from effects of kind `sensor`; `core.effects.sensor` has the meaning of the entries.

    Args:
        vehicle: The vehicle.
        listed: Result of `entries` for this vehicle, if already computed.
    """
    log = np.zeros(sensor.ROW)
    for effect, parameters, _ in entries(vehicle) if listed is None else listed:
        if effect.sensor is not None:
            effect.sensor(parameters, log)
    return log


def wholly_known(vehicle: Vehicle, name: str) -> bool:
    """Return whether a vehicle file has an effect of a given name with all parameters marked as known."""
    return any(CATALOGUE[name].wholly_known(table) for table in vehicle.effects(name))


def own_effects(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the file's effects that are refitted before a diagnosis.

    Effects of kind `inertia`, random effects, and effects that are wholly known are left out.
    """
    names = dict.fromkeys(str(effect["name"]) for effect in vehicle.effect)
    return tuple(
        name
        for name in names
        if CATALOGUE[name].kind != "inertia"
        and not CATALOGUE[name].is_random
        and not wholly_known(vehicle, name)
    )


def held_as_known(vehicle: Vehicle, names: Sequence[str]) -> list[Table]:
    """Return `[[effect]]` tables that mark effects, or single parameters, of a vehicle as known.

    Args:
        vehicle: The vehicle, which has the effects; it is not changed.
        names: What to mark: an effect, or one of its parameters as `effect.parameter`.

    Returns:
        A table for each effect, with `name` and `known`: True if all parameters are known, otherwise a list
        of the known parameters.  It includes what the vehicle file already marks.

    Raises:
        DataError: The vehicle lacks a named effect, or the effect has no such parameter.
    """
    held = dict[str, frozenset[str]]()
    for text in names:
        name, _, parameter = text.partition(".")
        there = {one: CATALOGUE[one] for table in vehicle.effect for one in reversed(called(table))}
        choices = [f"{one}.{p.name}" for one, effect in there.items() for p in effect.parameters]
        if text not in (*there, *choices):
            near = difflib.get_close_matches(text, (*there, *choices), 1)
            hint = f"did you mean {near[0]}?" if near else f"its effects are {', '.join(there) or 'none'}"
            raise DataError(f"known: the vehicle has no effect {text}; {hint}")
        every = frozenset(one.name for one in there[name].parameters)
        for table in vehicle.effects(name):
            own = str(table["name"])
            held[own] = held.get(own, there[own].known(table)) | ({parameter} if parameter else every)
    whole = {name: every >= {one.name for one in CATALOGUE[name].parameters} for name, every in held.items()}
    return [{"name": name, "known": whole[name] or sorted(some)} for name, some in held.items()]


def implausible(
    vehicle: Vehicle,
    names: Sequence[str] | None = None,
    errors: Mapping[str, Any] | None = None,
    least: float = 1.0,
) -> list[str]:
    """Return a sentence for each parameter of a vehicle's effects beyond its plausible range.

    Args:
        vehicle: The vehicle.
        names: Effects to check; by default all.
        errors: Standard errors by parameter.  A value outside the range by less than DOUBT standard errors
            counts as plausible, and so does a value whose standard error is NaN or infinite.
        least: Least reported distance from the middle of the range, as a multiple of half the range: 1
            reports every value outside, 2 only values outside by more than half the range.
    """
    found = []
    for table in vehicle.effect:
        if names is None or table["name"] in names:
            given = [one for one in CATALOGUE[table["name"]].parameters if one.name in table]
            doubt = {one.name: DOUBT * np.asarray((errors or {}).get(one.name, 0.0), float) for one in given}
            found += [
                words for one in given if (words := _beyond(table, one, vehicle, doubt[one.name], least))
            ]
    return found


def _beyond(
    table: Mapping[str, Any], parameter: Parameter, vehicle: Vehicle, doubt: Array, least: float
) -> str:
    """Return a sentence if a component of a parameter is clearly beyond its plausible range; else empty."""
    if parameter.plausible is None:
        return ""
    values, farthest, words = np.asarray(table[parameter.name], float), least + ROUNDING, ""
    doubts = np.broadcast_to(np.nan_to_num(doubt, nan=np.inf), values.shape)
    for index in np.ndindex(*values.shape):
        low, high = parameter.plausible.at(index, vehicle)
        value, middle, half = float(values[index]), 0.5 * (low + high), 0.5 * (high - low)
        away = (abs(value - middle) - float(doubts[index])) / half if half else math.inf
        if away > farthest:
            farthest = away
            place = "".join(f"[{i}]" for i in index)
            unit = f" {parameter.unit_at(index)}".replace(" 1", "")
            words = (
                f"{table['name']}.{parameter.name}{place} = {value:.3g}{unit} is "
                f"implausible: {low:.3g} to {high:.3g} is plausible ({parameter.plausible.words})"
            )
    return words


def _require_possible(table: Array) -> None:
    """Raise DataError if a thruster table is outside the valid range of its kernels."""
    constant, step = table[:, thrusters.TIME_CONSTANT], table[:, thrusters.LAG_STEP]
    band = table[:, thrusters.DEADBAND]
    if (constant < 0.0).any() or ((constant > 0.0) & (constant < step)).any():
        raise DataError("effect: the time constant in sum must not be below 0 nor below lag_step")
    if (table[:, thrusters.DELAY] < 0.0).any():
        raise DataError("effect: the delay in sum must not be below 0")
    if (band < 0.0).any() or (band >= 1.0).any():
        raise DataError("effect: the dead band in sum must lie within [0, 1)")
    if (table[:, thrusters.POWER] <= 0.0).any():
        raise DataError("effect: the power of the thrust curve in sum must be above 0")
    if (table[:, thrusters.GAIN] < -1.0).any() or (table[:, thrusters.ASYMMETRY] > 1.0).any():
        raise DataError("effect: the gain in sum must not reverse the thrust")
