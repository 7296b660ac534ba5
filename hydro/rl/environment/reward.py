"""The terms that the reward of one control step is the sum of; a task chooses their weights.

The paper's eq. 8: `shaping`, `posture`, `obstacle_cost`, `effort_cost` and what success and collision are
worth; beside them `straying` of tasks that hold or follow, `alignment` and `haste` of docking.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.rl.world.config import Reward

SHAPING, DISTANCE, DISCOUNT, HEADING, BLIND, UPRIGHT, SUCCESS, OBSTACLE = range(8)
NEAR, FAR, COLLISION, ENERGY, ACTION, SMOOTHNESS, PATH = range(8, 15)
HOLD, ALIGNMENT, CLOSE, HASTE, WEIGHTS = range(15, 20)
FALL_OFF = 1.5  # 1/m, of the obstacle cost
NEAR_SHARE = 0.01  # of the cost of a collision, for every step within `near`
SLOWER = 0.5  # 1/s, of the distance to a dock: speed that is not hasty beyond what the dock allows


def weights(reward: Reward) -> Array:
    """The weights as numbers, in the order of their names above."""
    return np.array(dataclasses.astuple(reward), dtype=np.float64)


@kernel
def shaping(w: Array, before: float, after: float) -> float:
    """Gamma phi(s_t) - phi(s_{t-1}) with phi = -(distance / d_max) phi_s, of distances to the goal [m]."""
    return float(w[SHAPING] / w[DISTANCE] * (before - w[DISCOUNT] * after))


@kernel
def posture(w: Array, R: Array, x: float, y: float) -> float:
    """Heading and upright terms, w (cos + 1) / 2 each.

    The heading's angle is that between the horizontal parts of the bow's direction and of the way to the
    target (x, y), NED; the upright's that between the body's z axis and down.
    """
    gain = w[UPRIGHT] * 0.5 * (R[8] + 1.0)
    away, ahead = math.hypot(x, y), math.hypot(R[0], R[3])
    if away > w[BLIND] and ahead > 0.0:
        gain += w[HEADING] * 0.5 * ((R[0] * x + R[3] * y) / (away * ahead) + 1.0)
    return float(gain)


@kernel
def obstacle_cost(w: Array, least: float) -> float:
    """Cost of the nearest echo at `least` [m]: exponential between `near` and `far`, hard within `near`."""
    if least < w[NEAR]:
        return float(NEAR_SHARE * w[COLLISION])
    if least > w[FAR]:
        return 0.0
    return float(w[OBSTACLE] * math.exp(-FALL_OFF * (least - w[NEAR])))


@kernel
def effort_cost(w: Array, power: float, action: Array, before: Array) -> float:
    """Cost of energy, action size and unsteadiness.

    Args:
        w: Weights.
        power: Share of the power of all thrusters at full thrust.
        action: Demands (6,) in [-1, 1].
        before: Those of the step before.
    """
    size = change = 0.0
    for j in range(action.size):
        size += action[j] * action[j]
        change += (action[j] - before[j]) * (action[j] - before[j])
    mean = 1.0 / action.size
    return float(w[ENERGY] * power + w[ACTION] * mean * size + w[SMOOTHNESS] * mean * change)


@kernel
def cross_track_cost(error: float) -> float:
    """e^2 below 1 m, and 2 |e| - 1 beyond: Huber-like, once differentiable (eq. 9)."""
    size = abs(error)
    return size * size if size < 1.0 else 2.0 * size - 1.0


@kernel
def straying(w: Array, away: float) -> float:
    """Cost of being `away` [m] from what is to be held or followed."""
    return float(w[HOLD] * cross_track_cost(away))


@kernel
def alignment(w: Array, R: Array, away: float) -> float:
    """Pay for a bow to the north, w (cos + 1) / 2, within `close` of the dock, `away` [m] from it."""
    return float(w[ALIGNMENT] * 0.5 * (R[0] + 1.0)) if away < w[CLOSE] else 0.0


@kernel
def haste(w: Array, speed: float, allowed: float, away: float) -> float:
    """Cost of a speed [m/s] beyond what a dock `away` [m] from it allows, `allowed` where it is reached."""
    return float(w[HASTE] * max(0.0, speed - allowed - SLOWER * away))
