"""Map files: TOML text to a checked `LogMap`, and their JSON Schema."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from hydro.core.errors import DataError
from hydro.core.logs.logmap import BLOCKS, Attitude, LogMap, Position, blocks_of
from hydro.io import toml
from hydro.io.files import read_bytes, shown

TABLES = ("time", *BLOCKS, "commands")
"""The blocks that a guess must find: it cannot tell a sensor that is not there from one of another name."""


def is_map(path: str | Path) -> bool:
    """Whether a TOML file calls itself a map of a log.

    Raises:
        DataError: the file cannot be read.
    """
    return b"hydro-map/" in read_bytes(path)


def read(path: str | Path) -> LogMap:
    """Read a map file.

    Raises:
        DataError: the file cannot be read, or is not a map; the line names the path in the file.
    """
    name = os.fspath(path)
    try:
        text = read_bytes(path).decode()
    except UnicodeDecodeError as error:
        raise DataError(f"{name}: not UTF-8 text: save the file as UTF-8") from error
    return parse(text, name)


def parse(text: str, name: str = "map") -> LogMap:
    """The map that a text describes.

    Args:
        text: TOML.
        name: what error lines call it, usually the file's name.

    Raises:
        DataError: the text is not TOML or not a map; the line names the path in the file.
    """
    found = toml.parse(text, LogMap, name)
    try:
        check(found)
    except DataError as error:
        raise DataError(f"{name}: {error}") from error
    return found


def check(found: LogMap) -> None:
    """What types alone do not say: how many columns, one way to give each quantity, pulse widths in order.

    Raises:
        DataError: the line begins with the path in the file.
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
        if block is not None:
            _check_count(f"{name}.columns", block.columns, 3)
    if found.velocity is not None and found.velocity.frame not in ("FRD", "FLU") and found.attitude is None:
        raise DataError(f"velocity.frame: {found.velocity.frame} needs an attitude that turns it; give one")
    if not found.commands.columns:
        raise DataError("commands.columns: name at least one column")
    pwm = found.commands.pwm
    if not pwm.min < pwm.neutral < pwm.max:
        raise DataError("commands.pwm: neutral must lie between min and max")


def from_guess(blocks: Mapping[str, Any], columns: Sequence[str]) -> LogMap:
    """The map that guessed blocks make.

    Raises:
        DataError: some blocks are missing; the line says which, and what the log has.
    """
    missing = [name for name in TABLES if name not in blocks]
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
    """The log's columns for a line of text, of many the first."""
    more = f" and {len(columns) - 40} more" if len(columns) > 40 else ""
    return ", ".join(shown(name) for name in columns[:40]) + more


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a map file, made from the structs of `logs.logmap`."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "hydro map of a log"}
    return schema | msgspec.json.schema(LogMap)


def _check_position(block: Position) -> None:
    vertical = (block.depth is not None) + (block.height is not None)
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


def _check_count(path: str, columns: Sequence[Any], count: int) -> None:
    if len(columns) != count:
        raise DataError(f"{path}: expected {count} columns, got {len(columns)}")
