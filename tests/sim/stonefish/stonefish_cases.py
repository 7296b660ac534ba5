"""Flights in Stonefish for the tests, with the real program and with recorded answers."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import polars as pl

from hydro.core.columns import MOTION, command_columns
from hydro.core.vehicle.description import Vehicle
from hydro.io import mesh
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.sim.stonefish.plant import StonefishPlant
from hydro.sim.stonefish.program import NAME
from hydro.sim.stonefish.recorder import fly, stonefish_teacher
from hydro.sim.stonefish.scenario import Scenario

HERE = Path(__file__).resolve().parent
VEHICLE = bundled("vehicles") / "auv151.toml"
WALK = ["collect", "--vehicle", VEHICLE, "--teacher", "stonefish", "--rows", 100, "--seed", 3, "--depth", 20]
ALL = np.ones(1, dtype=bool)
POSE = np.array([[3.0, 4.0, 20.0, 0.9, 0.1, -0.3, 0.3]]) * [1, 1, 1, *[1.0 / np.sqrt(1.0 - 1e-9)] * 4]
VELOCITY = np.array([[0.5, -0.3, 0.2, 0.1, -0.2, 0.3]])


def craft() -> Vehicle:
    return files.read(VEHICLE)[0]


def recorded_vehicle() -> Scenario:
    """Return the vehicle of the bundled recordings, with its mesh."""
    folder = bundled("stonefish")
    surface = mesh.read_obj(folder / "hull.obj")
    return stonefish_teacher(files.read(folder / "vehicle.toml")[0], mesh=surface).scenario


def replayed(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the motion of the bundled replay as recorded and as simulated from its commands, (rows, 12)."""
    frame = pl.read_parquet(bundled("stonefish") / "replay90.parquet").head(rows)
    wanted = frame.select(MOTION).to_numpy().astype(float)
    held = frame.select(command_columns(8)).to_numpy().astype(float)
    motion, _ = fly(recorded_vehicle(), lambda k, _: held[k], rows, eta=wanted[0, :6], nu=wanted[0, 6:])
    return wanted, motion


def flown_twice() -> tuple[StonefishPlant, list[np.ndarray], list[np.ndarray]]:
    """Return the velocities of a plant's steps, and of the same steps after a return to half way."""
    plant = StonefishPlant(craft(), period=0.02)
    plant.reset(ALL, POSE, VELOCITY)
    held = np.random.default_rng(0).uniform(-0.8, 0.8, (12, 1, 8))
    first = [_stepped(plant, row) for row in held[:6]]
    half = plant.snapshot()
    first = [_stepped(plant, row) for row in held[6:]]
    plant.restore(half)
    return plant, first, [_stepped(plant, row) for row in held[6:]]


def _stepped(plant: StonefishPlant, commands: np.ndarray) -> np.ndarray:
    plant.step(commands)
    return np.concatenate([plant.pose[0], plant.velocity[0], plant.specific_force[0], plant.thrust[0]])


def program(folder: Path, *line: object) -> Path:
    """Create a program with the name of the real one that runs a Python script."""
    path = folder / NAME
    words = " ".join(f"'{word}'" for word in (sys.executable, "-S", *line[:2]))
    path.write_text(f'#!/bin/sh\nexec {words} "$1" {" ".join(map(str, line[2:]))}\n')
    path.chmod(0o755)
    return path
