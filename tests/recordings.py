"""Recordings to test with: a simulated vehicle under slow sines, and a body that turns over and over."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np
import polars as pl
import synthetic
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from hydro.core.columns import POSE, VELOCITY
from hydro.core.recording.arrays import recording
from hydro.core.recording.sensor_faults import faults
from hydro.core.simulation.sensor_noise import PROFILES, Noise, disturb
from hydro.core.simulation.simulate import simulate

ORDINARY, DT, FINE = PROFILES["ordinary"], 0.02, 20
ROWS = 3000
DAMPING = (
    {"name": "linear_damping", "diagonal": synthetic.LINEAR.tolist()},
    {"name": "quadratic_damping", "diagonal": synthetic.QUADRATIC.tolist()},
)
HULL = {"name": "crossflow_drag", "Cd_y": 0.8, "Cd_z": 0.8}
"""What the vehicle of `flown` does beside the file of `damped`,"""
WEAK = {"name": "thruster_gain", "g": [0.0, -0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
"""and a change of it."""


def noisy(frame: pl.DataFrame, seed: int) -> pl.DataFrame:
    logged = disturb(
        frame.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], np.random.default_rng(seed)
    )
    return frame.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


def damped(*effects):
    known = synthetic.vehicle()
    return msgspec.structs.replace(known, effect=(*known.effect, *DAMPING, *effects))


def moved(vehicle, *, seed=0, rows=2000, thrusters=range(8)) -> pl.DataFrame:
    """A recording of one session: a different slow sine on each of the thrusters named."""
    rng, t = np.random.default_rng(seed), np.arange(rows) * 0.02
    columns = {"session": ["a"] * rows, "t": t}
    for i in range(len(vehicle.thruster)):
        wave = 0.6 * np.sin(2 * np.pi * rng.uniform(0.05, 0.4) * t + rng.uniform(0, 6))
        columns[f"cmd_{i + 1}"] = wave if i in thrusters else np.zeros(rows)
    return simulate(vehicle, pl.DataFrame(columns))


@cache
def tumbling(seconds: float = 80.0, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Times, position, rotation, velocity and rates of a body that turns over and over."""
    rng, n = np.random.default_rng(seed), round(seconds / DT) * FINE
    t = np.arange(n + 1) * DT / FINE
    waves = rng.uniform(0.05, 0.5, (6, 2, 1)), rng.uniform(0.0, 6.0, (6, 2, 1))
    nu = np.sin(2.0 * np.pi * waves[0] * t + waves[1]).sum(axis=1).T * ([0.5] * 3 + [0.4] * 3)
    turns = Rotation.from_rotvec(0.5 * (nu[:-1, 3:] + nu[1:, 3:]) * DT / FINE)
    R = np.tile(np.eye(3), (n + 1, 1, 1))
    for k, turn in enumerate(turns.as_matrix()):
        R[k + 1] = R[k] @ turn
    over_ground = np.einsum("kij,kj->ki", R, nu[:, :3])
    x = CubicSpline(t, over_ground).antiderivative()(t)
    rows = slice(None, None, FINE)
    return t[rows], x[rows], R[rows], nu[rows, :3], nu[rows, 3:]


def log(noise: Noise = ORDINARY, seed: int = 0) -> pl.DataFrame:
    """A raw table of the tumbling body."""
    t, x, R, v, omega = (part[:ROWS] for part in tumbling())
    angles = Rotation.from_matrix(R).as_euler("ZYX")[:, ::-1]
    motion = disturb(np.hstack([x, angles, v, omega]), noise, np.random.default_rng(seed))
    table = pl.DataFrame(np.column_stack([t, motion]), schema=["t", *POSE, *VELOCITY])
    still = [pl.lit(0.0).alias(f"cmd_{i + 1}") for i in range(8)]
    return table.with_columns(pl.lit("a").alias("session"), *still)


def spoilt(raw: pl.DataFrame, **changed: np.ndarray) -> pl.DataFrame:
    return raw.with_columns(pl.Series(name, values) for name, values in changed.items())


def found(raw: pl.DataFrame):
    return faults(recording(synthetic.vehicle(), raw))


def flown(*effects: dict, seed: int, rows: int = 800) -> pl.DataFrame:
    """Four sessions of a vehicle whose hull its file does not describe, and with changes.

    Four times 16 s are just long enough to learn what the hull does.
    """
    return four_sessions(damped(HULL, *effects), seed, rows)


def four_sessions(vehicle, seed: int, rows: int = 800) -> pl.DataFrame:
    """Four sessions of a vehicle, with noise."""
    sessions = [
        noisy(moved(vehicle, seed=seed + i, rows=rows), seed + i).with_columns(session=pl.lit(f"s{i}"))
        for i in range(4)
    ]
    return pl.concat(sessions)
