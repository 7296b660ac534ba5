"""Recordings of the benchmark: one vehicle with a hidden effect, flown in one of three simulators.

`independent` is the benchmark's own (`plant`), under steps, several sines and chirps with a slack hold of
depth and attitude; `simulate` is `hydro simulate` under commands without feedback; `by_teacher` flies the
embedded simulator of `hydro collect`.  All start every session at rest with a heading of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from benchmarks.hidden_effects.build import build
from benchmarks.hidden_effects.plant import BODY, Plant, fly
from hydro.core.columns import POSE, VELOCITY, Array
from hydro.core.errors import DataError
from hydro.core.simulation.excitation import Session, demands
from hydro.core.simulation.sensor_noise import PROFILES, Noise, disturb
from hydro.core.vehicle.description import Vehicle

DT = 0.02
KINDS = ("steps", "sines", "chirps", "steps", "sines")
TILT = 0.4  # rad of roll and of pitch that a demand may ask for
DECK = ("walk", "coupled", "walk", "coupled", "walk")
Tables = Sequence[Mapping[str, Any]]


def scaled(noise: float) -> Noise:
    """Return the ordinary sensor noise multiplied by a factor."""
    one = PROFILES["ordinary"]
    return Noise(*(noise * size for size in (one.velocity, one.rate, one.position, one.attitude)))


def table(
    session: str, motion: Array, commands: Array, noise: float, rng: np.random.Generator
) -> pl.DataFrame:
    """Return the raw table of one session.

    Args:
        session: Name of the session.
        motion: Motion (N, 12).
        commands: Commands (N, n).
        noise: Factor on the ordinary noise that is added.
        rng: Random generator.
    """
    logged = disturb(motion, scaled(noise), rng)
    columns: dict[str, Any] = {"session": [session] * len(motion), "t": np.arange(len(motion)) * DT}
    columns |= dict(zip((*POSE, *VELOCITY), logged.T, strict=True))
    return pl.DataFrame(columns | {f"cmd_{i + 1}": c for i, c in enumerate(commands.T)})


def independent(
    believed: Vehicle,
    actual: Vehicle,
    hidden: Tables,
    foreign: Mapping[str, float],
    *,
    rows: Sequence[int],
    depth: float,
    noise: float,
    seed: int,
    laws: Sequence[Sequence[float]] = (),
) -> list[pl.DataFrame]:
    """Fly sessions in the benchmark's own simulator.

    Args:
        believed: The vehicle file used for the commands.
        actual: The vehicle with its true damping.
        hidden: Additional `[[effect]]` tables.
        foreign: Values of effects outside the catalogue, by name.
        rows: Rows of each session.
        depth: Depth at which sessions begin and are held [m].
        noise: Factor on the ordinary noise.
        seed: Seed of headings, demands and noise.
        laws: Further forces, rows of `Plant.laws`.
    """
    plant, file = build(actual, hidden, foreign, laws), build(believed)
    allocation, gains, reach = np.linalg.pinv(file.thrusts.T), holds(file), reached(file)
    tables = []
    for number, (kind, count) in enumerate(zip(KINDS, rows, strict=False)):
        rng = np.random.default_rng([seed, number, 3])
        demand = excited(kind, count, rng) * reach
        first = np.zeros(BODY)
        heading = rng.uniform(-np.pi, np.pi)
        first[2], first[3], first[6] = depth, np.cos(0.5 * heading), np.sin(0.5 * heading)
        states, commands = fly(plant, file, allocation, gains, demand, first, DT)
        if not np.isfinite(states).all():
            raise DataError(f"the motion of {believed.name} diverges")
        motion = np.hstack([placed(states, hidden), angles(states[:, 3:7]), logged(states, hidden)])
        tables.append(table(f"s{number}", motion, commands, noise, rng))
    return tables


def authority(thrusts: Array, limits: Array) -> Array:
    """Return the greatest wrench on each axis alone, (6,) [N, N m]; 0 where the thrusters have none.

    Args:
        thrusts: Unit wrenches of the thrusters (n, 6).
        limits: Greatest thrust of each thruster (n,) [N].
    """
    out, inverse = np.zeros(6), np.linalg.pinv(thrusts.T)
    for axis, unit in enumerate(np.eye(6)):
        if np.abs(thrusts.T @ inverse @ unit - unit).max() < 1e-6:
            out[axis] = (limits / np.maximum(np.abs(inverse @ unit), 1e-9)).min()
    return out


def holds(file: Plant) -> Array:
    """Return stiffness and damping of the hold of depth, roll and pitch, (3, 2); 0 without authority."""
    inertia = np.diag(file.rigid + file.added)[[2, 3, 4]]
    able = authority(file.thrusts, file.limits.min(axis=1))[[2, 3, 4]] > 0.0
    frequency = np.array([0.15, 1.5, 1.5])
    return np.column_stack([inertia * frequency**2, 1.4 * inertia * frequency]) * able[:, None]


def reached(file: Plant) -> Array:
    """Return the wrench (6,) of a demand of 1: the greatest, or that which tilts the vehicle by TILT."""
    out = authority(file.thrusts, file.limits.min(axis=1))
    righting = float((file.weights[:, 0] * file.weights[:, 3]).sum())
    out[3:5] = np.minimum(out[3:5], TILT * (righting + holds(file)[1:, 0]))
    return out


def excited(kind: str, rows: int, rng: np.random.Generator) -> Array:
    """Return demands (rows, 6) of one kind of excitation, as shares of the greatest wrench."""
    t = np.arange(rows) * DT
    size = rng.uniform([0.4, 0.4, 0.3, 0.3, 0.3, 0.1], [0.8, 0.8, 0.6, 1.0, 1.0, 0.4])
    out = np.zeros((rows, 6))
    out[:, 0] = rng.uniform(0.0, 0.8)  # way ahead
    for axis in range(6):
        if kind == "steps":
            edges = np.cumsum(rng.uniform(2.0, 8.0, 1 + int(t[-1] / 2.0)))
            out[:, axis] = rng.uniform(-1.0, 1.0, edges.size + 1)[np.searchsorted(edges, t)]
        elif kind == "sines":
            for frequency in rng.uniform(0.015, 0.5, 4):
                out[:, axis] += 0.4 * np.sin(2 * np.pi * (frequency * t + rng.uniform()))
        else:  # chirps, each axis in its turn and a little of all
            low, high, length = 0.03, 0.6, t[-1] + DT
            phase = low * t + 0.5 * (high - low) * t**2 / length
            turn = np.floor(6.0 * t / length).astype(int) == (axis + rng.integers(6)) % 6
            out[:, axis] = np.sin(2 * np.pi * (phase + rng.uniform())) * np.where(turn, 1.2, 0.5)
    return np.clip(out * size, -1.0, 1.0)


def angles(q: Array) -> Array:
    """Return roll, pitch and yaw (N, 3) [rad] of quaternions (N, 4) (Fossen 2.58)."""
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    return np.column_stack(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ]
    )


def placed(states: Array, hidden: Tables) -> Array:
    """Return the logged position (N, 3): p + R r, for the reference point r of a hidden position error."""
    point = np.zeros(3)
    for effect in hidden:
        if effect["name"] == "reference_point":
            point = point + effect["r"]
    turned: Array = Rotation.from_quat(states[:, 3:7], scalar_first=True).apply(point)
    return states[:, :3] + turned


def logged(states: Array, hidden: Tables) -> Array:
    """Return the logged velocity (N, 6): (1 + s) R(alpha)^T [v(t - d) + omega(t - d) x r] + b.

    Scale s, rotation alpha, delay d, position r and bias b are those of the hidden DVL errors.
    """
    scale, tilt, lever, bias, delay = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), 0.0
    for effect in hidden:
        match effect["name"]:
            case "sensor_scale":
                scale = scale + np.asarray(effect.get("axes", effect.get("s")))
            case "sensor_misalignment":
                tilt = tilt + effect["alpha"]
            case "sensor_lever_arm" | "reference_point":
                lever = lever + effect["r"]
            case "sensor_bias":
                bias = bias + effect["b"]
            case "sensor_delay":
                delay += effect["d"]
    out = states[:, 7:BODY].copy()
    local, t = out[:, :3] + np.cross(out[:, 3:], lever), np.arange(len(out)) * DT
    local = CubicSpline(t, local)(np.maximum(t - delay, 0.0)) if delay else local
    (cr, cp, cy), (sr, sp, sy) = np.cos(tilt), np.sin(tilt)
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    out[:, :3] = (1.0 + scale) * (local @ (yaw @ pitch @ roll)) + bias
    return out


def by_simulate(
    believed: Vehicle, actual: Vehicle, *, rows: Sequence[int], depth: float, noise: float, seed: int
) -> list[pl.DataFrame]:
    """Fly sessions in `hydro simulate` without feedback; `actual` contains the hidden effects."""
    from hydro.core.simulation.simulate import simulate

    file, tables = build(believed), []
    share, limits = np.linalg.pinv(file.thrusts.T), file.limits.max(axis=1)
    greatest = np.abs(file.thrusts.T) @ limits
    for number, (kind, count) in enumerate(zip(DECK, rows, strict=False)):
        rng = np.random.default_rng([seed, number, 5])
        demand = 0.5 * demands(Session(str(number), kind, count, number), seed, DT) * greatest
        level = np.clip(demand @ share.T / limits, -1.0, 1.0)
        level = np.sign(level) * np.abs(level) ** (1.0 / file.chains[:, 0])
        columns: dict[str, Any] = {"session": ["x"] * count, "t": np.arange(count) * DT}
        columns |= {name: np.zeros(count) for name in (*POSE, *VELOCITY)}
        columns |= {"z": np.full(count, depth), "psi": np.full(count, rng.uniform(-np.pi, np.pi))}
        flown = simulate(actual, pl.DataFrame(columns | {f"cmd_{i + 1}": c for i, c in enumerate(level.T)}))
        motion = flown.select(*POSE, *VELOCITY).to_numpy()
        tables.append(table(f"s{number}", motion, level, noise, rng))
    return tables


def by_teacher(
    believed: Vehicle,
    hidden: Tables,
    *,
    rows: Sequence[int],
    depth: float,
    noise: float,
    seed: int,
    mesh: tuple[Array, Any] | None = None,
) -> list[pl.DataFrame]:
    """Fly sessions in the embedded simulator, which holds depth, roll and pitch.

    Args:
        believed: Vehicle of the file.
        hidden: Hidden effects.
        rows: Number of rows of each session.
        depth: Depth of the start and of the hold [m].
        noise: Sensor noise relative to the ordinary noise.
        seed: Seed of demands and noise.
        mesh: Mesh of the hull; None for a superellipsoid.

    Returns:
        Raw table of each session.
    """
    from hydro.core.effects import sensor
    from hydro.sim import teacher

    subject, tables = teacher.teacher(believed, mesh=mesh, hidden=hidden), []
    for number, (kind, count) in enumerate(zip(DECK, rows, strict=False)):
        rng = np.random.default_rng([seed, number, 7])
        demand = demands(Session(str(number), kind, count, number), seed, DT)
        motion, commands = teacher.fly(subject, demand, depth=depth, heading=rng.uniform(-np.pi, np.pi))
        motion[:, 6:] = sensor.measured(subject.log, np.arange(count) * DT, motion[:, 6:])
        tables.append(table(f"s{number}", motion, commands, noise, rng))
    return tables
