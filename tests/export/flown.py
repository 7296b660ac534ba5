"""Sixty seconds of commands for four vehicles, and the motion that `simulate` computes."""

from __future__ import annotations

from functools import cache

import numpy as np
import polars as pl

from hydro.core.columns import MOTION, command_columns
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as vehicle_file

VEHICLES = ("auv151", "bluerov2_heavy", "remus100", "stonefish")
SECONDS, DT = 60.0, 0.02
GENTLE = {"stonefish": 0.2}
"""A share of the commands for a vehicle whose file has no drag."""


@cache
def vehicle(datasets, name: str) -> Vehicle:
    return vehicle_file.read(datasets / "vehicles" / f"{name}.toml")[0]


@cache
def commanded(thrusters: int, share: float = 1.0, seconds: float = SECONDS) -> pl.DataFrame:
    """Return smooth commands of one session, with a jump in each channel."""
    rng = np.random.default_rng(1)
    t = np.arange(round(seconds / DT) + 1) * DT
    frequency, phase = rng.uniform(0.03, 0.4, thrusters), rng.uniform(0.0, 6.0, thrusters)
    commands = 0.5 * np.sin(2 * np.pi * frequency * t[:, None] + phase)
    commands += 0.3 * (t[:, None] > rng.uniform(5.0, 50.0, thrusters))
    columns = dict(zip(command_columns(thrusters), share * commands.T, strict=True))
    return pl.DataFrame({"session": ["s"] * len(t), "t": t} | columns)


@cache
def flown(datasets, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return commands (N, n) and the motion (N, 12) of a vehicle under them, by `simulate`."""
    craft = vehicle(datasets, name)
    table = commanded(len(craft.thruster), GENTLE.get(name, 1.0))
    return given(table), simulate(craft, table).select(MOTION).to_numpy()


def given(table: pl.DataFrame) -> np.ndarray:
    return table.select("^cmd_.*$").to_numpy()


def apart(motion: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference of two motions (N, 12), with wrapped angles."""
    difference = np.asarray(motion) - np.asarray(other)
    difference[:, 3:6] = (difference[:, 3:6] + np.pi) % (2.0 * np.pi) - np.pi
    return float(np.abs(difference).max())
