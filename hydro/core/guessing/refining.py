"""Refinement of a guessed map by column values: degrees, pulse widths, unused outputs, pressures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.guessing.presets import ATMOSPHERE, PRESSURE_UNITS, depth_of_pressure
from hydro.core.logs.conventions import FAR_OUT, in_degrees

Block = dict[str, Any]
Values = Callable[[str], Array | None]
"""Values of a column, in the order of the log; None if it has none."""
PULSES = (700.0, 2300.0)
"""Range of pulse widths of thruster controllers [us]; no other unit has commands in this range."""
WEATHER = 0.1
"""Relative deviation of the air pressure from the standard atmosphere, from a mountain lake to a high."""


def refined(blocks: Mapping[str, Block], values: Values) -> tuple[dict[str, Block], list[str]]:
    """Return guessed blocks of a map refined by the values of their columns, and a line of text per change.

    A block says which columns hold one quantity.  The given blocks do not change.  A unit stated in a
    column's name stays.

    Args:
        blocks: The blocks of a map by name, from `aliases.guess`.
        values: Function from the name of a column to its values, or to None if it has none.
    """
    found, notes = {name: dict(block) for name, block in blocks.items()}, []
    if (attitude := found.get("attitude")) is not None:
        notes += _attitude(attitude, values)
    if (commands := found.get("commands")) is not None:
        notes += _commands(commands, values)
    if (position := found.get("position")) is not None:
        notes += _pressure(found, position, values)
    return found, notes


def _attitude(block: Block, values: Values) -> list[str]:
    """Set the unit of angles that are beyond a whole turn."""
    if "columns" not in block or "unit" in block:
        return []
    angles = [each for each in map(values, block["columns"]) if each is not None]
    if len(angles) < 3 or not in_degrees(angles):
        return []
    block["unit"] = "deg"
    return [f"{', '.join(block['columns'])} are beyond a whole turn of 2 pi: taken for degrees"]


def _commands(block: Block, values: Values) -> list[str]:
    """Find the unit of commands, and drop outputs that are off or never at rest in the whole log."""
    numbers = {name: values(name) for name in block["columns"]}
    known = {name: each[np.isfinite(each)] for name, each in numbers.items() if each is not None}
    notes = []
    every = np.concatenate([np.empty(0), *known.values()])
    driven = every[every != 0.0]
    if "unit" not in block and len(driven):
        if PULSES[0] <= driven.min() and driven.max() <= PULSES[1]:
            block["unit"] = "pwm"
            notes.append(f"commands of {driven.min():g} to {driven.max():g} are taken for pulse widths [us]")
        elif np.abs(driven).max() > FAR_OUT and np.abs(driven).max() <= 100.0:
            block["unit"] = "percent"
            notes.append(f"commands of {driven.min():g} to {driven.max():g} are taken for percent")
    idle = [name for name, each in known.items() if _idle(each, pulsed=block.get("unit") == "pwm")]
    kept = [name for name in block["columns"] if name not in idle]
    if idle and kept:
        block["columns"] = kept
        notes.append(f"{', '.join(idle)} never drive a thruster and are left out: {len(kept)} thrusters")
    return notes


def _idle(values: Array, *, pulsed: bool) -> bool:
    """Return whether an output does not drive a thruster: empty, off, or constant but not at rest."""
    if not len(values):
        return True
    still = bool(np.ptp(values) == 0.0)
    return still and pulsed and values[0] != 1500.0


def _pressure(found: dict[str, Block], block: Block, values: Values) -> list[str]:
    """Set the conversion of pressure to depth; air pressure at the surface shows an unknown unit."""
    source = block.get("depth")
    if not isinstance(source, dict) or "pressure" not in block:
        return []
    unit = block.pop("pressure")
    name = source["column"]
    if unit is None:
        unit = _unit(values(name))
        if unit is None:
            del found["position"]
            return [
                f"depth by {name}: its unit is not known, for no reading is near the pressure of the air; "
                "say in a map depth = {column, scale, offset}"
            ]
    block["depth"] = depth_of_pressure(name, unit)
    return [
        f"depth by the pressure {name} [{unit}], with {ATMOSPHERE / 100.0:g} hPa at the surface and fresh "
        "water: correct scale and offset in a map"
    ]


def _unit(values: Array | None) -> str | None:
    """Return the unit in which the lowest pressure of a log is that of the air, if any."""
    if values is None or not np.isfinite(values).any():
        return None
    lowest = float(np.nanmin(values))
    units: Sequence[str] = [
        unit for unit, pascal in PRESSURE_UNITS.items() if abs(lowest * pascal / ATMOSPHERE - 1.0) < WEATHER
    ]
    return units[0] if units else None
