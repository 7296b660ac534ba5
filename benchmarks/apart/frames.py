"""Vectors, attitudes and mass matrices of a batch of bodies.

Body frame forward, right, down about a fixed origin; world north, east, down; quaternions (w, x, y, z)
that turn body into world; SI units.  Whatever has a leading B is one row per body of the batch.  Rigid
bodies after Fossen (2011), chapter 3, and Kirchhoff's equations after Lamb (1932), articles 124 and 125.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G = 9.81
"""Gravity [m/s^2]."""


def cross(a: Array, b: Array) -> Array:
    """Return the vector product along the last axis."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        -1,
    )


def skew(a: Array) -> Array:
    """Return the matrix S(a), (..., 3, 3), with S(a) b = a x b."""
    z = np.zeros(a.shape[:-1])
    return np.stack(
        [
            np.stack([z, -a[..., 2], a[..., 1]], -1),
            np.stack([a[..., 2], z, -a[..., 0]], -1),
            np.stack([-a[..., 1], a[..., 0], z], -1),
        ],
        -2,
    )


def rotation(q: Array) -> Array:
    """Return the matrices (..., 3, 3) from body to world of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        -2,
    )


def quaternion(phi: Array, theta: Array, psi: Array) -> Array:
    """Return unit quaternions (..., 4) of roll, pitch and heading [rad], rotated about z, then y, then x."""
    c, s = np.cos, np.sin
    a, b, d = phi / 2, theta / 2, psi / 2
    return np.stack(
        [
            c(a) * c(b) * c(d) + s(a) * s(b) * s(d),
            s(a) * c(b) * c(d) - c(a) * s(b) * s(d),
            c(a) * s(b) * c(d) + s(a) * c(b) * s(d),
            c(a) * c(b) * s(d) - s(a) * s(b) * c(d),
        ],
        -1,
    )


def euler(q: Array) -> Array:
    """Return roll, pitch and heading (..., 3) [rad] of unit quaternions."""
    r = rotation(q)
    return np.stack(
        [
            np.arctan2(r[..., 2, 1], r[..., 2, 2]),
            -np.arcsin(np.clip(r[..., 2, 0], -1, 1)),
            np.arctan2(r[..., 1, 0], r[..., 0, 0]),
        ],
        -1,
    )


def rigid_body(mass: float, cg: Any, inertia: Array) -> Array:
    """Return the mass matrix (6, 6) of a rigid body about the origin [kg, kg m, kg m^2].

    Args:
        mass: Mass [kg].
        cg: Centre of gravity, body frame [m].
        inertia: Inertia about the centre of gravity, (3, 3) [kg m^2].
    """
    s = skew(np.asarray(cg, float))
    m = np.zeros((6, 6))
    m[:3, :3] = mass * np.eye(3)
    m[:3, 3:] = -mass * s
    m[3:, :3] = mass * s
    m[3:, 3:] = inertia - mass * s @ s
    return m


def kirchhoff(m: Array, nu: Array) -> Array:
    """Return C(nu) nu = (omega x p, v x p + omega x h), (B, 6), of mass matrices m (B, 6, 6).

    p and h are the linear and angular momentum, the halves of m nu; nu = (v, omega).
    """
    ph = np.einsum("bij,bj->bi", m, nu)
    p, h = ph[:, :3], ph[:, 3:]
    v, om = nu[:, :3], nu[:, 3:]
    return np.concatenate([cross(om, p), cross(v, p) + cross(om, h)], -1)


def wrench(force: Array, at: Array) -> Array:
    """Return force and moment about the origin, (..., 6), of a force (..., 3) at a point of the body."""
    return np.concatenate([force, cross(at, force)], -1)
