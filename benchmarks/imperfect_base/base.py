"""Vehicles with hulls of panels, and the files that describe them as well as the catalogue can.

The reference simulator flies a tapered hull of panels.  Its forces have no exact form in the catalogue, so
even the best file has an error far above the noise.  The file is made as by a user: the effects of the preset
are fitted to flights of the unchanged vehicle, and written with their standard errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.hidden_effects import flights, vehicles
from benchmarks.hidden_effects.plant import Array
from hydro.core.identification.fit import fit
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.panels import superellipsoid
from hydro.io import vehicle as files

UNCHANGED = 720.0
"""Default length of the flights of the unchanged vehicle [s]."""
GROUP = 100
"""Number of consecutive seeds with the same hulls, and so with the same fitted file of each preset."""
DEPTH = 20.0
"""Depth of the flights of unchanged vehicles [m]."""
NOISE = 0.5
"""Noise of the flights to which a file is fitted, relative to the ordinary noise."""
SESSIONS = 4
TAPER = (0.3, 0.7)
"""Share of the width that a stern, and half the share of the height that a bow may lack."""
FACETS = {"along": 12, "around": 12}
Hull = tuple[Array, NDArray[np.int64]]


@dataclass(frozen=True)
class Base:
    """An unchanged vehicle.

    Attributes:
        believed: The preset, with which the commands are computed.
        vehicle: The file fitted to the unchanged flights.
        hull: Vertices [m] and faces of the simulated hull.
        unchanged: Path of the flights to which the file was fitted, a raw table.
    """

    believed: Vehicle
    vehicle: Vehicle
    hull: Hull
    unchanged: Path


def hull(vehicle: Vehicle, taper: float) -> Hull:
    """Return vertices [m] and faces of a superellipsoid of the vehicle's size.

    The stern is narrower and the bow less high than the middle.

    Args:
        vehicle: The vehicle.
        taper: Part of the width that the stern loses; the bow loses half of that part of its height.
    """
    size, center = vehicle.hull, np.array(vehicle.hull.center, float)
    half = 0.5 * np.array([size.length, size.width, size.height])
    points, faces = superellipsoid(*(2.0 * half), center, **FACETS)
    x, y, z = ((points - center) / half).T
    y = y * (1.0 - taper * np.clip(-x, 0.0, 1.0))
    z = z * (1.0 - 0.5 * taper * np.clip(x, 0.0, 1.0))
    return center + half * np.column_stack([x, y, z]), faces


def of(preset: str, seed: int, seconds: float, folder: Path) -> Base:
    """Return the unchanged vehicle of a preset and of the group of a seed.

    Vehicle file and flights are made at the first call, and read from `folder` afterwards.

    Args:
        preset: Name of a vehicle of the benchmarks.
        seed: Seed of the study; several seeds form a group with one hull.
        seconds: Length of the flights to which the file is fitted [s].
        folder: Folder of vehicle files and flights.

    Raises:
        DataError: The fit fails.
    """
    group = seed // GROUP
    believed = vehicles.preset(preset)
    rng = np.random.default_rng([group, vehicles.PRESETS.index(preset), 17])
    shape = hull(believed, float(rng.uniform(*TAPER)))
    path = folder / f"base_{preset}_{group}_{seconds:g}s.toml"
    unchanged = path.with_suffix(".parquet")
    if not path.exists():
        rows = [round(seconds / SESSIONS / flights.DT)] * SESSIONS
        flown = pl.concat(
            flights.by_teacher(
                believed, (), rows=rows, depth=DEPTH, noise=NOISE, seed=90_000 + group, mesh=shape
            )
        )
        folder.mkdir(parents=True, exist_ok=True)
        flown.write_parquet(unchanged)
        own = [str(table["name"]) for table in believed.effect]
        files.write(_written(preset, fit(believed, flown, own).tables()), path)
    return Base(believed, files.read(path)[0], shape, unchanged)


def _written(preset: str, fitted: Sequence[dict[str, Any]]) -> str:
    """Return the preset's file with fitted effects in place of its own, as `hydro fit` writes it."""
    text = vehicles.file(preset).read_text()
    for table in fitted:
        text = files.set_effect(text, table)
    return text
