"""Compiled kernels over the fleet: observations, then rewards and ends of episodes."""

from __future__ import annotations

import math

import numpy as np

from hydro.core.columns import Array, Array32, Mask
from hydro.core.compiled import kernel
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import quaternion_kernel
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST
from hydro.rl.environment.blocks import (
    AGE,
    ARRIVED,
    DIVERGED,
    ENERGY,
    ERROR,
    FAST,
    LIMIT,
    OVERSPEED,
    PERIOD,
    RADIUS,
    RETURN,
    SETTLING,
    SPEED,
    STEPS,
    TERMINATED,
    TILT,
    TOUCHED,
    TRUNCATED,
    TURNING,
    Episodes,
    Motion,
    Outcome,
    Rules,
    Scenes,
    Senses,
)
from hydro.rl.environment.geometry import collision_kernel, hull_numbers, tank
from hydro.rl.environment.observation import observe_kernel
from hydro.rl.environment.reward import (
    COLLISION,
    SUCCESS,
    alignment,
    distance_cost,
    effort_cost,
    obstacle_cost,
    posture,
    shaping,
    speed_cost,
)
from hydro.rl.world.config import Settings

POWER = 1.5  # exponent of an ideal propeller's power as a function of its thrust (momentum theory)


def make_rules(settings: Settings, vehicle: Vehicle, table: Array) -> Rules:
    """Return the constants by which collisions, excess speed and energy of a control step are determined.

    Args:
        settings: Settings of the environment.
        vehicle: Vehicle, for its hull.
        table: Thruster table, with a row per thruster (n, columns).
    """
    limits = np.array([settings.overspeed, settings.period])
    return Rules(hull_numbers(vehicle.hull), tank(settings.world), table, limits)


@kernel
def sense_kernel(
    mask: Mask, senses: Senses, motion: Motion, scenes: Scenes, noise: Array, nearest: Array, out: Array32
) -> None:
    """Write the observations of the vehicles of a mask to `out`.

    Args:
        mask: Vehicles (N,).
        senses: Sensors.
        motion: Motion of all vehicles; the rotation is written.
        scenes: Tasks of all vehicles.
        noise: Standard normal random numbers (N, 36); overwritten.
        nearest: Shortest sonar range without noise (N,) [m], written.
        out: Observations (N, 36), written.
    """
    for k in range(mask.size):
        if mask[k]:
            sense(k, senses, motion, scenes, noise[k], nearest, out)


@kernel
def sense(
    k: int, senses: Senses, motion: Motion, scenes: Scenes, noise: Array, nearest: Array, out: Array32
) -> None:
    """Write the observation of vehicle `k`; `rl.environment.observation` defines its order and units.

    Args:
        k: Index of the vehicle.
        senses: Sensors.
        motion: Motion of all vehicles; the rotation of row `k` is written.
        scenes: Tasks of all vehicles.
        noise: Random numbers (36,), drawn by the caller: standard normal, plus any bias in standard
            deviations.  They are scaled by the sensors' noise, and overwritten.
        nearest: Shortest sonar range without noise (N,) [m]; entry `k` is written.
        out: Observations (N, 36); row `k` is written.
    """
    for i in range(senses.sigma.size):
        noise[i] *= senses.sigma[i]
    quaternion_kernel(motion.pose[k, 3:7], motion.rotation[k])
    nearest[k] = observe_kernel(senses, motion, scenes, k, noise, out[k])


@kernel
def power_share(table: Array, thrust: Array) -> float:
    """Return the power of all thrusters as a share of their power at full thrust.

    Args:
        table: Table of `core.vehicle.thrusters`, one row per thruster (n, columns).
        thrust: Thrust of each thruster (n,) [N].
    """
    total = 0.0
    for i in range(thrust.size):
        limit = table[i, MAX_THRUST] if thrust[i] > 0.0 else table[i, MAX_REVERSE]
        if limit > 0.0:  # no servo
            total += (abs(thrust[i]) / limit) ** POWER
    return float(total / max(thrust.size, 1))


@kernel
def distance(goal: Array, pose: Array) -> float:
    """Return the distance [m] from a pose (7,), which begins with the position, to a goal (3,)."""
    x, y, z = goal[0] - pose[0], goal[1] - pose[1], goal[2] - pose[2]
    return math.sqrt(x * x + y * y + z * z)


@kernel
def step_kernel(
    rules: Rules, motion: Motion, scenes: Scenes, episodes: Episodes, actions: Array, outcome: Outcome
) -> None:
    """Write rewards and flags of all vehicles, and update the totals of their episodes.

    Args:
        rules: Constants that decide collisions, excess speed and energy.
        motion: Motion after the step.
        scenes: Tasks.
        episodes: State of the episodes before the step; updated.
        actions: Actions of this step (N, 6).
        outcome: Rewards and flags of this step, written.
    """
    for k in range(actions.shape[0]):
        score(k, rules, motion, scenes, episodes, actions[k], outcome)


@kernel
def score(
    k: int, rules: Rules, motion: Motion, scenes: Scenes, episodes: Episodes, action: Array, outcome: Outcome
) -> None:
    """Write reward and flags of vehicle `k`, and update the totals of its episode.

    Args:
        k: Index of the vehicle.
        rules: Constants that decide collisions, excess speed and energy.
        motion: Motion of all vehicles after the step.
        scenes: Tasks of all vehicles.
        episodes: State of all episodes; row `k` is updated.
        action: Action of this step (6,) of this vehicle.
        outcome: Rewards and flags of all vehicles; those of vehicle `k` are written.
    """
    w, ends, totals = scenes.weights[k], scenes.ends[k], episodes.totals[k]
    away, speed = distance(scenes.goals[k], motion.pose[k]), length(motion.velocity[k, :3])
    totals[AGE] += 1.0
    if 0.0 <= ends[SETTLING] < totals[AGE]:
        totals[ERROR] += away * away
    mark_ends(rules, motion, scenes, k, away, totals, outcome.flags)
    power = power_share(rules.table, motion.thrust[k])
    north, east = scenes.targets[k, 0] - motion.pose[k, 0], scenes.targets[k, 1] - motion.pose[k, 1]
    arrived = outcome.flags[ARRIVED, k] and outcome.flags[TERMINATED, k]
    failed = outcome.flags[TOUCHED, k] or outcome.flags[DIVERGED, k]
    terms, gain = outcome.terms[k], 0.0
    terms[0] = shaping(w, episodes.distance[k], away)
    terms[1] = -effort_cost(w, power, action, episodes.action[k])
    terms[2] = posture(w, motion.rotation[k], north, east)
    terms[3] = alignment(w, motion.rotation[k], away)
    terms[4] = -speed_cost(w, speed, ends[SPEED], away)
    terms[5] = -obstacle_cost(w, episodes.nearest[k])
    terms[6] = -distance_cost(w, away)
    terms[7] = -scenes.path_cost[k]
    terms[8] = w[SUCCESS] if arrived else 0.0
    terms[9] = -w[COLLISION] if failed else 0.0
    for i in range(terms.size):
        gain += terms[i]
    outcome.reward[k] = gain

    episodes.distance[k] = away
    for j in range(action.size):
        episodes.action[k, j] = action[j]
    totals[RETURN] += gain
    totals[ENERGY] += power * rules.limits[PERIOD]
    totals[OVERSPEED] += 1.0 if outcome.flags[FAST, k] else 0.0


@kernel
def mark_ends(
    rules: Rules, motion: Motion, scenes: Scenes, k: int, away: float, totals: Array, flags: Mask
) -> None:
    """Write the flags of one vehicle: arrived, collided, diverged, too fast, terminated, truncated.

    Args:
        rules: Constants that decide collisions and excess speed.
        motion: Motion of all vehicles after the step.
        scenes: Tasks of all vehicles.
        k: Index of the vehicle.
        away: Distance of the vehicle from its goal [m].
        totals: Totals of the vehicle's episode (TOTALS,), such as its age in control steps.
        flags: Flags of all vehicles (FLAGS, N); column `k` is written.
    """
    ends, velocity = scenes.ends[k], motion.velocity[k]
    failed = bool(motion.diverged[k])
    touched = not failed and collision_kernel(
        rules.hull, rules.tank, motion.pose[k], motion.rotation[k], scenes.pillars[k]
    )
    late = totals[AGE] >= ends[STEPS]
    arrived, ended = False, failed or touched
    if not ended and ends[SETTLING] < 0.0:
        arrived = ended = within_limits(ends, motion.pose[k], velocity, away)
    elif not ended and late:
        arrived = root_mean_square(totals, ends) <= ends[RADIUS]
    flags[ARRIVED, k], flags[TOUCHED, k], flags[DIVERGED, k] = arrived, touched, failed
    flags[FAST, k] = length(velocity[:3]) > rules.limits[LIMIT]
    flags[TERMINATED, k], flags[TRUNCATED, k] = ended, late and not ended


@kernel
def within_limits(ends: Array, pose: Array, velocity: Array, away: float) -> bool:
    """Return whether a vehicle meets all limits of its task: distance, speed, angular velocity and tilt.

    Args:
        ends: Limits (6,), in the order of `tasks.task.Ends`.
        pose: x y z [m] and quaternion (w, x, y, z) from FRD to NED (7,).
        velocity: u v w [m/s] p q r [rad/s] (6,).
        away: Distance from the goal [m].
    """
    if away > ends[RADIUS] or length(velocity[:3]) > ends[SPEED] or length(velocity[3:]) > ends[TURNING]:
        return False
    return bool(2.0 * math.acos(min(abs(pose[3]), 1.0)) <= ends[TILT])


@kernel
def root_mean_square(totals: Array, ends: Array) -> float:
    """Return the root mean square distance from the goal since the settling time of an episode [m].

    It is infinite before the settling time, and in tasks that arrive.

    Args:
        totals: Totals of the episode (TOTALS,), in the order of `rl.environment.blocks`.
        ends: End conditions (6,), in the order of `tasks.task.Ends`.
    """
    counted = totals[AGE] - math.floor(ends[SETTLING])
    return math.sqrt(totals[ERROR] / counted) if ends[SETTLING] >= 0.0 and counted > 0.0 else math.inf


@kernel
def length(vector: Array) -> float:
    """Return the Euclidean norm of a vector (3,)."""
    return math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
