"""Frames and attitudes: NED world, FRD body, ZYX Euler angles, quaternions, and MuJoCo's FLU mask.

Equation numbers are of Fossen, *Handbook of Marine Craft Hydrodynamics and Motion Control* (2011), ch. 2.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.errors import DataError

HALF_TURN: Array = np.array([1.0, -1.0, -1.0])
"""Signs of a half-turn about x, its own inverse: convert FRD to FLU axes, and NED to a z-up world."""
FRD_FLU: Array = np.concatenate([HALF_TURN, HALF_TURN])
"""Signs of the same half-turn for a twist or wrench of six components."""

_LOCK = 1e-8  # below this cos(theta), roll and yaw rotate about the same axis


@kernel
def rotation_kernel(phi: float, theta: float, psi: float, out: Array) -> None:
    """Write the rotation from body to NED, R = Rz(psi) Ry(theta) Rx(phi), into `out` (9,), row-major.

    Source: Fossen (2.18).  The last row `out[6:9]` is the world's down direction in body axes.
    """
    c_phi, s_phi = math.cos(phi), math.sin(phi)
    c_theta, s_theta = math.cos(theta), math.sin(theta)
    c_psi, s_psi = math.cos(psi), math.sin(psi)
    out[0] = c_psi * c_theta
    out[1] = c_psi * s_theta * s_phi - s_psi * c_phi
    out[2] = c_psi * s_theta * c_phi + s_psi * s_phi
    out[3] = s_psi * c_theta
    out[4] = s_psi * s_theta * s_phi + c_psi * c_phi
    out[5] = s_psi * s_theta * c_phi - c_psi * s_phi
    out[6] = -s_theta
    out[7] = c_theta * s_phi
    out[8] = c_theta * c_phi


@kernel
def quaternion_kernel(quaternion: Array, out: Array) -> None:
    """Write the rotation matrix of a quaternion (w, x, y, z) into `out` (9,), row-major.

    The quaternion may have any length but zero.
    """
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    twice = 2.0 / (w * w + x * x + y * y + z * z)
    out[0] = 1.0 - twice * (y * y + z * z)
    out[1] = twice * (x * y - w * z)
    out[2] = twice * (x * z + w * y)
    out[3] = twice * (x * y + w * z)
    out[4] = 1.0 - twice * (x * x + z * z)
    out[5] = twice * (y * z - w * x)
    out[6] = twice * (x * z - w * y)
    out[7] = twice * (y * z + w * x)
    out[8] = 1.0 - twice * (x * x + y * y)


@kernel
def quaternion_product_kernel(q: Array, w: float, x: float, y: float, z: float, out: Array) -> None:
    """Write the quaternion product q (w, x, y, z) into `out` (4,): rotation by (w, x, y, z), then by q."""
    out[0] = q[0] * w - q[1] * x - q[2] * y - q[3] * z
    out[1] = q[0] * x + q[1] * w + q[2] * z - q[3] * y
    out[2] = q[0] * y - q[1] * z + q[2] * w + q[3] * x
    out[3] = q[0] * z + q[1] * y - q[2] * x + q[3] * w


def quaternion_product(q: Array, w: Array, x: Array, y: Array, z: Array) -> Array:
    """Return the products of N quaternions q with quaternions (w, x, y, z), as (w, x, y, z), (N, 4).

    Args:
        q: Quaternions on the left, as (w, x, y, z), (N, 4).
        w: Real parts of the quaternions on the right, (N,) or (1,).
        x: First imaginary parts, (N,) or (1,).
        y: Second imaginary parts, (N,) or (1,).
        z: Third imaginary parts, (N,) or (1,).
    """
    a, b, c, d = q.T
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=1,
    )


@kernel
def _rotation_columns(phi: Array, theta: Array, psi: Array, out: Array) -> None:
    """Write the rotations of many Euler angles (N,) to `out` (N, 9)."""
    for k in range(phi.size):
        rotation_kernel(phi[k], theta[k], psi[k], out[k])


def rotation(phi: ArrayLike, theta: ArrayLike, psi: ArrayLike) -> Array:
    """Return the rotation from body (FRD) to world (NED) axes, Fossen (2.18).

    Args:
        phi: Roll [rad], any shape.
        theta: Pitch [rad], broadcast against `phi`.
        psi: Yaw [rad], broadcast against `phi`.

    Returns:
        R of shape (..., 3, 3): a vector x in body axes is R x in world axes.
    """
    shape, (roll, pitch, yaw) = _columns(phi, theta, psi)
    out = np.empty((roll.size, 9))
    _rotation_columns(roll, pitch, yaw, out)
    return out.reshape(*shape, 3, 3)


def euler_rate_matrix(phi: ArrayLike, theta: ArrayLike) -> Array:
    """Return the matrix T of shape (..., 3, 3) with d(phi, theta, psi)/dt = T (p, q, r); Fossen (2.28).

    Args:
        phi: Roll [rad].
        theta: Pitch [rad]; T grows without bound toward +-90 degrees, where Euler angles are singular.
    """
    roll, pitch = np.broadcast_arrays(np.asarray(phi, float), np.asarray(theta, float))
    matrix = np.zeros((*roll.shape, 3, 3))
    matrix[..., 0, 0] = 1.0
    matrix[..., 0, 1] = np.sin(roll) * np.tan(pitch)
    matrix[..., 0, 2] = np.cos(roll) * np.tan(pitch)
    matrix[..., 1, 1] = np.cos(roll)
    matrix[..., 1, 2] = -np.sin(roll)
    matrix[..., 2, 1] = np.sin(roll) / np.cos(pitch)
    matrix[..., 2, 2] = np.cos(roll) / np.cos(pitch)
    return matrix


def euler_from_rotation(R: ArrayLike) -> Array:
    """Return ZYX Euler angles (phi, theta, psi) [rad] of rotations; Fossen sec. 2.2.1.

    Args:
        R: Rotations body to world, shape (..., 3, 3).

    Returns:
        Angles of shape (..., 3), phi and psi in [-pi, pi], theta in [-pi/2, pi/2].  At theta = +-pi/2, where
        only a combination of phi and psi is defined, phi = 0.
    """
    matrix = np.asarray(R, float)
    cos_theta = np.hypot(matrix[..., 0, 0], matrix[..., 1, 0])
    theta = np.arctan2(-matrix[..., 2, 0], cos_theta)
    locked = cos_theta < _LOCK
    phi = np.where(locked, 0.0, np.arctan2(matrix[..., 2, 1], matrix[..., 2, 2]))
    psi = np.where(
        locked,
        np.arctan2(-matrix[..., 0, 1], matrix[..., 1, 1]),
        np.arctan2(matrix[..., 1, 0], matrix[..., 0, 0]),
    )
    return np.stack([phi, theta, psi], axis=-1)


def body_states(eta: ArrayLike, nu: ArrayLike) -> Array:
    """Return states of a body as one array: position, attitude as a unit quaternion, velocity.

    Args:
        eta: Poses x y z phi theta psi, NED, (..., 6) [m, rad].
        nu: Velocities of CO, body axes, (..., 6) [m/s, rad/s].

    Returns:
        x y z, quaternion (w, x, y, z), and nu, (..., 13).
    """
    pose, velocity = np.asarray(eta, np.float64), np.asarray(nu, np.float64)
    attitude = quaternion_from_euler(*np.moveaxis(pose[..., 3:], -1, 0))
    return np.concatenate([pose[..., :3], attitude, velocity], axis=-1)


def quaternion_from_euler(phi: ArrayLike, theta: ArrayLike, psi: ArrayLike) -> Array:
    """Return the unit quaternion (w, x, y, z) of the rotation body to world, with w >= 0.

    Args:
        phi: Roll [rad], any shape.
        theta: Pitch [rad], broadcast against `phi`.
        psi: Yaw [rad], broadcast against `phi`.

    Returns:
        Quaternions of shape (..., 4): the product of half-angle turns about z, y and x (Fossen sec. 2.2.3).
    """
    roll, pitch, yaw = (0.5 * np.asarray(angle, float) for angle in (phi, theta, psi))
    c1, s1, c2, s2, c3, s3 = (
        np.cos(roll),
        np.sin(roll),
        np.cos(pitch),
        np.sin(pitch),
        np.cos(yaw),
        np.sin(yaw),
    )
    quaternion = np.stack(
        [
            c1 * c2 * c3 + s1 * s2 * s3,
            s1 * c2 * c3 - c1 * s2 * s3,
            c1 * s2 * c3 + s1 * c2 * s3,
            c1 * c2 * s3 - s1 * s2 * c3,
        ],
        axis=-1,
    )
    return np.where(quaternion[..., :1] < 0.0, -quaternion, quaternion)


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Return the rotation body to world (..., 3, 3) from quaternions (w, x, y, z); Fossen sec. 2.2.2.

    Args:
        quaternion: Quaternions, (..., 4), of any length but zero.

    Raises:
        DataError: A quaternion is zero or not finite, so it is not a rotation.
    """
    q = np.asarray(quaternion, float)
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    if not np.all(np.isfinite(norm) & (norm > 0.0)):
        raise DataError(
            "quaternion: has length 0 or is not finite, so it is no rotation; give (w, x, y, z) of length 1"
        )
    q = q / norm
    w, vector = q[..., 0, None, None], q[..., 1:]
    cross = skew(vector)
    return np.asarray(np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross)


def euler_from_quaternion(quaternion: ArrayLike) -> Array:
    """Return ZYX Euler angles (..., 3) [rad] from quaternions (w, x, y, z) of shape (..., 4).

    Raises:
        DataError: A quaternion is zero or not finite.
    """
    return euler_from_rotation(rotation_from_quaternion(quaternion))


def swap_frd_flu(x: ArrayLike) -> Array:
    """Return vectors, twists or wrenches converted from FRD to FLU axes, or back: a half-turn about x.

    Args:
        x: Vectors of shape (..., 3), or twists and wrenches of shape (..., 6).

    Returns:
        A new array of the same shape.

    Raises:
        DataError: The last axis has neither 3 nor 6 components.
    """
    values = np.asarray(x, float)
    if values.shape[-1:] not in {(3,), (6,)}:
        raise DataError(f"FRD/FLU: the last axis must have 3 or 6 components, got shape {values.shape}")
    return np.asarray(values * FRD_FLU[: values.shape[-1]])


def swap_quaternion(quaternion: ArrayLike) -> Array:
    """Return rotations from FLU to the z-up world, given rotations from FRD to NED, or the reverse.

    The conversion is F R F, with the half-turn F about x.

    Args:
        quaternion: Rotations R as quaternions (w, x, y, z), (..., 4).

    Returns:
        Quaternions, (..., 4).
    """
    turned: Array = np.asarray(quaternion, float) * np.concatenate([[1.0], HALF_TURN])
    return turned


def wrapped(angle: ArrayLike) -> Array:
    """Return angles wrapped to (-pi, pi] [rad], in the shape of the given angles [rad]."""
    return np.asarray(np.pi - np.mod(np.pi - np.asarray(angle, float), 2.0 * np.pi))


def skew(a: ArrayLike) -> Array:
    """Return the cross-product matrix S of vectors `a` (..., 3): S b = a x b for any vector b.

    (..., 3, 3).
    """
    vector = np.asarray(a, float)
    matrix = np.zeros((*vector.shape, 3))
    matrix[..., 0, 1], matrix[..., 1, 0] = -vector[..., 2], vector[..., 2]
    matrix[..., 0, 2], matrix[..., 2, 0] = vector[..., 1], -vector[..., 1]
    matrix[..., 1, 2], matrix[..., 2, 1] = -vector[..., 0], vector[..., 0]
    return matrix


def _columns(*angles: ArrayLike) -> tuple[tuple[int, ...], tuple[Any, ...]]:
    """Return the common shape of several angles, and each as a flat float64 column."""
    wide = np.broadcast_arrays(*(np.asarray(angle, float) for angle in angles))
    return wide[0].shape, tuple(np.ascontiguousarray(angle).ravel() for angle in wide)
