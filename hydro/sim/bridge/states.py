"""Conversion between the vehicle's state (eta in NED, nu in FRD) and MuJoCo's (`qpos`, `qvel`).

MuJoCo's free joint has the position and linear velocity of the body's origin in the z-up world, a unit
quaternion (w, x, y, z) from FLU to that world, and the angular velocity in FLU.  F = diag(1, -1, -1) turns
NED into the z-up world and FRD into FLU.  So the orientation is F R F and the linear velocity F R v.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.vehicle.frames import (
    euler_from_quaternion,
    quaternion_from_euler,
    rotation_from_quaternion,
    swap_frd_flu,
    swap_quaternion,
)


def to_mujoco(eta: ArrayLike, nu: ArrayLike) -> tuple[Array, Array]:
    """Return the state of a vehicle in MuJoCo's coordinates.

    Args:
        eta: x y z phi theta psi of CO, NED, ZYX, shape (..., 6) [m, rad].
        nu: u v w p q r of CO over ground, FRD, shape (..., 6) [m/s, rad/s].

    Returns:
        `qpos` (..., 7) and `qvel` (..., 6).
    """
    eta, nu = np.asarray(eta, dtype=np.float64), np.asarray(nu, dtype=np.float64)
    quaternion = quaternion_from_euler(eta[..., 3], eta[..., 4], eta[..., 5])
    return coordinates(np.concatenate([eta[..., :3], quaternion], axis=-1), nu)


def coordinates(pose: Array, nu: Array) -> tuple[Array, Array]:
    """Return MuJoCo's `qpos` (..., 7) and `qvel` (..., 6) for a pose and a velocity.

    Args:
        pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED, (..., 7).
        nu: u v w p q r of CO over ground, FRD, (..., 6) [m/s, rad/s].
    """
    quaternion = pose[..., 3:]
    linear = np.einsum("...ij,...j->...i", rotation_from_quaternion(quaternion), nu[..., :3])
    qpos = np.concatenate([swap_frd_flu(pose[..., :3]), swap_quaternion(quaternion)], axis=-1)
    return qpos, np.concatenate([swap_frd_flu(linear), swap_frd_flu(nu[..., 3:])], axis=-1)


def from_mujoco(qpos: ArrayLike, qvel: ArrayLike) -> tuple[Array, Array]:
    """Return the state of a vehicle in NED and FRD, given MuJoCo's coordinates.

    Args:
        qpos: MuJoCo's positions (..., 7).
        qvel: MuJoCo's velocities (..., 6).

    Returns:
        eta (..., 6), x y z, NED [m], and ZYX Euler angles [rad]; and nu (..., 6), FRD [m/s, rad/s].
    """
    qpos, qvel = np.asarray(qpos, dtype=np.float64), np.asarray(qvel, dtype=np.float64)
    quaternion = swap_quaternion(qpos[..., 3:7])
    back = rotation_from_quaternion(quaternion)
    linear = np.einsum("...ji,...j->...i", back, swap_frd_flu(qvel[..., :3]))
    eta = np.concatenate([swap_frd_flu(qpos[..., :3]), euler_from_quaternion(quaternion)], axis=-1)
    return eta, np.concatenate([linear, swap_frd_flu(qvel[..., 3:6])], axis=-1)
