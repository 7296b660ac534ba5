"""Conversion of axis demands to thruster commands: factors of ArduSub's frames, or a matrix of the map."""

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
"""Motor factors of ArduSub's frames (AP_Motors6DOF, setup_motors): a row per motor, a column per axis.

Heave is positive down here, as in SNAME; ArduSub's throttle is positive up.
"""


def matrix(mixer: Mixer) -> Array:
    """Return the matrix from demands to thruster commands, (thrusters, demands).

    Without a preset and a matrix, each demand drives one thruster.

    Args:
        mixer: Mixer of the map; its `directions` reverse rows of the matrix.
    """
    if mixer.preset is not None:
        found = PRESETS[mixer.preset][:, [AXES.index(demand) for demand in mixer.demands]]
    elif mixer.matrix is not None:
        found = np.array(mixer.matrix, float)
    else:
        found = np.eye(len(mixer.demands))
    return np.asarray(found * np.array(mixer.directions or (1,) * len(found), float)[:, None])


def thrusters(mixer: Mixer | None, commands: int) -> int:
    """Return the number of thrusters that a log's command columns drive.

    Args:
        mixer: Mixer of the map; None if each column is a thruster.
        commands: Number of command columns.
    """
    return commands if mixer is None else len(matrix(mixer))


def mixed(mixer: Mixer, demands: Array) -> Array:
    """Return the commands of n thrusters in N rows, (N, n), that a mixer makes from axis demands.

    If demands exceed a motor's full thrust, ArduSub clips its command in the vectored frame.  In the vectored
    frame with six degrees of freedom, it scales down all motors of the same plane equally.  Without a preset,
    commands may exceed [-1, 1].

    Args:
        mixer: Mixer of the map.
        demands: k demands in each row in [-1, 1], (N, k).
    """
    drive: Array = demands @ matrix(mixer).T
    if mixer.preset != "ardusub_vectored_6dof":
        return drive if mixer.preset is None else np.clip(drive, -1.0, 1.0)
    level = (PRESETS[mixer.preset][:, :2] != 0.0).any(axis=1)
    for plane in (level, ~level):
        most = np.abs(drive[:, plane]).max(axis=1, keepdims=True, initial=1.0)
        drive[:, plane] /= most
    return drive
