"""Covariance functions of a hull's wrench, whose variances `learn.gaussian_process` fits axis by axis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.residual.mirrors import (
    AXES,
    EPSILON,
    MIRRORS,
    PORT,
    POWERS,
    SIGNED,
    WIDTH,
    parities,
    products,
)

GUESSES = np.log(
    [
        *(1.0, 0.1, 1.0, 1.0),  # linear, and products of each power, as the symmetry allows
        *(0.03, 0.1, 1.0),  # radial functions of each power, symmetric in three planes
        *(0.002, 0.006, 0.06),  # radial functions with port-starboard symmetry
        *(0.0001, 0.0003, 0.003),  # radial functions without symmetry
        *(0.01, 0.001, 0.001, 0.001),  # linear and products that the symmetry excludes
        *(1e-4, 1e-4),  # label noise that grows as m^3, and constant label noise
    ]
)
"""Logarithms of the initial variances, in units of the label's mean square; also the mode of their prior."""
PRODUCTS_AT, OTHERS_AT = 2, 15
"""Indices of the products at p = 2 in GUESSES: those that the symmetry allows, and those that it excludes."""


class Motion(NamedTuple):
    """Motions about the centre: z (N, 6), its size m (N,), direction d (N, 6), and products (N, 57)."""

    z: Array
    size: Array
    direction: Array
    products: Array


class Hull(NamedTuple):
    """Centre of the hull's symmetry (3,) [m], and scale of the velocities (6,)."""

    centre: Array
    scale: Array

    def motion(self, nu: Array) -> Motion:
        """Return the motions of velocities (N, 6)."""
        z = np.hstack([nu[:, :3] + np.cross(nu[:, 3:], self.centre), nu[:, 3:]]) * self.scale
        size = np.sqrt((z**2).sum(axis=1) + EPSILON**2)
        direction = z / size[:, None]
        return Motion(z, size, direction, products(direction))

    def about(self, tau: Array) -> Array:
        """Return wrenches (N, 6) about the hull's centre, given wrenches (N, 6) about the origin CO."""
        return np.hstack([tau[:, :3], tau[:, 3:] - np.cross(self.centre, tau[:, :3])])


def images_of(one: Motion, other: Motion) -> Array:
    """Return the Matern 3/2 covariance between directions of motion, for all mirror images, (8, N, M).

    Args:
        one: Motion at N points, whose directions are mirrored by each of the 8 images of `MIRRORS`.
        other: Motion at M points.
    """
    far = (one.direction**2).sum(axis=1)[:, None] + (other.direction**2).sum(axis=1)
    apart = np.stack([far - 2.0 * (one.direction * g) @ other.direction.T for g in MIRRORS])
    r = np.sqrt(3.0 * np.maximum(apart, 0.0)) / WIDTH
    return np.asarray((1.0 + r) * np.exp(-r))


def _sums(images: Array, axis: int) -> list[Array]:
    """Return the sums S of `core.residual.mirrors`, (N, M) each."""
    sign = MIRRORS[:, axis]
    return [np.tensordot(sign, images, 1) / 8.0, 0.5 * (images[0] + sign[PORT] * images[PORT]), images[0]]


def mirrored(axis: int) -> NDArray[np.bool_]:
    """Return a mask of z and its products (63,) that an axis has on a hull with three planes of symmetry."""
    return np.asarray((parities() == MIRRORS[:, [axis]]).all(axis=0))


def parts_of(one: Motion, other: Motion, images: Array, axis: int) -> list[Array]:
    """Return covariance matrices (N, M) of the Gaussian processes whose sum is the hull force on an axis.

    They are in the order of GUESSES.  Two that are no drag follow: the covariances of d_i d_j at p = 2, those
    that the symmetry of the hull allows and those that it excludes.  Two earlier matrices contain them.

    Args:
        one: Motion at N points.
        other: Motion at M points.
        images: Covariances between mirror images of the motions (8, N, M), from `images_of`.
        axis: Axis of the wrench, 0 to 5.
    """
    own = mirrored(axis)
    grown = [np.outer(one.size**p, other.size**p) for p in range(1, POWERS + 1)]

    def polynomial(chosen: NDArray[np.bool_]) -> list[Array]:
        line, product = chosen[:AXES], chosen[AXES:]
        together = one.products[:, product] @ other.products[:, product].T
        return [one.z[:, line] @ other.z[:, line].T, *(together * power for power in grown)]

    def even(chosen: NDArray[np.bool_]) -> Array:
        product = chosen & (np.arange(len(chosen)) >= AXES + SIGNED)
        together = one.products[:, product[AXES:]] @ other.products[:, product[AXES:]].T
        return np.asarray(together * grown[1])

    radial = [part * power for part in _sums(images, axis) for power in grown]
    return [*polynomial(own), *radial, *polynomial(~own), even(own), even(~own)]


def noise_of(motion: Motion, logs: Array) -> Array:
    """Return the variance of the label's error (N,)."""
    return np.asarray(np.exp(logs[-2]) * motion.size ** (2 * POWERS) + np.exp(logs[-1]))
