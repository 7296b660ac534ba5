"""From actions to thruster commands: a demanded wrench, mixed onto the thrusters, its direction kept."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.vehicle.control_allocation import mixing_kernel
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST

ACTIONS = 6
"""Demands X, Y, Z, K, M, N in [-1, 1], shares of the greatest wrench on each axis alone."""


@jit
def command_kernel(
    allocation: Array, table: Array, authority: Array, actions: Array, tau: Array, commands: Array
) -> bool:
    """Thruster commands of all vehicles.

    Where some thruster cannot give its share, the whole demand is scaled down until all can, so that the
    wrench keeps its direction.  Thrusts become commands by the thrust curve inverted; lag and dead band are
    left as they are, and act as in the vehicle file.

    Args:
        allocation: Pseudo-inverse of B (n, 6).
        table: Thruster table (n, columns).
        authority: Greatest wrench on each axis alone (6,) [N, N m]; 0 where there is none.
        actions: (N, 6), clipped to [-1, 1] in place.
        tau: (6,) scratch.
        commands: (N, n) written.

    Returns:
        Whether all actions are numbers; the commands are not to be used otherwise.
    """
    for k in range(actions.shape[0]):
        for j in range(ACTIONS):
            if not np.isfinite(actions[k, j]):
                return False
            actions[k, j] = min(max(actions[k, j], -1.0), 1.0)
            tau[j] = actions[k, j] * authority[j]
        excess = 1.0
        for i in range(table.shape[0]):
            thrust = 0.0
            for j in range(ACTIONS):
                thrust += allocation[i, j] * tau[j]
            limit = table[i, MAX_THRUST] if thrust > 0.0 else table[i, MAX_REVERSE]
            if limit > 0.0:  # no servo
                excess = max(excess, abs(thrust) / limit)
        for j in range(ACTIONS):
            tau[j] /= excess
        mixing_kernel(allocation, table, tau, commands[k])
    return True
