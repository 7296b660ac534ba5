"""Flights without a policy: replay, random commands, full thrust, and decay of the motion without thrust.

All fly in the kernels of the trainings, with control steps of 40 ms.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.divergence.cells import Cell
from benchmarks.kept_tables import Row
from hydro.core.columns import POSE, VELOCITY, Array, command_columns
from hydro.core.effects import inertia_matrix
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import euler_from_quaternion, quaternion_from_euler
from hydro.core.vehicle.rigid_body import mass_matrix, potential
from hydro.core.vehicle.thrusters import configuration_matrix
from hydro.io import table
from hydro.io.model import Model
from hydro.rl.environment.conditions import Condition, plant
from hydro.rl.environment.wrench import WrenchSettings
from hydro.rl.world.config import Settings

STRIDE = 2
"""Rows of a recording at 50 Hz per control step."""
DECAYS, RANDOM, SECONDS = 32, 64, 20.0
"""Flights without thrust of a kind, with random commands, and their duration [s], that of an episode."""
THRUSTED, UNTHRUSTED = ("replay", "random", "full"), {"decay": 1.0, "fast": 2.0}
"""Kinds of flights with thrust, and those without, with the multiple of the recorded velocities."""
LEAST = 1.0
"""Least kinetic energy at the start of a flight without thrust [J]; at rest a share of it means nothing."""
GAIN = 0.05
"""Gain of mechanical energy that counts, as a share of the kinetic energy at the start."""
CORRELATION = 0.95
"""Correlation of random commands of successive control steps: that of the exploration of the recipe `sac`."""
DEPTH = 50.0
"""Depth of the start [m], far from the surface."""
DRAWN = 800_000
"""Seed of the random commands, the same for all cells."""


class Flights(NamedTuple):
    """Starts and commands of N flights of T control steps.

    Attributes:
        pose: Poses (N, 7).
        velocity: Velocities (N, 6).
        commands: Commands of the n thrusters (T, N, n).
    """

    pose: Array
    velocity: Array
    commands: Array


class Motion(NamedTuple):
    """Motion of N flights: poses (T, N, 7), velocities (T, N, 6), and whether each diverged (N,)."""

    pose: Array
    velocity: Array
    diverged: NDArray[np.bool_]


def flights(vehicle: Vehicle, replay: Path) -> dict[str, Flights]:
    """Return all flights by kind, see `THRUSTED` and `UNTHRUSTED`.

    Args:
        vehicle: The vehicle.
        replay: Recording of the replay, which also has the starts of the flights without thrust.
    """
    recording = table.read(replay, "raw").frame
    steps, n = round(SECONDS / Settings().period), len(vehicle.thruster)
    pushes = np.sign(np.round(configuration_matrix(vehicle), 9))
    full = np.concatenate([pushes, -pushes])
    return {
        "replay": _replay(recording, vehicle),
        "random": _from_rest(_random(steps, RANDOM, n)),
        "full": _from_rest(np.broadcast_to(full, (steps, *full.shape))),
    } | {kind: _decay(recording, vehicle, steps, times) for kind, times in UNTHRUSTED.items()}


def _replay(recording: pl.DataFrame, vehicle: Vehicle) -> Flights:
    """Return the flight with the commands of a recording of one session."""
    commands = recording.select(command_columns(len(vehicle.thruster))).to_numpy().astype(np.float64)
    pose, velocity = _starts(recording[:1])
    return Flights(pose, velocity, commands[::STRIDE, None])


def _random(steps: int, count: int, thrusters: int) -> Array:
    """Return random commands (T, N, n): the hyperbolic tangent of an autoregressive process."""
    rng = np.random.default_rng(DRAWN)
    drawn = rng.standard_normal((steps, count, thrusters))
    for k in range(1, steps):
        drawn[k] = CORRELATION * drawn[k - 1] + np.sqrt(1.0 - CORRELATION**2) * drawn[k]
    return np.asarray(np.tanh(drawn))


def _from_rest(commands: Array) -> Flights:
    """Return flights that start level and at rest."""
    pose = np.zeros((commands.shape[1], 7))
    pose[:, 2], pose[:, 3] = DEPTH, 1.0
    return Flights(pose, np.zeros((len(pose), 6)), commands)


def _decay(recording: pl.DataFrame, vehicle: Vehicle, steps: int, times: float) -> Flights:
    """Return flights without thrust from moving rows of a recording, at a multiple of their velocities."""
    pose, velocity = _starts(recording)
    moving = np.flatnonzero(kinetic(vehicle, velocity) >= LEAST)
    chosen = moving[np.linspace(0, len(moving) - 1, DECAYS).astype(np.int64)]
    still = np.zeros((steps, DECAYS, len(vehicle.thruster)))
    return Flights(pose[chosen], times * velocity[chosen], still)


def _starts(rows: pl.DataFrame) -> tuple[Array, Array]:
    """Return poses (N, 7) and velocities (N, 6) of rows."""
    eta, nu = (rows.select(*names).to_numpy().astype(np.float64) for names in (POSE, VELOCITY))
    pose = np.hstack([eta[:, :3], quaternion_from_euler(*eta[:, 3:].T)])
    return pose, nu


def kinetic(vehicle: Vehicle, nu: Array) -> Array:
    """Return the kinetic energy of velocities (..., 6) with the added mass [J]."""
    mass = mass_matrix(vehicle) + inertia_matrix(vehicle)
    return np.asarray(0.5 * np.einsum("...i,ij,...j->...", nu, mass, nu))


def energy(vehicle: Vehicle, pose: Array, nu: Array) -> Array:
    """Return the mechanical energy of poses (..., 7) and velocities (..., 6): kinetic and potential [J]."""
    phi, theta, _ = np.moveaxis(euler_from_quaternion(pose[..., 3:]), -1, 0)
    return np.asarray(kinetic(vehicle, nu) + potential(vehicle, pose[..., 2], phi, theta))


def fly(vehicle: Vehicle, condition: Condition, given: Flights) -> Motion:
    """Fly all flights under a condition, in the kernels."""
    fleet = plant(condition, vehicle, Settings(engine="kernels"), len(given.pose))
    everyone = np.ones(len(given.pose), dtype=np.bool_)
    fleet.reset(everyone, given.pose, given.velocity)
    poses, velocities = [given.pose.copy()], [given.velocity.copy()]
    for commands in given.commands:
        fleet.step(np.ascontiguousarray(commands))
        poses.append(fleet.pose.copy())
        velocities.append(fleet.velocity.copy())
    return Motion(np.stack(poses), np.stack(velocities), fleet.diverged.copy())


def condition_of(cell: Cell, name: str, model: Model | None) -> Condition:
    """Return the physics of a cell with a network."""
    return Condition(name, model, cell.conditioning, WrenchSettings(lead=cell.lead))


def measure(vehicle: Vehicle, condition: Condition, given: dict[str, Flights]) -> Row:
    """Return the results of all flights of one network.

    Returns:
        For each kind with thrust: `exploded_KIND` and `flights_KIND`, the flights that exploded, and all.
        For each without: `gaining_KIND`, the share of flights that gained energy; `gain_KIND`, the greatest
        gain as a share of the kinetic energy at the start; `left_KIND`, the median share of it at the end.
        `numerical`, all flights whose state was not finite or above 10^10; `fastest`, the greatest speed of
        the flights with thrust [m/s].
    """
    row: Row = {"numerical": 0, "fastest": 0.0}
    for kind, some in given.items():
        motion = fly(vehicle, condition, some)
        row["numerical"] += int(motion.diverged.sum())
        if kind in UNTHRUSTED:
            row |= {f"{name}_{kind}": value for name, value in _energies(vehicle, motion).items()}
            continue
        fastest = np.linalg.norm(motion.velocity[..., :3], axis=-1).max(axis=0)
        exploded = motion.diverged | (fastest > Settings().overspeed)
        row |= {f"exploded_{kind}": int(exploded.sum()), f"flights_{kind}": len(exploded)}
        row["fastest"] = max(row["fastest"], float(fastest.max()))
    return row


def _energies(vehicle: Vehicle, motion: Motion) -> Row:
    """Return gains and losses of energy of flights without thrust."""
    whole = energy(vehicle, motion.pose, motion.velocity)
    begun = kinetic(vehicle, motion.velocity[0])
    gain = (whole.max(axis=0) - whole[0]) / begun
    left = kinetic(vehicle, motion.velocity[-1]) / begun
    gaining = motion.diverged | (gain > GAIN)
    return {"gaining": float(gaining.mean()), "gain": float(gain.max()), "left": float(np.median(left))}
