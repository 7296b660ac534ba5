"""Demands of axes as commands of thrusters: the motor factors of ArduSub's frames, or a matrix of the map."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.logs.logmap import Mixer

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
PRESETS: dict[str, Array] = {
    "ardusub_vectored": np.array(
        [
            [-1, 1, 0, 0, 0, 1],
            [-1, -1, 0, 0, 0, -1],
            [1, 1, 0, 0, 0, -1],
            [1, -1, 0, 0, 0, 1],
            [0, 0, 1, 1, 0, 0],
            [0, 0, 1, -1, 0, 0],
        ],
        float,
    ),
    "ardusub_vectored_6dof": np.array(
        [
            [-1, 1, 0, 0, 0, 1],
            [-1, -1, 0, 0, 0, -1],
            [1, 1, 0, 0, 0, -1],
            [1, -1, 0, 0, 0, 1],
            [0, 0, 1, 1, -1, 0],
            [0, 0, 1, -1, -1, 0],
            [0, 0, 1, 1, 1, 0],
            [0, 0, 1, -1, 1, 0],
        ],
        float,
    ),
}
"""Motor factors of ArduSub's frames (AP_Motors6DOF, setup_motors), a row a motor, a column an axis.

Heave is down here, as SNAME has it; ArduSub's throttle is up.
"""


def matrix(mixer: Mixer) -> Array:
    """What each thruster does of each demand, (thrusters, demands); the identity for virtual thrusters."""
    if mixer.preset is not None:
        found = PRESETS[mixer.preset][:, [AXES.index(demand) for demand in mixer.demands]]
    elif mixer.matrix is not None:
        found = np.array(mixer.matrix, float)
    else:
        found = np.eye(len(mixer.demands))
    return np.asarray(found * np.array(mixer.directions or (1,) * len(found), float)[:, None])


def thrusters(mixer: Mixer | None, commands: int) -> int:
    """How many thrusters so many commands drive."""
    return commands if mixer is None else len(matrix(mixer))


def mixed(mixer: Mixer, demands: Array) -> Array:
    """Commands of the thrusters, (N, n), of demands in [-1, 1], (N, k).

    Where demands add up to more than full thrust of a motor, ArduSub clips it in its vectored frame, and
    scales all motors of its plane down alike in the vectored frame of six degrees of freedom.
    """
    drive: Array = demands @ matrix(mixer).T
    if mixer.preset != "ardusub_vectored_6dof":
        return drive if mixer.preset is None else np.clip(drive, -1.0, 1.0)
    level = (PRESETS[mixer.preset][:, :2] != 0.0).any(axis=1)
    for plane in (level, ~level):
        most = np.abs(drive[:, plane]).max(axis=1, keepdims=True, initial=1.0)
        drive[:, plane] /= most
    return drive
