"""CUDA kernels of a fleet: commands, observations, rewards and ends; one thread per vehicle.

All computations are functions of `rl.environment`, which the processor runs too.  Arguments are blocks of
arrays; see `sim.gpu.kernels`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from hydro.core.columns import Array, Array32, Mask
from hydro.core.compiled import copy_kernel
from hydro.rl.environment.action import ACTIONS, allocate
from hydro.rl.environment.blocks import Episodes, Motion, Outcome, Rules, Scenes, Senses
from hydro.rl.environment.step import distance, score, sense


class Pool(NamedTuple):
    """Pool of S scenes drawn in advance, each with up to P pillars; each vehicle flies one scene per episode.

    Attributes:
        poses: Initial poses (S, 7), see `sim.plant.Plant`.
        goals: Positions of the goals (S, 3), NED [m].
        pillars: x y of the pillars' axes (S, P, 2) [m], NaN in unused rows.
    """

    poses: Array
    goals: Array
    pillars: Array


class Starts(NamedTuple):
    """Vehicles that begin an episode, and their initial poses.

    Attributes:
        mask: Whether each of N vehicles begins, (N,).
        episode: Number of each vehicle's episode, (N,); -1 before the first.
        pose: Initial poses, which a kernel writes, (N, 7): position x y z [m], NED, and quaternion w x y z.
    """

    mask: Mask
    episode: NDArray[np.int64]
    pose: Array


class Allocation(NamedTuple):
    """Constants that convert the actions of policies to commands of n thrusters.

    Attributes:
        allocation: Pseudo-inverse of the matrix that maps thrusts to a wrench, (n, 6).
        table: Table of `core.vehicle.thrusters`, one row per thruster, (n, columns).
        authority: Greatest wrench on each axis alone, (6,) [N, N m]; 0 on an axis without authority.
    """

    allocation: Array
    table: Array
    authority: Array


class Demands(NamedTuple):
    """Actions of N vehicles, and the commands of their n thrusters that a kernel computes from them.

    Attributes:
        actions: Demanded wrenches as fractions of the authority, clipped to [-1, 1] in place, (N, 6).
        commands: Thruster commands in [-1, 1], (N, n).
    """

    actions: Array
    commands: Array


class View(NamedTuple):
    """Output of the observation kernel, with the mask and the noise that it reads.

    Attributes:
        mask: Vehicles to observe (N,).
        noise: Standard normal (N, 36); overwritten.
        out: Observations (N, 36), written.
    """

    mask: Mask
    noise: Array
    out: Array32


@cuda.jit  # type: ignore[untyped-decorator]
def place(pool: Pool, starts: Starts, scenes: Scenes, episodes: Episodes) -> None:
    """Copy the scene of the next episode from the pool to each vehicle that begins an episode.

    Args:
        pool: Scenes.
        starts: Vehicles that begin; their poses are written.
        scenes: Tasks of all vehicles, written.
        episodes: State of all episodes, written.
    """
    k = cuda.grid(1)
    if k >= starts.mask.size or not starts.mask[k]:
        return
    starts.episode[k] += 1
    row = (k + starts.episode[k] * starts.mask.size) % len(pool.poses)
    copy_kernel(pool.poses[row], starts.pose[k])
    copy_kernel(pool.goals[row], scenes.goals[k])
    copy_kernel(pool.goals[row], scenes.targets[k])
    for i in range(pool.pillars.shape[1]):
        copy_kernel(pool.pillars[row, i], scenes.pillars[k, i])
    for i in range(ACTIONS):
        episodes.action[k, i] = 0.0
    for i in range(episodes.totals.shape[1]):
        episodes.totals[k, i] = 0.0
    episodes.distance[k] = distance(pool.goals[row], pool.poses[row])


@cuda.jit  # type: ignore[untyped-decorator]
def command(crew: Allocation, demands: Demands) -> None:
    """Write the thruster commands that the actions in `demands` request.

    They are NaN for an action that is not finite, so that the vehicle diverges.
    """
    k = cuda.grid(1)
    if k >= demands.actions.shape[0]:
        return
    tau = cuda.local.array(ACTIONS, np.float64)
    if not allocate(
        crew.allocation, crew.table, crew.authority, demands.actions[k], tau, demands.commands[k]
    ):
        for i in range(demands.commands.shape[1]):
            demands.commands[k, i] = np.nan


@cuda.jit  # type: ignore[untyped-decorator]
def observe(senses: Senses, motion: Motion, scenes: Scenes, episodes: Episodes, view: View) -> None:
    """Write the observations of the vehicles of a mask, one thread per vehicle.

    Args:
        senses: Sensors.
        motion: Motion of all vehicles; the rotation is written.
        scenes: Tasks of all vehicles.
        episodes: State of all episodes; the nearest range is written.
        view: Mask, noise and the observations to write.
    """
    k = cuda.grid(1)
    if k < view.mask.size and view.mask[k]:
        sense(k, senses, motion, scenes, view.noise[k], episodes.nearest, view.out)


@cuda.jit  # type: ignore[untyped-decorator]
def evaluate_step(
    rules: Rules, motion: Motion, scenes: Scenes, episodes: Episodes, demands: Demands, outcome: Outcome
) -> None:
    """Write rewards and flags of a step of all vehicles, and update the totals of their episodes.

    The arguments are arrays on the device; `outcome` and `episodes` are written.
    """
    k = cuda.grid(1)
    if k < demands.actions.shape[0]:
        score(k, rules, motion, scenes, episodes, demands.actions[k], outcome)
