"""Names and units of the columns of motion and force, and types of arrays.

Letters follow SNAME (1950), as in Fossen (2021), Table 2.1: the pose of CO in NED, velocity and force in body
axes (FRD).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hydro.core.errors import DataError

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Rows = NDArray[np.int64]
"""Row numbers, or bounds [start, stop) of runs of rows."""
Mask = NDArray[np.bool_]

POSE = ("x", "y", "z", "phi", "theta", "psi")
VELOCITY = ("u", "v", "w", "p", "q", "r")
MOTION = (*POSE, *VELOCITY)
WRENCH = ("X", "Y", "Z", "K", "M", "N")
DOF = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Words for the six degrees of freedom, the axes of velocity and wrench."""

POSE_UNITS = ("m",) * 3 + ("rad",) * 3
VELOCITY_UNITS = ("m/s",) * 3 + ("rad/s",) * 3
WRENCH_UNITS = ("N",) * 3 + ("N m",) * 3
UNITS = dict(zip((*MOTION, *WRENCH), (*POSE_UNITS, *VELOCITY_UNITS, *WRENCH_UNITS), strict=True))
"""Unit of each column of motion and force."""

COMMAND = "cmd_"
"""Prefix of the names of command columns."""


VOLTAGE = "voltage"
"""Optional column of the supply voltage [V]."""


def command_column(thruster: int) -> str:
    """Return the name of a thruster's command column, for example `cmd_1` for `thruster` 0."""
    return f"{COMMAND}{thruster + 1}"


def command_columns(thrusters: int) -> list[str]:
    """Return the names of the command columns of a number of thrusters: `cmd_1 ... cmd_n`."""
    return [command_column(thruster) for thruster in range(thrusters)]


def checked_commands(columns: Iterable[str], thrusters: int, vehicle: str) -> list[str]:
    """Return the names of a table's command columns, `cmd_1 ... cmd_n`; check that there are n of them.

    Args:
        columns: Names of all columns of the table.
        thrusters: Number n of thrusters of the vehicle.
        vehicle: Name of the vehicle, for the error message.

    Raises:
        DataError: A command column is missing or superfluous.
    """
    needed = command_columns(thrusters)
    found = [name for name in columns if name.startswith(COMMAND)]
    if set(found) == set(needed):
        return needed
    missing = [f"no {name}" for name in needed if name not in found]
    extra = [f"also {name}" for name in sorted(found) if name not in needed]
    raise DataError(
        f"the table has {len(found)} command columns, {(missing + extra)[0]}, and vehicle {vehicle} "
        f"{thrusters} thrusters; use the vehicle file that it was recorded with"
    )
