"""Conversion of a policy's actions to thruster commands: scale to a wrench, allocate, keep its direction."""

from __future__ import annotations

import math

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects import inertia_matrix
from hydro.core.effects.steering import servo_wrenches
from hydro.core.vehicle.control_allocation import Mixing, mixing, mixing_kernel, with_servos
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST

ACTIONS = 6
"""Size of an action: X, Y, Z, K, M, N in [-1, 1], each a share of the greatest wrench on that axis alone."""

YAW = 5
"""Axis of the yaw moment."""


def crew_of(vehicle: Vehicle) -> Mixing:
    """Return the control allocation of a vehicle: constants that convert a demanded wrench to commands.

    On axes without thrust, servos of fins take the demand.

    Raises:
        DataError: A thruster's placement is missing or given twice, or an effect is invalid.
    """
    return with_servos(_thrusters_of(vehicle), servo_wrenches(vehicle))


def steered_by_fins(vehicle: Vehicle) -> bool:
    """Return whether only servos of fins turn a vehicle in yaw, so that it steers only while under way.

    Raises:
        DataError: A thruster's placement is missing or given twice, or an effect is invalid.
    """
    turned = _thrusters_of(vehicle).authority[YAW] != 0.0
    return bool(not turned and servo_wrenches(vehicle)[YAW].any())


def _thrusters_of(vehicle: Vehicle) -> Mixing:
    """Return the allocation matrices of a vehicle's thrusters alone, without servos of fins."""
    return mixing(vehicle, mass_matrix(vehicle) + inertia_matrix(vehicle))


@kernel
def command_kernel(
    allocation: Array, table: Array, authority: Array, actions: Array, tau: Array, commands: Array
) -> bool:
    """Write the thruster commands of all N vehicles of a fleet, as `allocate` does for one vehicle.

    Args:
        allocation: Pseudo-inverse (n, 6) of the matrix that maps the thrusts of n thrusters to a wrench.
        table: Table of `core.vehicle.thrusters`, one row per thruster (n, columns).
        authority: Greatest wrench on each axis alone (6,) [N, N m]; 0 on an axis without authority.
        actions: Actions (N, 6), clipped to [-1, 1] in place.
        tau: Working memory (6,); its content afterwards has no meaning.
        commands: Thruster commands (N, n), written.

    Returns:
        Whether all actions are finite; otherwise the commands are invalid.
    """
    for k in range(actions.shape[0]):
        if not allocate(allocation, table, authority, actions[k], tau, commands[k]):
            return False
    return True


@kernel
def allocate(
    allocation: Array, table: Array, authority: Array, action: Array, tau: Array, commands: Array
) -> bool:
    """Write the thruster commands of one vehicle; return whether all entries of its action are finite.

    The action is a demanded wrench, as fractions of the authority.  If a thruster saturates, the whole wrench
    is scaled down, so that its direction stays the same.  The inverse thrust curve turns thrusts into
    commands.  Lag and dead band are not compensated; they act as in the vehicle file.

    Args:
        allocation: Pseudo-inverse (n, 6) of the matrix that maps the thrusts of n thrusters to a wrench.
        table: Table of `core.vehicle.thrusters`, one row per thruster (n, columns).
        authority: Greatest wrench on each axis alone (6,) [N, N m]; 0 on an axis without authority.
        action: Action (6,), clipped to [-1, 1] in place.
        tau: Working memory (6,); its content afterwards has no meaning.
        commands: Thruster commands (n,), written; invalid if the action is not finite.
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
