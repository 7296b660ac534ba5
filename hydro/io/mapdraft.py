"""Draft of a map: guessed blocks, with comments on the other possible settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hydro.core.errors import in_shell
from hydro.io.logmap import listed

_EMPTY: dict[str, dict[str, Any]] = {
    "time": {"column": ""},
    "session": {"name": "log"},
    "position": {"columns": ["", "", ""]},
    "attitude": {"columns": ["", "", ""]},
    "velocity": {"columns": ["", "", ""]},
    "rates": {"columns": ["", "", ""]},
    "commands": {"columns": [""]},
}
_OPTIONAL = ("voltage",)
"""Blocks that a draft has only if the column names suggest them."""
_NOTES = {
    "voltage": ('Supply of the thrusters, for thrust curves by voltage. unit: "V" or "mV".',),
    "time": (
        'unit: "s", "ms", "us" or "ns" since any epoch, or "iso" for text like 2025-06-01T12:00:00.25Z.',
        "longest_step = 0.5 would interpolate over gaps up to 0.5 s; by default five median steps.",
    ),
    "session": (
        'Rows that belong together: by a column, or all by one name ("name"); gap = 30 would begin a new',
        "session wherever the clock stops for more than 30 s.",
    ),
    "position": (
        'Of the body origin. world: "NED", "ENU" or "NWU"; unit: "m", "cm" or "mm".',
        'Two columns and depth = "COLUMN" (positive down) or height = "COLUMN" (positive up) work too; and',
        "only a depth or height; or latitude and longitude [deg] with a depth or height.",
    ),
    "attitude": (
        'columns are roll, pitch, yaw; unit: "rad" or "deg"; order: "ZYX" is yaw, pitch, roll, world inward.',
        'Or quaternion = four columns, with layout = "wxyz" or "xyzw", turns = "body to world" or back.',
        'world: "NED", "ENU" or "NWU"; body: "FRD" (forward, right, down) or "FLU" (forward, left, up).',
    ),
    "velocity": (
        'Over ground. frame: along the body\'s axes ("FRD", "FLU") or the world\'s ("NED", "ENU", "NWU").',
        'unit: "m/s", "cm/s", "mm/s" or "kn".',
    ),
    "rates": ('Of the body about its axes x, y, z. frame: "FRD" or "FLU"; unit: "rad/s" or "deg/s".',),
    "commands": (
        'In the order of the thrusters in the vehicle file. unit: "1" for -1 to 1, "percent", or "pwm" with',
        'pwm = {min = 1100, neutral = 1500, max = 1900}. A reversed one: {column = "NAME", reverse = true}.',
    ),
}
_DEFAULTS: dict[str, dict[str, Any]] = {
    "time": {"unit": "s"},
    "position": {"world": "NED", "unit": "m"},
    "attitude": {"unit": "rad", "world": "NED", "body": "FRD"},
    "velocity": {"frame": "FRD", "unit": "m/s"},
    "rates": {"frame": "FRD", "unit": "rad/s"},
    "commands": {"unit": "1"},
    "voltage": {"unit": "V"},
}


def draft(blocks: Mapping[str, Any], columns: Sequence[str], log: str, *, blanks: bool = True) -> str:
    """Return the TOML text of a draft map: guessed blocks, blank blocks for all other sensors, and comments.

    Args:
        blocks: Guessed blocks by name.
        columns: All columns of the log.
        log: Name of the log.
        blanks: Write blocks that were not guessed with empty names; otherwise leave them out.
    """
    import tomlkit

    document = tomlkit.document()
    for line in (
        f"How `hydro import {in_shell(log)} --map THIS` reads that log.",
        "Guessed from the columns' names: check every line"
        + ("; fill in the empty names." if blanks else "."),
        f"The log has: {listed(columns)}",
        'A column may be {column = "NAME", scale = 1.0, offset = 0.0}: scale times its number plus offset.',
        'Any of them may have valid = "COLUMN", per = "COLUMN", lag = 0.1 [s]; see docs/map.md.',
        "Leave out position, attitude, velocity or rates without a sensor: their columns are then null.",
    ):
        document.add(tomlkit.comment(line))
    document.add("format", tomlkit.item("hydro-map/1"))
    optional: dict[str, dict[str, Any]] = {name: {} for name in _OPTIONAL if name in blocks}
    for name, empty in {**_EMPTY, **optional}.items():
        if not blanks and name not in blocks:
            continue
        given = blocks.get(name, empty)
        table = tomlkit.table()
        for line in _NOTES[name]:
            table.add(tomlkit.comment(line))
        for key, value in {**given, **_unstated_defaults(name, given)}.items():
            table.add(key, _inline(value))
        document.add(tomlkit.nl())
        document.add(name, table)
    return tomlkit.dumps(document)


def _inline(value: Any) -> Any:
    """Return a value in one line of TOML, also a column with scale and offset."""
    import tomlkit

    if not isinstance(value, Mapping):
        return tomlkit.item(value)
    table = tomlkit.inline_table()
    table.update(value)
    return table


def _unstated_defaults(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the default settings that a block does not state, so that a user sees them."""
    defaults = _DEFAULTS.get(name, {})
    if "quaternion" in given:
        defaults = {key: value for key, value in defaults.items() if key != "unit"}
    return {key: value for key, value in defaults.items() if key not in given}
