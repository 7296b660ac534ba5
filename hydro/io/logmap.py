"""Map files: parsing of TOML to a checked `LogMap`, and their JSON Schema."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hydro.core.errors import DataError
from hydro.core.logs.logmap import (
    BLOCKS,
    Attitude,
    LogMap,
    Mount,
    Position,
    blocks_of,
    conditions,
    measured,
    sensors_of,
    stretches,
)
from hydro.core.logs.mixer import PRESETS
from hydro.io import file_kind, toml
from hydro.io.files import read_bytes, shown

NEEDED = ("time", "commands")
"""Blocks that a guess must find, in addition to one of pose or velocity."""

ORTHOGONAL = 1e-3
"""Maximum deviation of a hand-written matrix from a rotation."""


def is_map(path: str | Path) -> bool:
    """Return whether a TOML file declares itself a map of a log.

    Raises:
        DataError: The file cannot be read.
    """
    return b"hydro-map/" in read_bytes(path)


def read(path: str | Path) -> LogMap:
    """Return the map in a map file.

    Raises:
        DataError: The file cannot be read or is not a map; the message has the key in the file.
    """
    try:
        return parse(toml.read(path), os.fspath(path))
    except DataError as error:
        raise file_kind.explained(error, path, file_kind.MAP) from error


def parse(text: str, name: str = "map") -> LogMap:
    """Return the map that a TOML text describes, checked.

    Args:
        text: TOML.
        name: Name in error messages, usually the file's name.

    Raises:
        DataError: The text is not TOML or not a map; the message has the path in the file.
    """
    return toml.parse(text, LogMap, name, check)


def check(found: LogMap) -> None:
    """Check the rules of a map that types cannot express: column counts, exclusive keys, pulse widths.

    Raises:
        DataError: A rule is broken; the message starts with the path in the file.
    """
    for path, number in toml.numbers(msgspec.to_builtins(found)):
        if not math.isfinite(number) or (number == 0.0 and path.endswith(".scale")):
            raise DataError(f"{path}: must be finite and a scale not 0, got {number:g}")
    if found.session.column is not None and found.session.name is not None:
        raise DataError("session: give either column or name")
    if not blocks_of(found):
        raise DataError(f"give at least one of {', '.join(BLOCKS)}: a log without any shows no motion")
    if found.position is not None:
        _check_position(found.position)
    if found.attitude is not None:
        _check_attitude(found.attitude)
    for name, block in (("velocity", found.velocity), ("rates", found.rates)):
        if block is not None and not (name == "rates" and found.rates.source == "attitude"):  # type: ignore[union-attr]
            _check_count(f"{name}.columns", block.columns, 3)
    for name, sensor in (("attitude", found.attitude), ("velocity", found.velocity), ("rates", found.rates)):
        if sensor is not None and sensor.mount is not None:
            _check_mount(f"{name}.mount", sensor.mount)
    _check_named_once(found)
    _check_derived(found)
    _check_samples(found)
    _check_mixer(found)
    for one in stretches(found):
        if one.stop is not None and not one.stop > one.start:
            raise DataError(f"use: to ({one.stop:g} s) must come after from ({one.start:g} s)")
    if found.velocity is not None and found.velocity.frame not in ("FRD", "FLU") and found.attitude is None:
        raise DataError(f"velocity.frame: {found.velocity.frame} needs an attitude that turns it; give one")
    if not found.commands.columns:
        raise DataError("commands.columns: name at least one column")
    pwm = found.commands.pwm
    if not pwm.min < pwm.neutral < pwm.max:
        raise DataError("commands.pwm: neutral must lie between min and max")


def from_guess(blocks: Mapping[str, Any], columns: Sequence[str]) -> LogMap:
    """Return a map made of guessed blocks, checked.

    Args:
        blocks: Blocks of the map by name, such as `time` and `velocity`.
        columns: Columns of the log, for the error message.

    Raises:
        DataError: Time, commands or all of pose and velocity are missing; the message lists the columns.
    """
    missing = [name for name in NEEDED if name not in blocks]
    if not any(name in blocks for name in BLOCKS):
        missing[1 if "time" in missing else 0 : 0] = BLOCKS
    if missing:
        raise DataError(
            f"the columns' names do not identify {', '.join(missing)}: write a map (hydro import LOG "
            "--write-map map.toml begins one), without the blocks that the log has no sensor for, and give "
            f"it with --map; the log has {listed(columns)}"
        )
    found = msgspec.convert(blocks, LogMap)
    check(found)
    return found


def listed(columns: Sequence[str]) -> str:
    """Return the names of columns as one text; after the first 40, only the number of further columns."""
    more = f" and {len(columns) - 40} more" if len(columns) > 40 else ""
    return ", ".join(shown(name) for name in columns[:40]) + more


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a map file, generated from the structs of `logs.logmap`."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "hydro map of a log"}
    return schema | msgspec.json.schema(LogMap)


def _check_position(block: Position) -> None:
    vertical = (block.depth is not None) + (block.height is not None)
    if block.latitude is not None or block.longitude is not None:
        if None in (block.latitude, block.longitude) or block.columns or vertical != 1:
            raise DataError(
                "position: give latitude and longitude together, with a depth or height and without columns"
            )
        if block.world != "NED":
            raise DataError("position.world: latitude and longitude become north and east; leave it out")
        return
    if len(block.columns) + vertical != (3 if block.columns else 1) or vertical > 1:
        raise DataError(
            "position: give three columns, or two and either depth or height, or one of these alone"
        )


def _check_attitude(block: Attitude) -> None:
    if (block.columns is None) == (block.quaternion is None):
        raise DataError("attitude: give either columns (roll, pitch, yaw) or quaternion")
    if block.columns is not None:
        _check_count("attitude.columns", block.columns, 3)
    if block.quaternion is not None:
        _check_count("attitude.quaternion", block.quaternion, 4)


def _check_named_once(found: LogMap) -> None:
    """Check that no block of pose or velocity has one column on two axes.

    The check of the conventions identifies columns of a block by name.  Commands may repeat a column, because
    one output can drive two thrusters.
    """
    for name, block in blocks_of(found).items():
        columns = [source.column for source in measured(block)]
        for column in columns:
            if column and columns.count(column) > 1:  # a draft has blanks
                raise DataError(f"{name}: column {shown(column)} is named twice: name another for each axis")


def _check_mount(path: str, mount: Mount) -> None:
    """Check that a mount has a position of three numbers, and one form of rotation."""
    _check_count(f"{path}.position", mount.position, 3)
    if path != "velocity.mount" and any(mount.position):
        raise DataError(f"{path}.position: this sensor measures the same anywhere on the body; leave it out")
    if mount.matrix is None:
        return
    if any((mount.roll, mount.pitch, mount.yaw)):
        raise DataError(f"{path}: give either roll, pitch and yaw or a matrix")
    _check_count(f"{path}.matrix", mount.matrix, 3)
    for row in mount.matrix:
        _check_count(f"{path}.matrix", row, 3)
    R = np.array(mount.matrix)
    if not (np.abs(R @ R.T - np.eye(3)).max() < ORTHOGONAL and np.linalg.det(R) > 0.0):
        raise DataError(f"{path}.matrix: must be a rotation: rows of length 1 at right angles, right-handed")


def _check_derived(found: LogMap) -> None:
    """Check that rates from the attitude have an attitude, and no columns or mount."""
    rates = found.rates
    if rates is None or rates.source == "columns":
        return
    if found.attitude is None:
        raise DataError('rates.from: "attitude" needs an attitude; give one')
    if rates.columns or rates.mount is not None:
        raise DataError('rates: give either columns, with their mount, or from = "attitude"')


def _check_samples(found: LogMap) -> None:
    """Check that conditions without a column state a test, and that a mount fits its frame."""
    for name, block in sensors_of(found).items():
        for one in conditions(block.valid):
            asked = (one.equals, one.above, one.below, one.differs)
            if one.column is None and asked == (None,) * 4:
                raise DataError(
                    f"{name}.valid: give a column, or a condition on the values (not, above, below)"
                )
    if found.velocity is not None and found.velocity.mount is not None:
        mount = found.velocity.mount
        turned = mount.matrix is not None or any((mount.roll, mount.pitch, mount.yaw))
        if found.velocity.frame not in ("FRD", "FLU") and turned:
            raise DataError(
                "velocity.mount: a velocity along the world's axes has no mounting angles; leave them out"
            )


def _check_mixer(found: LogMap) -> None:
    """Check the mixer: a demand for each command, each axis once, and only axes that the preset has."""
    mixer = found.mixer
    if mixer is None:
        return
    count = len(found.commands.columns)
    if len(mixer.demands) != count:
        raise DataError(f"mixer.demands: name one axis for each of the {count} columns of commands")
    if len(set(mixer.demands)) != count:
        raise DataError("mixer.demands: an axis is named twice")
    if mixer.preset is not None and mixer.matrix is not None:
        raise DataError("mixer: give either preset or matrix")
    if mixer.preset == "ardusub_vectored" and "pitch" in mixer.demands:
        raise DataError("mixer.demands: ArduSub's vectored frame has no pitch; leave its column out")
    for row in mixer.matrix or ():
        _check_count("mixer.matrix", row, count)
    thrusters = len(PRESETS[mixer.preset]) if mixer.preset is not None else len(mixer.matrix or mixer.demands)
    if mixer.directions:
        _check_count("mixer.directions", mixer.directions, thrusters)


def _check_count(path: str, entries: Sequence[Any], count: int) -> None:
    if len(entries) != count:
        what = "columns" if path.endswith((".columns", ".quaternion")) else "numbers"
        raise DataError(f"{path}: expected {count} {what}, got {len(entries)}")
