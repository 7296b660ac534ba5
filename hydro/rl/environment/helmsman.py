"""Hand-written pilot without learning or memory: the baseline of every table of policies."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array, Array32
from hydro.rl.environment.observation import GRAVITY, QUATERNION, RATE, TARGET, VELOCITY
from hydro.rl.world.planner import Grid

NAME, WITH_MAP = "helmsman", "helmsman with map"  # values of `flown_by` for the baseline pilot
TAUGHT = "pilot who taught"  # value of `flown_by` for the expert of a training
FASTEST, SLOWING = 1.6, 0.7  # greatest speed [m/s]; speed per distance from the target [1/s]
THRUST, TURNING = 2.0, 0.8  # action per velocity error [s/m]; per angular velocity [s/rad]
BLIND = 0.5  # distance from the target below which its bearing is meaningless [m]
CRUISE = 1.0  # share of full thrust of a vehicle with fins, for steerage way; 2.4 m/s for the REMUS 100
YAWING, PITCHING = 2.0, 4.0  # share of a full deflection per error of heading and of pitch [1/rad]
FIN_DAMPING = 0.8  # time by which angular velocity leads the angle, against overshoot [s]
STEEPEST = 0.4  # greatest pitch angle that the pilot of fins asks for [rad]
CIRCLE = 5.0  # radius of the turning circle that the pilot of fins reckons with [m]


class Manner(NamedTuple):
    """Tuning of the hand-written pilot; all published tables use the defaults.

    Attributes:
        margin: Distance that the pilot's own paths keep from pillars, if there is room [m].
        pace: Factor on all speeds.
        firmness: Factor on the proportional gain of roll, pitch and yaw.  The gain on angular velocity grows
            with its square root, so that the damping ratio stays.
    """

    margin: float = Grid.margin
    pace: float = 1.0
    firmness: float = 1.0


PLAIN = Manner()  # baseline pilot


def helmsman(seen: Array32, manner: Manner = PLAIN) -> Array32:
    """Return actions of a proportional controller: level, bow towards the target, slower near the target.

    The controller flies to the target of the observation: the goal, or a point ahead on a planned path.  It
    knows neither the vehicle nor the pillars.

    Args:
        seen: Observations (N, 36) of `rl.environment.observation`; if observations are stacked, the newest.
        manner: Tuning of the pilot.

    Returns:
        Actions (N, 6), shares of the greatest wrench on each axis; the fleet clips them to [-1, 1].
    """
    way = seen[:, TARGET : TARGET + 3]
    near = np.linalg.norm(way, axis=1) < BLIND
    return _steer(seen, np.where(near, 0.0, np.arctan2(way[:, 1], way[:, 0])), manner)


def docking_pilot(seen: Array32, manner: Manner = PLAIN) -> Array32:
    """Return the actions (N, 6) of `helmsman`, but with the bow to the north, as docking requires.

    Args:
        seen: Observations (N, 36) of `rl.environment.observation`.
        manner: Tuning of the pilot.
    """
    w, x, y, z = seen[:, QUATERNION : QUATERNION + 4].T
    return _steer(seen, -np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)), manner)


def fin_pilot(seen: Array32) -> Array32:
    """Return the actions of a proportional controller for vehicles that steer with fins, at constant thrust.

    The controller turns to the bearing of the target and pitches to its elevation, both measured against the
    horizontal plane.  A target inside the turning circle cannot be reached by turning, so the vehicle first
    goes straight on until the target is outside.

    Args:
        seen: Observations (N, 36), as for `helmsman`.

    Returns:
        Actions (N, 6); the fleet clips them.
    """
    way, rates = (seen[:, at : at + 3] for at in (TARGET, RATE))
    down = seen[:, GRAVITY : GRAVITY + 3]
    down = down / np.linalg.norm(down, axis=1, keepdims=True)
    depth = (way * down).sum(axis=1)
    ahead = np.array([1.0, 0.0, 0.0]) - down[:, :1] * down
    side = np.cross(down, ahead)
    bearing = np.arctan2((way * side).sum(axis=1), (way * ahead).sum(axis=1))
    level = np.sqrt(np.maximum((way**2).sum(axis=1) - depth**2, BLIND**2))
    from_centre = np.hypot(level * np.cos(bearing), CIRCLE - level * np.abs(np.sin(bearing)))
    bearing = np.where(from_centre < CIRCLE, 0.0, bearing)
    pitch = np.arcsin(np.clip(-down[:, 0], -1.0, 1.0))
    climb = np.clip(np.arctan2(-depth, level), -STEEPEST, STEEPEST) - pitch
    actions = np.zeros((len(seen), 6), dtype=np.float32)
    actions[:, 0] = CRUISE
    actions[:, 4] = PITCHING * (climb - FIN_DAMPING * rates[:, 1])
    actions[:, 5] = YAWING * (bearing - FIN_DAMPING * rates[:, 2])
    return actions


def _steer(seen: Array32, turn: Array, manner: Manner) -> Array32:
    """Compute actions (N, 6) towards the target with heading errors (N,) [rad], positive to starboard."""
    way, velocity, rates = (seen[:, at : at + 3] for at in (TARGET, VELOCITY, RATE))
    down = seen[:, GRAVITY : GRAVITY + 3]
    down = down / np.linalg.norm(down, axis=1, keepdims=True)
    away = np.linalg.norm(way, axis=1, keepdims=True)
    wanted = way / np.maximum(away, 1e-9) * np.minimum(FASTEST, SLOWING * away)
    turns = manner.firmness * np.column_stack([-down[:, 1], down[:, 0], turn])
    turns -= math.sqrt(manner.firmness) * TURNING * rates
    return np.hstack([THRUST * (manner.pace * wanted - velocity), turns]).astype(np.float32)
