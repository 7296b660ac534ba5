"""Residual wrench of each row from motion, thrust and attitude; paper (3), (10), (11)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import polars as pl

from hydro.core.columns import VELOCITY, WRENCH, Array, Array32
from hydro.core.compiled import jit
from hydro.core.effects import inertia_matrix
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import balance, mass_matrix, restoring_kernel
from hydro.core.vehicle.thrusters import UNIT_WRENCH


def names(thrusters: int) -> list[str]:
    """Return the names of the columns that labels add to a raw table.

    Args:
        thrusters: Number of thrusters.
    """
    return [
        *(f"{name}_s" for name in VELOCITY),
        *(f"{name}_dot" for name in VELOCITY),
        *(f"f_{i + 1}" for i in range(thrusters)),
        *(f"{name}_prop" for name in WRENCH),
        *(f"{name}_res" for name in WRENCH),
    ]


def columns(frame: pl.DataFrame, names: Sequence[str]) -> Array:
    """Return k columns of a table of N rows as one new float64 array in C order, (N, k)."""
    out = np.empty((frame.height, len(names)))
    for i, name in enumerate(names):
        out[:, i] = frame[name].to_numpy()
    return out


class Constants(NamedTuple):
    """Constants of a vehicle in the balance of wrenches that gives the labels.

    Attributes:
        configuration: Wrench about CO per newton of each of n thrusters, B^T, (n, 6).
        mass: Mass matrix M with added mass about CO, (6, 6).
        weight: Net weight and its moments, (4,), from `rigid_body.balance`.
    """

    configuration: Array
    mass: Array
    weight: Array


class Terms(NamedTuple):
    """Terms of the balance of wrenches in N rows of a recording.

    Attributes:
        motion: Velocity nu and acceleration nu_dot of CO, body axes, (N, 6, 2).
        attitude: phi, theta, psi [rad], (N, 3).
        thrust: Thrusts of n thrusters [N], (N, n).
        forces: Wrenches of the effects to subtract, (N, 6) [N, N m]; (0, 6) if none are subtracted.
    """

    motion: Array
    attitude: Array
    thrust: Array
    forces: Array


def constants(vehicle: Vehicle, table: Array) -> Constants:
    """Return the constants of a vehicle in the balance of wrenches that gives the labels.

    Args:
        vehicle: The vehicle.
        table: Thruster table of its n thrusters, (n, columns), from `effects.thruster_table`.
    """
    mass = mass_matrix(vehicle) + inertia_matrix(vehicle)
    return Constants(np.ascontiguousarray(table[:, UNIT_WRENCH]), mass, balance(vehicle))


@jit
def label_kernel(rows: Terms, known: Constants, start: int, out: Array32) -> None:
    """Write the label columns of consecutive rows to `out`, from its column `start` on.

    Args:
        rows: Terms of the rows.
        known: Constants of the vehicle.
        start: Index within the recording of the first of these rows.
        out: Output for all N rows, in the order of `names`, for n thrusters, (24 + n, N): velocities nu,
            accelerations nu_dot, thrusts, the thrusters' wrench tau_prop and the residual wrench tau_res.
    """
    motion, attitude, thrust, forces = rows.motion, rows.attitude, rows.thrust, rows.forces
    configuration, mass, weight = known.configuration, known.mass, known.weight
    count = thrust.shape[1]
    down, tau, restoring = np.empty(3), np.empty(6), np.empty(6)
    for k in range(motion.shape[0]):
        phi, theta = attitude[k, 0], attitude[k, 1]
        down[0] = -math.sin(theta)
        down[1] = math.cos(theta) * math.sin(phi)
        down[2] = math.cos(theta) * math.cos(phi)
        restoring[:] = 0.0
        restoring_kernel(weight, down, restoring)
        tau[:] = 0.0
        for n in range(count):
            out[12 + n, start + k] = thrust[k, n]
            for i in range(6):
                tau[i] += configuration[n, i] * thrust[k, n]
        for i in range(6):
            inertia = 0.0
            for j in range(6):
                inertia += mass[i, j] * motion[k, j, 1]
            out[i, start + k] = motion[k, i, 0]
            out[6 + i, start + k] = motion[k, i, 1]
            out[12 + count + i, start + k] = tau[i]
            exerted = forces[k, i] if forces.shape[0] else 0.0
            out[18 + count + i, start + k] = tau[i] - inertia + restoring[i] + exerted
