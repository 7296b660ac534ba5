"""Pilot: thruster commands computed row by row from the true state, from demanded wrenches and weak holds.

A hold is a weak controller of depth, roll, pitch or heading (`vehicle.control_allocation`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import copy_kernel, kernel
from hydro.core.effects.layout import POSITION, ROTATION, VELOCITY
from hydro.core.vehicle.control_allocation import Mixing, hold_kernel, mixing_kernel


class Pilot(NamedTuple):
    """Demands of a simulated pilot, and the pilot's knowledge of the vehicle.

    A hold is a weak controller of depth, roll, pitch or heading.

    Attributes:
        gains: Gains of the holds, (4, 2), as in `vehicle.control_allocation.Mixing`.
        allocation: Pseudo-inverse of the configuration matrix B of n thrusters, (n, 6).
        table: Thruster table (n, columns) known to the pilot; that of the vehicle may contain hidden faults.
        wrenches: Demanded wrench in each row, body axes, (N, 6) [N, N m].
        depth: Depth to hold [m].
        heading: (cos, sin) of the heading to hold; (0, 0) for none.
    """

    gains: Array
    allocation: Array
    table: Array
    wrenches: Array
    depth: float
    heading: Array

    @classmethod
    def of(cls, crew: Mixing, demand: Array, depth: float, heading: float | None) -> Pilot:
        """Return the pilot of a session with given demands.

        Args:
            crew: Conversion of demanded wrenches to commands, with the gains of the holds.
            demand: Demanded wrench in each row, as fractions of the maximum wrench on each axis, (N, 6).
            depth: Depth to hold [m].
            heading: Heading to hold [rad]; None for none.
        """
        aim = np.zeros(2) if heading is None else np.array([np.cos(heading), np.sin(heading)])
        wrenches = np.ascontiguousarray(demand) * crew.authority
        return cls(crew.gains, crew.allocation, crew.table, wrenches, depth, aim)


@kernel
def steer(pilot: Pilot, row: int, s: Array, tau: Array, commands: Array) -> None:
    """Write the pilot's commands for a row to `commands`.

    Args:
        pilot: Demands of the pilot.
        row: Number of the row.
        s: State of motion (`effects.layout`), for the holds.
        tau: Workspace, (6,).
        commands: Output: commands of n thrusters in [-1, 1], (n,).
    """
    copy_kernel(pilot.wrenches[row], tau)
    R, nu = s[ROTATION : ROTATION + 9], s[VELOCITY : VELOCITY + 6]
    hold_kernel(pilot.gains, R, s[POSITION + 2], nu, pilot.depth, pilot.heading, tau)
    mixing_kernel(pilot.allocation, pilot.table, tau, commands)
