"""From actions to thruster commands: a demanded wrench, mixed onto the thrusters, its direction kept."""

from __future__ import annotations

import math

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.vehicle.control_allocation import mixing_kernel
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST

ACTIONS = 6
"""Demands X, Y, Z, K, M, N in [-1, 1], shares of the greatest wrench on each axis alone."""


@kernel
def command_kernel(
    allocation: Array, table: Array, authority: Array, actions: Array, tau: Array, commands: Array
) -> bool:
    """Thruster commands of all vehicles, see `mixed`.

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
        if not mixed(allocation, table, authority, actions[k], tau, commands[k]):
            return False
    return True


@kernel
def mixed(
    allocation: Array, table: Array, authority: Array, action: Array, tau: Array, commands: Array
) -> bool:
    """Thruster commands of one vehicle; arguments as of `command_kernel`, but one action (6,), (n,) commands.

    Where some thruster cannot give its share, the whole demand is scaled down until all can, so that the
    wrench keeps its direction.  Thrusts become commands by the thrust curve inverted; lag and dead band are
    left as they are, and act as in the vehicle file.
    """
    for j in range(ACTIONS):
        if not math.isfinite(action[j]):
            return False
        action[j] = min(max(action[j], -1.0), 1.0)
        tau[j] = action[j] * authority[j]
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
    mixing_kernel(allocation, table, tau, commands)
    return True
