"""Vehicle files: parsing of TOML to a checked `Vehicle`, and changes of the text that keep comments."""

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
from hydro.io import file_kind, toml
from hydro.io.files import shown, write_bytes

RELATIVE_TOLERANCE = 1e-9
"""Tolerance of symmetry, definiteness and the triangle inequality, relative to the largest entry."""

FORMAT_LINE = 'format = "hydro-vehicle/1"'

LABEL = re.compile("[A-Za-z0-9_-]+")
"""Pattern of a label: no character with a meaning on a command line."""

UNIT_TOLERANCE = 1e-6
"""Tolerance of the length of a direction."""


def read(path: str | Path) -> tuple[Vehicle, str]:
    """Read a vehicle file; warn of likely mistakes.

    Returns:
        A pair of the vehicle and the text of the file.

    Raises:
        DataError: The file cannot be read or is not a vehicle; the message has the path in the file.
    """
    try:
        text = toml.read(path)
        found = parse(text, os.fspath(path))
    except DataError as error:
        raise file_kind.explained(error, path, file_kind.VEHICLE) from error
    warn(found, text, os.fspath(path))
    return found, text


def warn(vehicle: Vehicle, text: str, name: str) -> None:
    """Warn of values that are probably in another unit, of idle servos, and of a missing format.

    Args:
        vehicle: The vehicle.
        text: Text of its file.
        name: Name of the file in the warnings.
    """
    if "format" not in toml_text.content(text):
        line = f"add {FORMAT_LINE} as its first line"
        warnings.warn(
            f"{name}: format: missing, so the current one is assumed: {line}", HydroWarning, stacklevel=3
        )
    for words in [*likely_units.doubts(vehicle), *_idle_servos(vehicle)]:
        warnings.warn(f"{name}: {words}", HydroWarning, stacklevel=3)


def _idle_servos(vehicle: Vehicle) -> Iterator[str]:
    """Yield a line for each servo without a fin in the file."""
    from hydro.core.effects.hull import CONTROL_SURFACE, idle_servos

    for command in idle_servos(vehicle):
        servo = vehicle.thruster[int(command[1:]) - 1].name
        yield (
            f"thruster {servo}: no effect uses its command: add a {CONTROL_SURFACE.name} with "
            f'`commands = ["{command}"]` (`hydro effects {CONTROL_SURFACE.name}`)'
        )


def parse(text: str, name: str = "vehicle") -> Vehicle:
    """Return the checked vehicle that a text describes; repeated effects get unique names.

    Args:
        text: TOML.
        name: Name in error messages, usually the file's name.

    Raises:
        DataError: The text is not TOML or not a vehicle; the message has the path in the file.
    """
    return told_apart(toml.parse(text, Vehicle, name, check))


def check(vehicle: Vehicle) -> None:
    """Check the rules of vehicles that types cannot express: finite numbers, inertia, thrusters and effects.

    Raises:
        DataError: A rule is broken; the message starts with the path in the file.
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
    """Return the SHA-256 of a vehicle's content; comments, layout and `1` for `1.0` have no influence.

    Returns:
        `sha256:` and 64 hexadecimal digits.
    """
    content = msgspec.json.encode(_canonical(as_written(vehicle)), order="sorted")
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def differences(one: Vehicle, other: Vehicle, recording: str, added: Collection[str]) -> list[str]:
    """Return the names of the parts in which two vehicles differ, such as `rigid_body` or `effect payload`.

    Ignored are notes of fits, marks of known values, and effects that `hydro add` wrote into `one` from the
    same diagnosis.

    Args:
        one: Vehicle to which findings are added.
        other: Vehicle that was diagnosed.
        recording: Hash of the recording of the diagnosis.
        added: Effects with values from the diagnosis.
    """
    origin = {"data": recording, "method": "diagnose"}
    done = {t["name"] for t in one.effect if t["name"] in added and t.get("fit") == origin}
    mine, its = (_content(vehicle, done) for vehicle in (one, other))
    return [key for key in (mine | its) if mine.get(key) != its.get(key)]


def _content(vehicle: Vehicle, without: Collection[str]) -> dict[str, Any]:
    """Return the content of a vehicle file by section and effect, without marks of fits.

    Args:
        vehicle: The vehicle.
        without: Names of effects to leave out.
    """
    from hydro.core.effects.record import BOOKKEEPING

    said: dict[str, Any] = _canonical(vehicle)
    tables = said.pop("effect", [])
    for table in (each for each in tables if each["name"] not in without):
        values = {key: value for key, value in table.items() if key not in BOOKKEEPING}
        said.setdefault(f"effect {table['name']}", []).append(values)
    return said


def write(text: str, destination: str | Path) -> None:
    """Check the text of a vehicle file and write it atomically.

    Raises:
        DataError: The text is not a vehicle, or the operating system refuses.
    """
    parse(text, os.fspath(destination))
    write_bytes(text.encode(), destination)


def append_effect(text: str, effect: Mapping[str, Any]) -> str:
    """Return the text of a vehicle file with one more `[[effect]]` at its end; the text before it stays.

    Args:
        text: Vehicle file.
        effect: Keys and values of the table; numpy arrays are written as arrays, mappings as sub-tables.

    Raises:
        DataError: The file's effects are not `[[effect]]` tables.
    """
    import tomlkit

    document = tomlkit.parse(text)
    if not isinstance(document.get("effect", tomlkit.aot()), tomlkit.items.AoT):
        raise DataError("effect: write the effects as [[effect]] tables, so that one can be added")
    tables = tomlkit.aot()
    tables.append(toml.table({**effect, "name": called(effect)[1]}))
    return f"{text.rstrip()}\n\n{tomlkit.dumps({'effect': tables})}"


def set_effect(text: str, effect: Mapping[str, Any]) -> str:
    """Return the text of a vehicle file with new values of one effect; an effect that is missing is appended.

    Other keys and comments of the effect's table stay; a key whose value is None is removed.

    Args:
        text: Vehicle file.
        effect: Keys and values of the table; `name` is its unique name in the vehicle, see `told_apart`.

    Raises:
        DataError: Several effects have that name.
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
    """Return the text of a vehicle file with the directions of the given thrusters reversed.

    Everything else stays, thrust curves too: a positive command gives `max_thrust` before and after.

    Args:
        text: Vehicle file.
        numbers: Numbers of thrusters, from 1, in the order of the file.
        name: Name of the file in error messages.

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
    """Return the text of a vehicle file in which the named effects or parameters are marked as known.

    Args:
        text: Vehicle file.
        names: Names of effects, or of single parameters as `effect.parameter`.

    Raises:
        DataError: The file has no effect or parameter of a name, or several.
    """
    from hydro.core.effects.catalogue import held_as_known

    for table in held_as_known(parse(text), names) if names else ():
        text = set_effect(text, table)
    return text


def without_errors_from(vehicle: Vehicle, recording: str) -> Vehicle:
    """Return a copy of the vehicle without the standard errors of values that were fitted to one recording.

    Args:
        vehicle: The vehicle.
        recording: Hash of the recording.
    """
    tables = [
        {key: value for key, value in table.items() if key != "standard_error"}
        if table.get("fit", {}).get("data") == recording
        else table
        for table in vehicle.effect
    ]
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a vehicle file, generated from the structs of `vehicle.description`."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "hydro vehicle file"}
    return schema | msgspec.json.schema(Vehicle)


def _check_inertia(inertia: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    """Check that an inertia is symmetric, positive definite, and satisfies the triangle inequality."""
    path = "rigid_body.inertia"
    tolerance = RELATIVE_TOLERANCE * float(np.abs(inertia).max())
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
    """Check that names are present, allowed and, for thrusters, unique."""
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
    """Check that an effect occurs once, unless it is repeatable and each instance has its own label."""
    from hydro.core.effects.catalogue import CATALOGUE

    places: dict[str, str] = {}
    *most, last = (one.name for one in CATALOGUE.values() if one.repeatable)
    several = f"only {', '.join(most)} and {last} may occur in a file several times"
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
    """Check that the label of an effect's table is a word, and that the effect may have a label.

    Args:
        path: Path of the label in the file, for the message.
        table: The table.
        only: Reason why the effect may not have a label; empty if it may.
    """
    if (label := table.get("label")) is None:
        return
    if not (isinstance(label, str) and LABEL.fullmatch(label)):
        raise DataError(f"{path}: must be letters, digits, - and _, got {label!r}")
    if only:
        raise DataError(f"{path}: leave it out ({only})")


def _check_thruster(path: str, thruster: Thruster) -> None:
    """Check a thruster: position and unit direction, or wrench; stable lag step; a servo has neither."""
    if not thruster.pushes:
        if thruster != Thruster(name=thruster.name, curve="none"):
            raise DataError(f'{path}: with curve "none", give only a name')
        return
    placed = (thruster.position is not None) + (thruster.direction is not None)
    if placed != (0 if thruster.wrench is not None else 2):
        raise DataError(f"{path}: give either position and direction, or wrench")
    if thruster.direction is not None:
        length = math.hypot(*thruster.direction)
        if abs(length - 1) > UNIT_TOLERANCE:
            unit = [round(part / length, 9) for part in thruster.direction] if length else "a unit vector"
            raise DataError(f"{path}.direction: must have length 1, but it is {length:.9g}: write {unit}")
    if thruster.lag_step is not None and thruster.lag_step >= thruster.time_constant:
        limit = f"time_constant = {thruster.time_constant:g}"
        raise DataError(f"{path}.lag_step: must be below {limit}, got {thruster.lag_step:g}")


def _canonical(value: Any) -> Any:
    """Return nested content with all numbers as floats, without negative zeros and without defaults.

    So new keys with a default do not change the hashes of existing vehicles.
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
