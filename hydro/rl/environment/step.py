"""Two passes over the fleet in compiled code: what all vehicles sense, and what their step was worth."""

from __future__ import annotations

import math

from hydro.core.columns import Array, Array32, Mask
from hydro.core.compiled import jit
from hydro.core.vehicle.frames import quaternion_kernel
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST
from hydro.rl.environment.blocks import (
    AGE,
    ARRIVED,
    DIVERGED,
    ENERGY,
    FAST,
    LIMIT,
    OVERSPEED,
    PERIOD,
    RADIUS,
    RETURN,
    STEPS,
    TERMINATED,
    TOUCHED,
    TRUNCATED,
    Episodes,
    Motion,
    Outcome,
    Rules,
    Scenes,
    Senses,
)
from hydro.rl.environment.geometry import collision_kernel
from hydro.rl.environment.observation import observe_kernel
from hydro.rl.environment.reward import COLLISION, SUCCESS, effort_cost, obstacle_cost, posture, shaping
from hydro.rl.environment.tasks import PILLARS

POWER = 1.5  # an ideal propeller's power goes with this power of its thrust


@jit
def sense_kernel(
    mask: Mask, senses: Senses, motion: Motion, scenes: Scenes, noise: Array, nearest: Array, out: Array32
) -> None:
    """Observations of the vehicles of a mask.

    Args:
        mask: Which vehicles (N,).
        senses: Their sensors.
        motion: Their motion; the rotation is written.
        scenes: Their tasks.
        noise: Standard normal (N, 36); scaled in place.
        nearest: The nearest echo without noise (N,), written.
        out: Observations (N, 36), written.
    """
    for k in range(mask.size):
        if not mask[k]:
            continue
        for i in range(senses.sigma.size):
            noise[k, i] *= senses.sigma[i]
        quaternion_kernel(motion.pose[k, 3:7], motion.rotation[k])
        nearest[k] = observe_kernel(senses, motion, scenes, k, noise[k], out[k])


@jit
def power_share(table: Array, thrust: Array) -> float:
    """Share of the power that all thrusters take at full thrust; thrust (n,) [N]."""
    total = 0.0
    for i in range(thrust.size):
        limit = table[i, MAX_THRUST] if thrust[i] > 0.0 else table[i, MAX_REVERSE]
        if limit > 0.0:  # no servo
            total += (abs(thrust[i]) / limit) ** POWER
    return float(total / max(thrust.size, 1))


@jit
def distance(goal: Array, pose: Array) -> float:
    """From a pose (7,) to a goal (3,) [m]."""
    x, y, z = goal[0] - pose[0], goal[1] - pose[1], goal[2] - pose[2]
    return math.sqrt(x * x + y * y + z * z)


@jit
def step_kernel(
    rules: Rules, motion: Motion, scenes: Scenes, episodes: Episodes, actions: Array, outcome: Outcome
) -> None:
    """Rewards, ends of episodes and totals of all vehicles; `episodes` and `outcome` are written.

    Args:
        rules: Reward and ends.
        motion: After the step.
        scenes: The tasks.
        episodes: As the step before left them.
        actions: Demands of this step (N, 6).
        outcome: Of this step.
    """
    for k in range(actions.shape[0]):
        away = distance(scenes.goals[k], motion.pose[k])
        mark_ends(rules, motion, scenes, k, away, outcome.flags)
        power = power_share(rules.table, motion.thrust[k])
        gain = shaping(rules.weights, episodes.distance[k], away)
        gain -= effort_cost(rules.weights, power, actions[k], episodes.action[k])
        north, east = scenes.targets[k, 0] - motion.pose[k, 0], scenes.targets[k, 1] - motion.pose[k, 1]
        gain += posture(rules.weights, motion.rotation[k], north, east)
        if scenes.stages[k] >= PILLARS:
            gain -= obstacle_cost(rules.weights, episodes.nearest[k]) + scenes.path_cost[k]
        if outcome.flags[ARRIVED, k]:
            gain += rules.weights[SUCCESS]
        if outcome.flags[TOUCHED, k] or outcome.flags[DIVERGED, k]:
            gain -= rules.weights[COLLISION]
        outcome.reward[k] = gain

        episodes.distance[k] = away
        for j in range(actions.shape[1]):
            episodes.action[k, j] = actions[k, j]
        episodes.totals[k, RETURN] += gain
        episodes.totals[k, AGE] += 1.0
        episodes.totals[k, ENERGY] += power * rules.limits[PERIOD]
        episodes.totals[k, OVERSPEED] += 1.0 if outcome.flags[FAST, k] else 0.0
        late = episodes.totals[k, AGE] >= rules.limits[STEPS]
        outcome.flags[TRUNCATED, k] = not outcome.flags[TERMINATED, k] and late


@jit
def mark_ends(rules: Rules, motion: Motion, scenes: Scenes, k: int, away: float, flags: Mask) -> None:
    """Write the flags of vehicle `k`, `away` [m] from its goal: all but whether its time is up."""
    failed = bool(motion.diverged[k])
    touched = not failed and collision_kernel(
        rules.hull, rules.tank, motion.pose[k], motion.rotation[k], scenes.pillars[k]
    )
    arrived = not failed and not touched and away <= rules.limits[RADIUS]
    u, v, w = motion.velocity[k, 0], motion.velocity[k, 1], motion.velocity[k, 2]
    flags[ARRIVED, k], flags[TOUCHED, k], flags[DIVERGED, k] = arrived, touched, failed
    flags[FAST, k] = math.sqrt(u**2 + v**2 + w**2) > rules.limits[LIMIT]
    flags[TERMINATED, k] = arrived or touched or failed
