"""Rigid body about the body origin CO: inertia, Coriolis and centripetal terms, weight and buoyancy.

Equation numbers are of Fossen, *Handbook of Marine Craft Hydrodynamics and Motion Control* (2011).
Wrenches and velocities are six components in body axes (FRD), order X Y Z K M N and u v w p q r.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.compiled import kernel, within
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import skew


def mass_matrix(vehicle: Vehicle) -> Array:
    """Return the rigid-body mass matrix M_RB about CO, (6, 6) [kg, kg m, kg m^2]; Fossen (3.44).

    The kinetic energy of the dry body is nu^T M_RB nu / 2.
    """
    body = vehicle.rigid_body
    lever = skew(body.center_of_gravity)
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = body.mass * np.eye(3)
    matrix[:3, 3:] = -body.mass * lever
    matrix[3:, :3] = body.mass * lever
    matrix[3:, 3:] = np.asarray(body.inertia) - body.mass * lever @ lever  # parallel axes
    return matrix


@within
def coriolis_kernel(matrix: Array, nu: Array, out: Array) -> None:
    """Add C(nu) nu to `out` (6,): force omega x p, and moment v x p + omega x h.

    p and h are the linear and angular momentum M nu of a body, or of its added mass; v and omega are the
    linear and angular velocity.  So this is Kirchhoff's equation (Fossen sec. 6.3.1) and equal to Fossen's
    theorem 3.2.

    Args:
        matrix: Symmetric mass matrix M, row-major, (36,).
        nu: Velocity of CO in body axes, (6,) [m/s, rad/s].
        out: Output, (6,) [N, N m], added to.
    """
    px = py = pz = hx = hy = hz = 0.0
    for j in range(6):
        px += matrix[j] * nu[j]
        py += matrix[6 + j] * nu[j]
        pz += matrix[12 + j] * nu[j]
        hx += matrix[18 + j] * nu[j]
        hy += matrix[24 + j] * nu[j]
        hz += matrix[30 + j] * nu[j]
    u, v, w, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    out[0] += q * pz - r * py
    out[1] += r * px - p * pz
    out[2] += p * py - q * px
    out[3] += v * pz - w * py + q * hz - r * hy
    out[4] += w * px - u * pz + r * hx - p * hz
    out[5] += u * py - v * px + p * hy - q * hx


def coriolis_matrix(matrix: ArrayLike, nu: ArrayLike) -> Array:
    """Return the skew-symmetric Coriolis matrix C(nu) of an inertia matrix; Fossen theorem 3.2.

    Args:
        matrix: Symmetric inertia M, shape (6, 6): M_RB, M_A or their sum.
        nu: Velocity of CO in body axes, shape (..., 6) [m/s, rad/s].

    Returns:
        C of shape (..., 6, 6): C nu is on the left-hand side with M nu_dot, and nu^T C nu = 0.
    """
    momentum = np.asarray(nu, float) @ np.asarray(matrix, float).T
    linear, angular = skew(momentum[..., :3]), skew(momentum[..., 3:])
    coriolis = np.zeros((*momentum.shape, 6))
    coriolis[..., :3, 3:] = -linear
    coriolis[..., 3:, :3] = -linear
    coriolis[..., 3:, 3:] = -angular
    return coriolis


def balance(vehicle: Vehicle) -> Array:
    """Return the net weight and its moments, (4,): W - B [N], then the vector W r_g - B r_b [N m].

    W is the weight, B the buoyancy; r_g and r_b are the centres of gravity and buoyancy from CO, body FRD.
    """
    weight = vehicle.rigid_body.mass * vehicle.environment.gravity
    force = vehicle.buoyancy.force
    moment = weight * np.asarray(vehicle.rigid_body.center_of_gravity) - force * np.asarray(
        vehicle.buoyancy.center
    )
    return np.array([weight - force, *moment])


@kernel
def restoring_kernel(balance: Array, down: Array, out: Array) -> None:
    """Add the wrench of weight and buoyancy on the vehicle, about CO, to `out`.

    The force is (W - B) down, the moment (W r_g - B r_b) x down, with weight W, buoyancy B, and their centres
    r_g and r_b from CO; Fossen (4.3)-(4.6) with the sign of a force on the vehicle.

    Args:
        balance: W - B and W r_g - B r_b, (4,), from `balance`.
        down: World's down direction in body axes, (3,): the last row of the rotation from body to NED.
        out: Output, (6,) [N, N m], added to.
    """
    for i in range(3):
        out[i] += balance[0] * down[i]
    out[3] += balance[2] * down[2] - balance[3] * down[1]
    out[4] += balance[3] * down[0] - balance[1] * down[2]
    out[5] += balance[1] * down[1] - balance[2] * down[0]


@kernel
def _restoring_columns(balance: Array, down: Array, out: Array) -> None:
    """Write the restoring wrenches for down directions (N, 3) to `out` (N, 6)."""
    for k in range(down.shape[0]):
        restoring_kernel(balance, down[k], out[k])


def restoring(vehicle: Vehicle, phi: ArrayLike, theta: ArrayLike) -> Array:
    """Return the wrench of weight and buoyancy on the vehicle, -g(eta) of Fossen (4.6).

    Args:
        vehicle: The vehicle.
        phi: Roll [rad], any shape.
        theta: Pitch [rad], broadcast against `phi`.

    Returns:
        Wrench about CO in body axes, shape (..., 6) [N, N m].
    """
    down = _down(phi, theta)
    wrench = np.zeros((*down.shape[:-1], 6))
    _restoring_columns(balance(vehicle), down.reshape(-1, 3), wrench.reshape(-1, 6))
    return wrench


def potential(vehicle: Vehicle, z: ArrayLike, phi: ArrayLike, theta: ArrayLike) -> Array:
    """Return the potential energy of weight and buoyancy [J]; 0 if both centres are at the surface.

    The restoring wrench is the negative gradient of this energy along the motions of the body.

    Args:
        vehicle: The vehicle.
        z: Depth of CO [m], down positive; broadcast against the angles.
        phi: Roll [rad], any shape.
        theta: Pitch [rad], broadcast against `phi`.
    """
    net, *moment = balance(vehicle)
    return np.asarray(-net * np.asarray(z, float) - _down(phi, theta) @ np.asarray(moment))


def _down(phi: ArrayLike, theta: ArrayLike) -> Array:
    """Return the world's down direction in body axes, (..., 3): the last row of the rotation body to NED."""
    roll, pitch = np.broadcast_arrays(np.asarray(phi, float), np.asarray(theta, float))
    return np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)], axis=-1)
