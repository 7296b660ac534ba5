"""Vehicle files: TOML text to a checked `Vehicle`, and effects written into the text beside its comments."""

from __future__ import annotations

import hashlib
import math
import os
import re
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hydro.core import toml_text
from hydro.core.errors import DataError, HydroWarning
from hydro.core.vehicle import likely_units
from hydro.core.vehicle.description import (
    APART,
    Thruster,
    Vehicle,
    as_written,
    called,
    catalogue_name,
    own_names,
    require_names,
    told_apart,
)
from hydro.io import mistaken, toml
from hydro.io.files import shown, write_bytes

RELATIVE = 1e-9
"""Tolerance of symmetry, definiteness and the triangle inequality, of the largest entry."""

FORMAT_LINE = 'format = "hydro-vehicle/1"'

LABEL = re.compile("[A-Za-z0-9_-]+")
"""What a label may be: nothing that is written about it on a command line."""

UNIT = 1e-6
"""Tolerance of the length of a direction."""


def read(path: str | Path) -> tuple[Vehicle, str]:
    """Read a vehicle file.

    Returns:
        The vehicle, and the text of the file as it stands; what is odd in it is warned of.

    Raises:
        DataError: the file cannot be read, or is not a vehicle; the line names the path in the file.
    """
    try:
        text = toml.read(path)
        found = parse(text, os.fspath(path))
    except DataError as error:
        raise mistaken.explained(error, path, mistaken.VEHICLE) from error
    warn(found, text, os.fspath(path))
    return found, text


def warn(vehicle: Vehicle, text: str, name: str) -> None:
    """Warn of what in a vehicle file is likely in another unit, and of a file that does not say its format.

    Args:
        vehicle: the vehicle.
        text: the text that it was read from.
        name: what the lines call the file.
    """
    if "format" not in toml_text.content(text):
        line = f"add {FORMAT_LINE} as its first line"
        warnings.warn(f"{name}: format: missing, and taken for today's: {line}", HydroWarning, stacklevel=3)
    for words in [*likely_units.doubts(vehicle), *_idle(vehicle)]:
        warnings.warn(f"{name}: {words}", HydroWarning, stacklevel=3)


def _idle(vehicle: Vehicle) -> Iterator[str]:
    """Servos whose fins the file forgets, a line each."""
    from hydro.core.effects.hull import CONTROL_SURFACE, idle_servos

    for command in idle_servos(vehicle):
        servo = vehicle.thruster[int(command[1:]) - 1].name
        yield (
            f"thruster {servo}: nothing obeys its command: add a {CONTROL_SURFACE.name} with "
            f'`commands = ["{command}"]` (`hydro effects {CONTROL_SURFACE.name}`)'
        )


def parse(text: str, name: str = "vehicle") -> Vehicle:
    """The vehicle that a text describes, checked, its effects told apart by name and nothing else changed.

    Args:
        text: TOML.
        name: what error lines call it, usually the file's name.

    Raises:
        DataError: the text is not TOML or not a vehicle; the line names the path in the file.
    """
    return told_apart(toml.parse(text, Vehicle, name, check))


def check(vehicle: Vehicle) -> None:
    """What types alone do not say: finite numbers, a possible inertia, thrusters given once, known effects.

    Raises:
        DataError: the line begins with the path in the file.
    """
    from hydro.core import effects

    for path, number in toml.numbers(msgspec.to_builtins(vehicle)):
        if not math.isfinite(number):
            raise DataError(f"{path}: must be finite, got {number}")
    _check_inertia(np.array(vehicle.rigid_body.inertia))
    _check_names(vehicle)
    _check_repeated(vehicle)
    for index, thruster in enumerate(vehicle.thruster):
        _check_thruster(f"thruster[{index}]", thruster)
    effects.validate(vehicle)


def vehicle_hash(vehicle: Vehicle) -> str:
    """SHA-256 of what a vehicle file says: comments, layout and `1` for `1.0` make no difference.

    Returns:
        `sha256:` and 64 hexadecimal digits.
    """
    content = msgspec.json.encode(_canonical(as_written(vehicle)), order="sorted")
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def differences(one: Vehicle, other: Vehicle, recording: str, added: Collection[str]) -> list[str]:
    """Where two vehicle files differ: `name`, `rigid_body`, `effect payload`; nothing where they do not.

    What a fit leaves beside values, and what is held as known, makes no difference; nor does an effect that
    `hydro add` wrote into `one` from the diagnosis itself.

    Args:
        one: the vehicle that findings go to.
        other: the vehicle that was diagnosed.
        recording: hash of the recording of the diagnosis.
        added: effects that the diagnosis has values of.
    """
    origin = {"data": recording, "method": "diagnose"}
    done = {t["name"] for t in one.effect if t["name"] in added and t.get("fit") == origin}
    mine, its = (_stated(vehicle, done) for vehicle in (one, other))
    return [key for key in (mine | its) if mine.get(key) != its.get(key)]


def _stated(vehicle: Vehicle, without: Collection[str]) -> dict[str, Any]:
    """What a vehicle file says, effect by effect, but for what fits leave beside values."""
    from hydro.core.effects.record import BOOKKEEPING

    said: dict[str, Any] = _canonical(vehicle)
    tables = said.pop("effect", [])
    for table in (each for each in tables if each["name"] not in without):
        values = {key: value for key, value in table.items() if key not in BOOKKEEPING}
        said.setdefault(f"effect {table['name']}", []).append(values)
    return said


def write(text: str, destination: str | Path) -> None:
    """Write the text of a vehicle file, whole or not at all, once it has passed all checks.

    Raises:
        DataError: the text is not a vehicle, or the operating system refuses.
    """
    parse(text, os.fspath(destination))
    write_bytes(text.encode(), destination)


def append_effect(text: str, effect: Mapping[str, Any]) -> str:
    """The text with one more `[[effect]]` at its end; everything before it stays as it is.

    Args:
        text: a vehicle file.
        effect: the table's keys and values; numpy arrays are written as arrays, mappings as sub-tables.

    Raises:
        DataError: the file's effects are not `[[effect]]` tables.
    """
    import tomlkit

    document = tomlkit.parse(text)
    if not isinstance(document.get("effect", tomlkit.aot()), tomlkit.items.AoT):
        raise DataError("effect: write the effects as [[effect]] tables, so that one can be added")
    tables = tomlkit.aot()
    tables.append(toml.table({**effect, "name": called(effect)[1]}))
    return f"{text.rstrip()}\n\n{tomlkit.dumps({'effect': tables})}"


def set_effect(text: str, effect: Mapping[str, Any]) -> str:
    """The text with the values of `effect` in the table of that name, or appended where there is none.

    Other keys of the table, and comments, stay; a key whose value is None goes.

    Args:
        text: a vehicle file.
        effect: the table's keys and values; its name is the one of `told_apart`.

    Raises:
        DataError: there are several effects of that name, so that it is not clear which is meant.
    """
    import tomlkit

    document = tomlkit.parse(text)
    tables = document.get("effect", [])
    names, wanted = own_names(tables), str(effect["name"])
    several = [name for name in names if wanted in (name, catalogue_name(name))]
    if not several:
        return append_effect(text, effect)
    if len(several) > 1:
        raise DataError(f"effect: {len(several)} are named {wanted}: say which of {', '.join(several)}")
    found = tables[names.index(several[0])]
    for key in [key for key, value in effect.items() if value is None and key in found]:
        found.remove(key)
    for key, value in toml.table({key: value for key, value in effect.items() if key != "name"}).items():
        found[key] = value
    return tomlkit.dumps(document)


def flip_thrusters(text: str, numbers: Sequence[int], name: str = "vehicle") -> str:
    """Return the text with the directions of some thrusters reversed; everything else and comments stay.

    Thrust curves stay as they are: a positive command gives `max_thrust` before and after.

    Args:
        text: A vehicle file.
        numbers: Thrusters, from 1, in the order of the file.
        name: Name of the file, for errors.

    Raises:
        DataError: There is no thruster of a number, or it has no direction (a servo).
    """
    import tomlkit

    thrusters = parse(text, name).thruster
    document = tomlkit.parse(text)
    for number in dict.fromkeys(numbers):
        if not 1 <= number <= len(thrusters):
            raise DataError(f"{name}: there is no thruster {number}: it has {len(thrusters)}")
        thruster = thrusters[number - 1]
        key = "direction" if thruster.wrench is None else "wrench"
        values = getattr(thruster, key)
        if values is None:
            raise DataError(f"{name}: thruster {number} ({thruster.name}) has no direction to reverse")
        written = document["thruster"][number - 1][key]
        for i, value in enumerate(written):
            written[i] = -float(value) if value else value
    return tomlkit.dumps(document)


def hold_known(text: str, names: Sequence[str]) -> str:
    """The text with effects, or some of their parameters (`effect.parameter`), held as known.

    Raises:
        DataError: the file has nothing of such a name, or several effects of it.
    """
    from hydro.core.effects.catalogue import held_as_known

    for table in held_as_known(parse(text), names) if names else ():
        text = set_effect(text, table)
    return text


def without_errors_from(vehicle: Vehicle, recording: str) -> Vehicle:
    """The vehicle without the standard errors of values that were fitted to a recording, by its hash."""
    tables = [
        {key: value for key, value in table.items() if key != "standard_error"}
        if table.get("fit", {}).get("data") == recording
        else table
        for table in vehicle.effect
    ]
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a vehicle file, made from the structs of `vehicle.description`."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "hydro vehicle file"}
    return schema | msgspec.json.schema(Vehicle)


def _check_inertia(inertia: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    """Symmetric, positive definite, and no principal moment above the sum of the other two."""
    path = "rigid_body.inertia"
    tolerance = RELATIVE * float(np.abs(inertia).max())
    i, j = np.unravel_index(np.argmax(np.abs(inertia - inertia.T)), (3, 3))
    if abs(inertia[i, j] - inertia[j, i]) > tolerance:
        pair = f"[{i}][{j}] is {inertia[i, j]:g} and [{j}][{i}] is {inertia[j, i]:g}"
        raise DataError(f"{path}: must be symmetric, but {pair}")
    moments = np.linalg.eigvalsh(inertia)
    told = ", ".join(f"{moment:g}" for moment in moments)
    if moments[0] <= tolerance:
        raise DataError(f"{path}: must be positive definite, but its principal moments are {told}")
    if moments[2] > moments[0] + moments[1] + tolerance:
        raise DataError(
            f"{path}: no body has principal moments {told}: none may exceed the sum of the other two"
        )


def _check_names(vehicle: Vehicle) -> None:
    """Refuse a missing or forbidden name, and two thrusters of one name: findings tell them apart by it."""
    paths: dict[str, str] = {}
    if not vehicle.name.strip():
        raise DataError("name: empty: give the vehicle a name")
    for index, thruster in enumerate(vehicle.thruster):
        path = f"thruster[{index}].name"
        if not thruster.name.strip():
            raise DataError(f"{path}: empty: give the thruster a name")
        if thruster.name in paths:
            raise DataError(
                f"{path}: {shown(thruster.name)} is {paths[thruster.name]} too: give each its own name"
            )
        paths[thruster.name] = path
    require_names(vehicle)


def _check_repeated(vehicle: Vehicle) -> None:
    """An effect stands in a file once, unless a vehicle can have several of it, each at its own place."""
    from hydro.core.effects.catalogue import CATALOGUE

    places: dict[str, str] = {}
    *most, last = (one.name for one in CATALOGUE.values() if one.repeatable)
    several = f"only {', '.join(most)} and {last} may stand in a file several times"
    for index, (table, own) in enumerate(zip(vehicle.effect, own_names(vehicle.effect), strict=True)):
        name, path = str(table.get("name")), f"effect[{index}]"
        if APART in name:
            plain, _, label = name.partition(APART)
            raise DataError(f'{path}.name: write name = "{plain}" and label = "{label}"')
        once = name in CATALOGUE and not CATALOGUE[name].repeatable
        if name in places and once:
            raise DataError(
                f"{path}.name: {name} is {places[name]} too: keep one, with the sum of their values "
                f"({several})"
            )
        _check_label(f"{path}.label", table, several if once else "")
        if own in places and own != name:
            raise DataError(f"{path}: {own} is {places[own]} too: give each a label of its own")
        places.setdefault(name, path)
        places.setdefault(own, path)


def _check_label(path: str, table: Mapping[str, Any], only: str) -> None:
    """A label is a word, of an effect that others of its name may stand beside."""
    if (label := table.get("label")) is None:
        return
    if not (isinstance(label, str) and LABEL.fullmatch(label)):
        raise DataError(f"{path}: must be letters, digits, - and _, got {label!r}")
    if only:
        raise DataError(f"{path}: leave it out ({only})")


def _check_thruster(path: str, thruster: Thruster) -> None:
    """A point and a unit direction, or a wrench; an Euler step of the lag that is stable; of a servo none."""
    if not thruster.pushes:
        if thruster != Thruster(name=thruster.name, curve="none"):
            raise DataError(f'{path}: of curve "none" it has a name alone')
        return
    placed = (thruster.position is not None) + (thruster.direction is not None)
    if placed != (0 if thruster.wrench is not None else 2):
        raise DataError(f"{path}: give either position and direction, or wrench")
    if thruster.direction is not None:
        length = math.hypot(*thruster.direction)
        if abs(length - 1) > UNIT:
            unit = [round(part / length, 9) for part in thruster.direction] if length else "a unit vector"
            raise DataError(f"{path}.direction: must have length 1, but it is {length:.9g}: write {unit}")
    if thruster.lag_step is not None and thruster.lag_step >= thruster.time_constant:
        limit = f"time_constant = {thruster.time_constant:g}"
        raise DataError(f"{path}.lag_step: must be below {limit}, got {thruster.lag_step:g}")


def _canonical(value: Any) -> Any:
    """The same content with every number a float, no negative zeros, and nothing that is its default anyway.

    So keys that later versions add with a default leave the hashes of today's vehicles as they are.
    """
    if isinstance(value, msgspec.Struct):
        fields = msgspec.structs.fields(value)
        stated = {field.name: getattr(value, field.name) for field in fields}
        return {
            field.name: _canonical(stated[field.name])
            for field in fields
            if stated[field.name] != field.default
        }
    if isinstance(value, Mapping):
        return {key: _canonical(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_canonical(inner) for inner in value]
    return float(value) + 0.0 if isinstance(value, int | float) and not isinstance(value, bool) else value
