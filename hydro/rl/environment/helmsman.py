"""A pilot by hand, without learning and without memory: the baseline of every table of policies."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array32
from hydro.rl.environment.observation import GRAVITY, RATE, TARGET, VELOCITY

NAME = "helmsman"
FASTEST, SLOWING = 1.6, 0.7  # m/s, and 1/s of the way that is left
THRUST, TURNING = 2.0, 0.8  # demand per m/s, and per rad/s


def helmsman(seen: Array32) -> Array32:
    """Demands of a proportional law: towards the target, bow first, slower when near, and level.

    It swims to whatever the observation calls its target, the goal or a point ahead on a planned way, and
    knows neither the vehicle nor the pillars.

    Args:
        seen: Observations (N, 36) of `rl.environment.observation`.

    Returns:
        Demands (N, 6); the fleet clips them.
    """
    way, velocity, rates = (seen[:, at : at + 3] for at in (TARGET, VELOCITY, RATE))
    down = seen[:, GRAVITY : GRAVITY + 3]
    down = down / np.linalg.norm(down, axis=1, keepdims=True)
    away = np.linalg.norm(way, axis=1, keepdims=True)
    wanted = way / np.maximum(away, 1e-9) * np.minimum(FASTEST, SLOWING * away)
    turn = np.column_stack([-down[:, 1], down[:, 0], np.arctan2(way[:, 1], way[:, 0])])
    return np.hstack([THRUST * (wanted - velocity), turn - TURNING * rates]).astype(np.float32)
