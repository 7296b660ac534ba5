"""Vehicles of the benchmark, errors of their files, and files completed by the hidden effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files

DATASETS = Path(__file__).resolve().parents[2] / "datasets"
PRESETS = ("auv151", "bluerov2_heavy", "remus100", "stonefish")
DAMPING = ("linear_damping", "quadratic_damping", "crossflow_drag", "coupled_damping", "cross_axis_drag")
WRONG = 0.25
"""Greatest relative error of a file's damping."""
STONEFISH: tuple[dict[str, Any], ...] = (
    {"name": "linear_damping", "diagonal": [20.0, 45.0, 70.0, 6.0, 12.0, 9.0]},
    {"name": "quadratic_damping", "diagonal": [110.0, 280.0, 400.0, 12.0, 45.0, 32.0]},
)
"""A damping for the vehicle file that has none."""


def file(name: str) -> Path:
    """Return the path of a preset's file; for the BlueROV2, the one with thrust in proportion to the command.

    The benchmark's simulator has simple thrust curves only, and its kept figures are for that file.
    """
    return DATASETS / ("logs/rov.toml" if name == "bluerov2_heavy" else f"vehicles/{name}.toml")


def preset(name: str) -> Vehicle:
    """Return a vehicle with its true damping, by the name of its file."""
    vehicle, _ = files.read(file(name))
    if name == "stonefish":
        vehicle = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, *STONEFISH))
    return vehicle


def misjudged(vehicle: Vehicle, rng: np.random.Generator, share: float = WRONG) -> Vehicle:
    """Return the vehicle with a random error, up to a share of its value, on each number of its damping."""

    def wrong(value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [wrong(inner) for inner in value]
        return value * rng.uniform(1.0 - share, 1.0 + share)

    tables = [
        {k: v if k == "name" else wrong(v) for k, v in table.items()} if table["name"] in DAMPING else table
        for table in vehicle.effect
    ]
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def damping_of(vehicle: Vehicle) -> list[str]:
    """Return the names of the file's effects to which `misjudged` adds errors."""
    return [str(table["name"]) for table in vehicle.effect if table["name"] in DAMPING]


def joined(vehicle: Vehicle, hidden: Iterable[Mapping[str, Any]]) -> Vehicle:
    """Return the vehicle with hidden effects, added to those of the same name that its file has."""
    tables = [dict(table) for table in vehicle.effect]
    for extra in hidden:
        place = next((i for i, table in enumerate(tables) if table["name"] == extra["name"]), None)
        if place is None:
            tables.append(dict(extra))
        else:
            tables[place] = _sum(tables[place], extra)
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def _sum(table: Mapping[str, Any], extra: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sum of two tables of one effect; a diagonal is added to a matrix as a matrix."""
    out = {k: v for k, v in table.items() if k not in ("standard_error", "fit")}
    for key, value in extra.items():
        if key == "name":
            continue
        if key == "diagonal" and "matrix" in out:
            out["matrix"] = (np.array(out["matrix"], float) + np.diag(value)).tolist()
        elif key == "matrix" and "diagonal" in out:
            out["matrix"] = (np.diag(out.pop("diagonal")) + np.array(value, float)).tolist()
        else:
            out[key] = (np.asarray(out.get(key, 0.0), float) + np.asarray(value, float)).tolist()
    return out
