"""A pilot by hand, without learning and without memory: the baseline of every table of policies."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array, Array32
from hydro.rl.environment.observation import GRAVITY, QUATERNION, RATE, TARGET, VELOCITY
from hydro.rl.world.planner import Grid

NAME, WITH_MAP = "helmsman", "helmsman with map"
TAUGHT = "pilot who taught"
FASTEST, SLOWING = 1.6, 0.7  # m/s, and 1/s of the way that is left
THRUST, TURNING = 2.0, 0.8  # demand per m/s, and per rad/s
BLIND = 0.5  # m, from the target: its direction says nothing there


class Manner(NamedTuple):
    """How a pilot by hand flies; by default as in every table.

    Attributes:
        margin: Distance that he keeps from pillars where there is room, of his own ways [m].
        pace: His speeds, in multiples of FASTEST and of what SLOWING leaves.
        firmness: Demands in roll, pitch and yaw per angle, in multiples of 1 per rad; those per rad/s go with
            its root, so that what turns the hull is damped alike.
    """

    margin: float = Grid.margin
    pace: float = 1.0
    firmness: float = 1.0


PLAIN = Manner()


def helmsman(seen: Array32, manner: Manner = PLAIN) -> Array32:
    """Demands of a proportional law: towards the target, bow first, slower when near, and level.

    It swims to whatever the observation calls its target, the goal or a point ahead on a planned way, and
    knows neither the vehicle nor the pillars.

    Args:
        seen: Observations (N, 36) of `rl.environment.observation`, the newest where several are seen at once.
        manner: How he flies.

    Returns:
        Demands (N, 6); the fleet clips them.
    """
    way = seen[:, TARGET : TARGET + 3]
    near = np.linalg.norm(way, axis=1) < BLIND
    return _steer(seen, np.where(near, 0.0, np.arctan2(way[:, 1], way[:, 0])), manner)


def docker(seen: Array32, manner: Manner = PLAIN) -> Array32:
    """The same law with the bow kept to the north, as a dock asks for."""
    w, x, y, z = seen[:, QUATERNION : QUATERNION + 4].T
    return _steer(seen, -np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)), manner)


def _steer(seen: Array32, turn: Array, manner: Manner) -> Array32:
    """Demands (N, 6) towards the target, turning by angles (N,) [rad] to starboard."""
    way, velocity, rates = (seen[:, at : at + 3] for at in (TARGET, VELOCITY, RATE))
    down = seen[:, GRAVITY : GRAVITY + 3]
    down = down / np.linalg.norm(down, axis=1, keepdims=True)
    away = np.linalg.norm(way, axis=1, keepdims=True)
    wanted = way / np.maximum(away, 1e-9) * np.minimum(FASTEST, SLOWING * away)
    turns = manner.firmness * np.column_stack([-down[:, 1], down[:, 0], turn])
    turns -= math.sqrt(manner.firmness) * TURNING * rates
    return np.hstack([THRUST * (manner.pace * wanted - velocity), turns]).astype(np.float32)
