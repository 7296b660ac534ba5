"""Pilot: commands computed row by row from the true state, for a demanded wrench with weak holds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import copy_kernel, kernel
from hydro.core.effects.layout import POSITION, ROTATION, VELOCITY
from hydro.core.vehicle.control_allocation import Mixing, hold_kernel, mixing_kernel


class Pilot(NamedTuple):
    """Demands of a pilot and its knowledge of the vehicle.

    Attributes:
        gains: (4, 2) gains of the holds, as in `vehicle.control_allocation.Mixing`.
        allocation: Pseudo-inverse of B (n, 6).
        table: Thruster table (n, columns) known to the pilot; that of the vehicle may contain hidden faults.
        wrenches: (N, 6) demanded [N, N m].
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
        """Create the pilot of a session.

        Args:
            crew: Conversion of demands to commands.
            demand: (N, 6) shares of each axis's authority.
            depth: Depth to hold [m].
            heading: Heading to hold [rad]; None for none.
        """
        aim = np.zeros(2) if heading is None else np.array([np.cos(heading), np.sin(heading)])
        wrenches = np.ascontiguousarray(demand) * crew.authority
        return cls(crew.gains, crew.allocation, crew.table, wrenches, depth, aim)


@kernel
def steer(pilot: Pilot, row: int, s: Array, tau: Array, commands: Array) -> None:
    """Write the commands (n,) of a row at the state of motion `s`; `tau` (6,) is workspace."""
    copy_kernel(pilot.wrenches[row], tau)
    R, nu = s[ROTATION : ROTATION + 9], s[VELOCITY : VELOCITY + 6]
    hold_kernel(pilot.gains, R, s[POSITION + 2], nu, pilot.depth, pilot.heading, tau)
    mixing_kernel(pilot.allocation, pilot.table, tau, commands)
