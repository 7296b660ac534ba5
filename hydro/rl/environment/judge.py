"""Two passes over the fleet in compiled code: what all vehicles sense, and what their step was worth."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Array32, Mask
from hydro.core.compiled import jit
from hydro.core.vehicle.frames import quaternion_kernel
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST
from hydro.rl.environment.geometry import collision_kernel
from hydro.rl.environment.observation import observe_kernel
from hydro.rl.environment.reward import COLLISION, SUCCESS, effort_cost, obstacle_cost, posture, shaping
from hydro.rl.environment.tasks import PILLARS

RETURN, AGE, ENERGY, OVERSPEED, TOTALS = range(5)
"""Totals of an episode: sum of rewards, steps, seconds of full thrust, steps faster than is plausible."""
ARRIVED, TOUCHED, DIVERGED, FAST, TERMINATED, TRUNCATED, FLAGS = range(7)
RADIUS, STEPS, LIMIT, PERIOD = range(4)
POWER = 1.5  # an ideal propeller's power goes with this power of its thrust


@jit
def sense_kernel(
    mask: Mask,
    limits: Array32,
    fan: Array,
    reach: float,
    tank: Array,
    gravity: float,
    pose: Array,
    velocity: Array,
    specific_force: Array,
    targets: Array,
    pillars: Array,
    sigma: Array,
    noise: Array,
    rotation: Array,
    least: Array,
    out: Array32,
) -> None:
    """Observations of the vehicles of a mask (N,); arrays of N rows of what `observe_kernel` takes.

    `noise` is standard normal and scaled in place by `sigma` (36,); written are `rotation` (N, 9), `least`
    (N,), the nearest echo without noise, and `out` (N, 36).
    """
    for k in range(mask.size):
        if not mask[k]:
            continue
        for i in range(sigma.size):
            noise[k, i] *= sigma[i]
        quaternion_kernel(pose[k, 3:7], rotation[k])
        least[k] = observe_kernel(
            limits,
            fan,
            reach,
            tank,
            gravity,
            pose[k],
            velocity[k],
            specific_force[k],
            rotation[k],
            targets[k],
            pillars[k],
            noise[k],
            out[k],
        )


@jit
def power_share(table: Array, thrust: Array) -> float:
    """Share of the power that all thrusters take at full thrust; thrust (n,) [N]."""
    total = 0.0
    for i in range(thrust.size):
        limit = table[i, MAX_THRUST] if thrust[i] > 0.0 else table[i, MAX_REVERSE]
        total += (abs(thrust[i]) / limit) ** POWER
    return float(total / max(thrust.size, 1))


@jit
def judge_kernel(
    weights: Array,
    hull: Array,
    tank: Array,
    table: Array,
    limits: Array,
    pose: Array,
    velocity: Array,
    thrust: Array,
    diverged: Mask,
    rotation: Array,
    stages: NDArray[np.int64],
    least: Array,
    goals: Array,
    targets: Array,
    pillars: Array,
    path_cost: Array,
    action: Array,
    before: Array,
    distance: Array,
    totals: Array,
    earned: Array32,
    flags: Mask,
) -> None:
    """Rewards, ends of episodes and totals of all vehicles.

    Args:
        weights: Of the reward.
        hull: Numbers of `rl.environment.geometry`.
        tank: Numbers of `rl.environment.geometry`.
        table: Thruster table (n, columns).
        limits: Radius of success [m], steps of an episode, implausible speed [m/s], control step [s].
        pose: (N, 7).
        velocity: (N, 6).
        thrust: (N, n).
        diverged: (N,).
        rotation: (N, 9).
        stages: Stage of each episode (N,).
        least: Nearest echo (N,).
        goals: (N, 3).
        targets: (N, 3).
        pillars: (N, P, 2).
        path_cost: Weighted cost of being off the path (N,).
        action: Demands (N, 6).
        before: Those of the step before (N, 6), replaced by these.
        distance: To the goal at the step before (N,), replaced by that of this step.
        totals: (N, TOTALS), advanced.
        earned: Rewards (N,), written.
        flags: (FLAGS, N), written.
    """
    for k in range(distance.size):
        x, y, z = goals[k, 0] - pose[k, 0], goals[k, 1] - pose[k, 1], goals[k, 2] - pose[k, 2]
        away = math.sqrt(x * x + y * y + z * z)
        failed = bool(diverged[k])
        touched = not failed and collision_kernel(hull, tank, pose[k], rotation[k], pillars[k])
        arrived = not failed and not touched and away <= limits[RADIUS]
        power = power_share(table, thrust[k])
        gain = shaping(weights, distance[k], away) - effort_cost(weights, power, action[k], before[k])
        gain += posture(weights, rotation[k], targets[k, 0] - pose[k, 0], targets[k, 1] - pose[k, 1])
        if stages[k] >= PILLARS:
            gain -= obstacle_cost(weights, least[k]) + path_cost[k]
        if arrived:
            gain += weights[SUCCESS]
        if touched or failed:
            gain -= weights[COLLISION]
        speed = math.sqrt(velocity[k, 0] ** 2 + velocity[k, 1] ** 2 + velocity[k, 2] ** 2)
        fast = speed > limits[LIMIT]

        distance[k] = away
        for j in range(action.shape[1]):
            before[k, j] = action[k, j]
        totals[k, RETURN] += gain
        totals[k, AGE] += 1.0
        totals[k, ENERGY] += power * limits[PERIOD]
        totals[k, OVERSPEED] += 1.0 if fast else 0.0
        earned[k] = gain
        flags[ARRIVED, k], flags[TOUCHED, k], flags[DIVERGED, k], flags[FAST, k] = (
            arrived,
            touched,
            failed,
            fast,
        )
        flags[TERMINATED, k] = arrived or touched or failed
        flags[TRUNCATED, k] = not flags[TERMINATED, k] and totals[k, AGE] >= limits[STEPS]
