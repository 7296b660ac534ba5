"""Sixty seconds of commands for four vehicles, and the motion that `simulate` computes."""

from __future__ import annotations

from functools import cache

import numpy as np
import polars as pl

from hydro.core.columns import MOTION, command_columns
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import euler_from_quaternion
from hydro.export.python_class import class_name, to_python
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


def class_of(craft):
    """Return the vehicle of an exported file."""
    namespace = {}
    exec(compile(to_python(craft), "exported", "exec"), namespace)
    return namespace[class_name(craft.name)]()


def motion_of_class(exported, commands, eta=(0.0,) * 6, nu=(0.0,) * 6, steps=1):
    """Return the motion (N, 12) under commands held for a row each."""
    eta, nu, u_actual = list(eta), list(nu), list(exported.u_actual)
    rows = [eta + nu]
    for row in commands[:-1].tolist():
        for _ in range(steps):
            eta, nu, u_actual = exported.step(eta, nu, u_actual, row, DT / steps)
        rows.append(eta + nu)
    return np.array(rows)


def motion_of_functions(made, commands, eta=(0.0,) * 6, nu=(0.0,) * 6):
    """Return the motion (N, 12) under commands held for a row each."""
    first = made.start(list(eta), list(nu))
    after = made.step.mapaccum(len(commands) - 1)(first, commands[:-1].T)
    states = np.hstack([np.array(first), np.array(after)]).T
    return np.hstack([states[:, :3], euler_from_quaternion(states[:, 3:7]), states[:, 7:13]])
