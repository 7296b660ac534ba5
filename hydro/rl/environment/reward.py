"""Terms whose sum is the reward of one control step (Wu et al., eq. 8); a task chooses their weights.

Equation 8 of the paper has `shaping`, `posture`, `obstacle_cost`, `effort_cost`, success and collision.
Tasks that hold or follow add `distance_cost`; docking adds `alignment` and `speed_cost`.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.rl.world.config import Reward

SHAPING, DISTANCE, DISCOUNT, HEADING, BLIND, UPRIGHT, SUCCESS, OBSTACLE = range(8)
NEAR, FAR, COLLISION, ENERGY, ACTION, SMOOTHNESS, PATH = range(8, 15)
HOLD, ALIGNMENT, CLOSE, HASTE, WEIGHTS = range(15, 20)
"""Indices of the weights, in the order of `world.config.Reward`; their number."""
TERMS = (
    "shaping", "effort", "posture", "alignment", "speed", "obstacle", "distance", "path", "success",
    "collision",
)  # fmt: skip
"""Names of the terms of the reward, in the order of `rl.environment.blocks.Outcome.terms`.

`effort` is the cost of energy, of large and of changing actions; `posture` the heading and upright terms;
`speed` the cost of haste near a dock; `collision` the cost of a collision or a divergence.
"""
FALL_OFF = 1.5  # decay of the obstacle cost with distance [1/m]
NEAR_SHARE = 0.01  # cost of a step within `near`, as a share of the cost of a collision
SLOWER = 0.5  # slope of the allowed speed with the distance to a dock [1/s]


@functools.lru_cache(maxsize=64)
def weights(reward: Reward) -> Array:
    """Return the weights of the reward's terms as a read-only array, (WEIGHTS,).

    The indices are SHAPING to HASTE.
    """
    array = np.array(dataclasses.astuple(reward), dtype=np.float64)
    array.flags.writeable = False
    return array


@kernel
def shaping(w: Array, before: float, after: float) -> float:
    """Return the shaping reward gamma phi(s_t) - phi(s_{t-1}), with the potential phi = -(d / d_max) phi_s.

    Args:
        w: Weights from `weights`: gamma, d_max [m] and phi_s.
        before: Distance d to the goal before the step [m].
        after: Distance d to the goal after the step [m].
    """
    return float(w[SHAPING] / w[DISTANCE] * (before - w[DISCOUNT] * after))


@kernel
def posture(w: Array, R: Array, x: float, y: float) -> float:
    """Return the reward for the attitude: for pointing at the target plus for being upright.

    Each is its weight times (cos(angle) + 1) / 2.  The heading term takes the horizontal angle between the
    bow and the target; it is 0 close to the target. The upright term takes the angle between the body's z
    axis and the vertical.

    Args:
        w: Weights from `weights`.
        R: Rotation from body to NED, flat (9,).
        x: North component of the vector to the target [m].
        y: East component of the vector to the target [m].
    """
    gain = w[UPRIGHT] * 0.5 * (R[8] + 1.0)
    away, ahead = math.hypot(x, y), math.hypot(R[0], R[3])
    if away > w[BLIND] and ahead > 0.0:
        gain += w[HEADING] * 0.5 * ((R[0] * x + R[3] * y) / (away * ahead) + 1.0)
    return float(gain)


@kernel
def obstacle_cost(w: Array, least: float) -> float:
    """Return the cost of being close to an obstacle: constant within `near`, then exponential to `far`.

    Args:
        w: Weights from `weights`, with the distances `near` and `far` [m] of `world.config.Reward`.
        least: Shortest range of the sonar [m].
    """
    if least < w[NEAR]:
        return float(NEAR_SHARE * w[COLLISION])
    if least > w[FAR]:
        return 0.0
    return float(w[OBSTACLE] * math.exp(-FALL_OFF * (least - w[NEAR])))


@kernel
def effort_cost(w: Array, power: float, action: Array, before: Array) -> float:
    """Return the cost of energy, of large actions and of changing actions.

    Args:
        w: Weights from `weights`.
        power: Power of all thrusters, as a share of their power at full thrust.
        action: Action (6,) in [-1, 1].
        before: Action of the previous step (6,).
    """
    size = change = 0.0
    for j in range(action.size):
        size += action[j] * action[j]
        change += (action[j] - before[j]) * (action[j] - before[j])
    mean = 1.0 / action.size
    return float(w[ENERGY] * power + w[ACTION] * mean * size + w[SMOOTHNESS] * mean * change)


@kernel
def cross_track_cost(error: float) -> float:
    """Return the cost of a distance e [m] from the path: e^2 below 1 m, 2 |e| - 1 beyond (Wu et al., 9)."""
    size = abs(error)
    return size * size if size < 1.0 else 2.0 * size - 1.0


@kernel
def distance_cost(w: Array, away: float) -> float:
    """Return the cost of a distance `away` [m] from a goal to hold or follow, with weights `w`."""
    return float(w[HOLD] * cross_track_cost(away))


@kernel
def alignment(w: Array, R: Array, away: float) -> float:
    """Return the reward near the dock for a bow to the north: its weight times (cos(heading) + 1) / 2.

    Args:
        w: Weights from `weights`, with the distance `close` [m] beyond which the reward is 0.
        R: Rotation from body to NED, flat (9,).
        away: Distance from the dock [m].
    """
    return float(w[ALIGNMENT] * 0.5 * (R[0] + 1.0)) if away < w[CLOSE] else 0.0


@kernel
def speed_cost(w: Array, speed: float, allowed: float, away: float) -> float:
    """Return the cost of a speed above the limit near the dock: a weight times the excess [m/s].

    The limit is `allowed` [m/s] at the dock and rises by SLOWER for each metre of distance.

    Args:
        w: Weights from `weights`.
        speed: Speed over ground [m/s].
        allowed: Limit at the dock [m/s].
        away: Distance from the dock [m].
    """
    return float(w[HASTE] * max(0.0, speed - allowed - SLOWER * away))
