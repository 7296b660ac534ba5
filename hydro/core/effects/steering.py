"""Moments by which the servos of a vehicle steer, from the effects that use their commands."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.columns import effect_wrenches
from hydro.core.vehicle.description import Vehicle

SPEED = 1.5
"""Speed ahead at which the moments count [m/s]: the cruise of survey vehicles such as the REMUS 100."""


def servo_wrenches(vehicle: Vehicle, speed: float = SPEED) -> Array:
    """Return the wrench of each servo at full deflection in straight motion ahead, (6, n) [N, N m].

    A wrench is half the difference of the effects' wrenches at the commands 1 and -1, so that fixed
    deflections and drag cancel.  Columns are the n thrusters and servos of the file; those of thrusters are
    0.

    Args:
        vehicle: The vehicle.
        speed: Speed ahead [m/s].

    Raises:
        DataError: An effect of the vehicle is unknown, or has invalid values.
    """
    count = len(vehicle.thruster)
    servos = [i for i, one in enumerate(vehicle.thruster) if not one.pushes]
    wrenches = np.zeros((6, count))
    if not servos:
        return wrenches
    commands = np.zeros((2 * len(servos), count))
    for row, servo in enumerate(servos):
        commands[2 * row : 2 * row + 2, servo] = 1.0, -1.0
    rows = len(commands)
    nu = np.tile([speed, 0.0, 0.0, 0.0, 0.0, 0.0], (rows, 1))
    each = np.column_stack([np.arange(rows), np.arange(1, rows + 1)])
    found = effect_wrenches(vehicle, np.zeros((rows, 6)), nu, each, np.zeros(rows), commands)
    wrenches[:, servos] = 0.5 * (found[::2] - found[1::2]).T
    return wrenches
