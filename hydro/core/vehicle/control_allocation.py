"""Control allocation from a demanded wrench to thruster commands, with weak holds of depth and attitude.

Once per row of the log, the demand plus the wrench of the holds is converted to commands in [-1, 1], through
the pseudo-inverse of the thruster configuration and the inverted thrust curve.  Axes that the thrusters
cannot actuate have no authority and no hold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import balance
from hydro.core.vehicle.thrusters import (
    DELAY,
    MAX_REVERSE,
    MAX_THRUST,
    POWER,
    TIME_CONSTANT,
    allocate,
    configuration_matrix,
    thruster_table,
)

HELD = (2, 3, 4, 5)
"""Axes with a hold: heave, roll, pitch, yaw."""
FREQUENCY = np.array([0.15, 4.0, 4.0, 4.0])
"""Natural frequency [rad/s] of each hold without other forces: slow in depth, stiffer in attitude."""
LAG_MARGIN = 0.6
"""Maximum of natural frequency times thruster time constant: a faster hold would oscillate."""
DAMPING_RATIO = np.array([0.7, 0.5, 0.5, 0.7])
"""Damping ratio of each hold, for the total stiffness of the hold and of weight and buoyancy."""


@dataclass(frozen=True)
class Mixing:
    """Constants of one vehicle that convert a demanded wrench to thruster commands.

    A hold is a weak proportional-derivative controller that keeps the depth, roll, pitch or heading.

    Attributes:
        authority: Maximum wrench on each axis alone (6,) [N, N m]; 0 where the thrusters cannot actuate it.
        allocation: Pseudo-inverse (n, 6) of the configuration matrix B of the n thrusters: the thrusts [N]
            for a wrench.
        table: Thruster table, one row of constants per thruster, (n, columns); see `vehicle.thrusters`.
        gains: Stiffness and damping (4, 2) of the holds of depth, roll, pitch and heading [N/m, N s/m; N
            m/rad, N m s/rad].
        righting: Total stiffness (2,) in roll and in pitch [N m/rad], of the hold and of weight and buoyancy.
    """

    authority: Array
    allocation: Array
    table: Array
    gains: Array
    righting: Array

    @property
    def axes(self) -> tuple[int, ...]:
        """Indices of the axes that the thrusters can actuate, ascending, 0 (surge) to 5 (yaw)."""
        return tuple(int(axis) for axis in np.flatnonzero(self.authority))


def mixing(vehicle: Vehicle, mass_matrix: Array) -> Mixing:
    """Return the constants of a vehicle for control allocation: authority, allocation and gains of the holds.

    Args:
        vehicle: Vehicle file; thruster effects such as gains are ignored, since a pilot does not know them.
        mass_matrix: Mass matrix M with added mass about CO, (6, 6).

    Raises:
        DataError: A thruster has no placement, or two.
    """
    table, B = thruster_table(vehicle), configuration_matrix(vehicle)
    limit = np.minimum(table[:, MAX_THRUST], table[:, MAX_REVERSE])
    pushes = limit > 0.0  # a servo gives no thrust
    authority = np.zeros(6)
    for axis, unit in enumerate(np.eye(6)):
        thrusts = allocate(B, unit)
        if np.abs(B @ thrusts - unit).max() < 1e-6:
            authority[axis] = (limit / np.maximum(np.abs(thrusts), 1e-12))[pushes].min()
    possible = authority[list(HELD)] > 0.0
    slowest = float((table[:, TIME_CONSTANT] + table[:, DELAY])[pushes].max(initial=1e-9))
    frequency = np.minimum(FREQUENCY, LAG_MARGIN / slowest) * possible
    restoring = float(balance(vehicle)[3]) * np.array([0.0, 1.0, 1.0, 0.0])
    inertia = np.diag(mass_matrix)[list(HELD)]
    stiffness = inertia * frequency**2
    critical = 2.0 * np.sqrt(inertia * np.maximum(stiffness + restoring, 0.0))
    gains = np.column_stack([stiffness, DAMPING_RATIO * critical * possible])
    pseudo_inverse = np.asarray(np.linalg.pinv(B), dtype=np.float64)
    return Mixing(authority, pseudo_inverse, table, gains, (stiffness + restoring)[1:3])


TURNING = (3, 4, 5)
"""Axes that fins can steer: roll, pitch, yaw."""


def with_servos(crew: Mixing, wrenches: Array) -> Mixing:
    """Return a copy of the constants with which fin servos produce the moments that no thruster can produce.

    A demanded moment then gives commands of the servos, computed for the moments of the fins at one speed.
    The forces of the fins are ignored.

    Args:
        crew: Constants for the thrusters alone.
        wrenches: Wrench of each of n commands at full deflection of a servo, (6, n), 0 for thrusters; see
            `effects.steering.servo_wrenches`, which also gives the speed.
    """
    axes = [axis for axis in TURNING if crew.authority[axis] == 0.0]
    steered = np.zeros((len(crew.table), 6))
    steered[:, axes] = np.linalg.pinv(wrenches[axes])
    authority = crew.authority.copy()
    for axis in axes:
        alone, most = wrenches[axes] @ steered[:, axis], np.abs(steered[:, axis]).max()
        if most > 0.0 and np.allclose(alone, np.eye(6)[axes, axis], atol=1e-6):
            authority[axis] = 1.0 / most
    steered[:, authority == 0.0] = 0.0
    return replace(crew, authority=authority, allocation=crew.allocation + steered)


@kernel
def hold_kernel(
    gains: Array, R: Array, depth: float, nu: Array, target_depth: float, heading: Array, tau: Array
) -> None:
    """Add the wrench of the holds: proportional and derivative action on depth, roll, pitch and heading.

    Args:
        gains: Gains of the holds, (4, 2), as in `Mixing`.
        R: Rotation from body to NED, row by row, (9,).
        depth: z of CO [m].
        nu: Velocity of CO, body axes, (6,) [m/s, rad/s].
        target_depth: Depth to hold [m].
        heading: (cos, sin) of the heading to hold; (0, 0) holds none and leaves yaw undamped.
        tau: Wrench about CO, (6,) [N, N m], added to.
    """
    sink = R[6] * nu[0] + R[7] * nu[1] + R[8] * nu[2]
    down = gains[0, 0] * (target_depth - depth) - gains[0, 1] * sink
    for i in range(3):
        tau[i] += R[6 + i] * down
    # The world's down direction in body axes is (-sin theta, cos theta sin phi, …).
    tau[3] -= gains[1, 0] * R[7] + gains[1, 1] * nu[3]
    tau[4] -= -gains[2, 0] * R[6] + gains[2, 1] * nu[4]
    held = heading[0] * heading[0] + heading[1] * heading[1]
    tau[5] += gains[3, 0] * (R[0] * heading[1] - R[3] * heading[0]) - held * gains[3, 1] * nu[5]


@kernel
def mixing_kernel(allocation: Array, table: Array, tau: Array, commands: Array) -> None:
    """Write the thruster commands that give a demanded wrench to `commands`.

    The thrusts follow from the pseudo-inverse; the thrust curve is inverted, and commands are clipped to [-1,
    1]. The dead band is not compensated: a demand too small for it is lost, as for a pilot.  Commands are
    rounded to float32, the precision of the log, so that the log contains the applied values.  For a fin's
    servo, the allocation gives the command itself; it is zero without `with_servos`.

    Args:
        allocation: Pseudo-inverse of B for n thrusters, (n, 6), as in `Mixing`.
        table: Thruster table, (n, columns).
        tau: Demanded wrench about CO, (6,) [N, N m].
        commands: Output: commands, (n,).
    """
    for i in range(table.shape[0]):
        thrust = 0.0
        for j in range(6):
            thrust += allocation[i, j] * tau[j]
        limit = table[i, MAX_THRUST] if thrust > 0.0 else table[i, MAX_REVERSE]
        size = min(abs(thrust) / limit, 1.0) if limit > 0.0 else 0.0
        if table[i, MAX_THRUST] == 0.0:  # a servo
            size = min(abs(thrust), 1.0)
        if table[i, POWER] != 1.0:
            size = math.sqrt(size) if table[i, POWER] == 2.0 else size ** (1.0 / table[i, POWER])
        commands[i] = np.float64(np.float32(math.copysign(size, thrust)))
