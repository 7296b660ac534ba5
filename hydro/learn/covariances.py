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
    """Motions of N velocities about the hull's centre, scaled as in `core.residual.mirrors`.

    Attributes:
        z: Scaled velocities about the centre (N, 6).
        size: m = |z|, near rest EPSILON, (N,).
        direction: d = z / m (N, 6).
        products: Products |d_i| d_j and d_i d_j of the directions (N, 57).
    """

    z: Array
    size: Array
    direction: Array
    products: Array


class Hull(NamedTuple):
    """Centre of the hull's symmetry, and factors that make linear and angular velocities comparable.

    Attributes:
        centre: Centre of the hull's symmetry (3,) [m], FRD from CO.
        scale: Factors on u v w [s/m] and p q r [s/rad], (6,).
    """

    centre: Array
    scale: Array

    def motion(self, nu: Array) -> Motion:
        """Return the scaled motions of velocities nu of CO (N, 6) [m/s, rad/s], FRD."""
        z = np.hstack([nu[:, :3] + np.cross(nu[:, 3:], self.centre), nu[:, 3:]]) * self.scale
        size = np.sqrt((z**2).sum(axis=1) + EPSILON**2)
        direction = z / size[:, None]
        return Motion(z, size, direction, products(direction))

    def about(self, tau: Array) -> Array:
        """Return wrenches (N, 6) [N, N m] about the hull's centre, given wrenches `tau` about CO (N, 6)."""
        return np.hstack([tau[:, :3], tau[:, 3:] - np.cross(self.centre, tau[:, :3])])


def images_of(one: Motion, other: Motion) -> Array:
    """Return the covariances between directions of motion, for each of 8 mirror images, (8, N, M).

    The covariance function is Matern 3/2.

    Args:
        one: Motion at N points, whose directions are mirrored by each of the 8 images of `MIRRORS`.
        other: Motion at M points.
    """
    far = (one.direction**2).sum(axis=1)[:, None] + (other.direction**2).sum(axis=1)
    apart = np.stack([far - 2.0 * (one.direction * g) @ other.direction.T for g in MIRRORS])
    r = np.sqrt(3.0 * np.maximum(apart, 0.0)) / WIDTH
    return np.asarray((1.0 + r) * np.exp(-r))


def _sums(images: Array, axis: int) -> list[Array]:
    """Return the three sums S_0, S_1, S_2 of `core.residual.mirrors`, each (N, M), from `images_of`.

    Args:
        images: Covariances between the mirror images of N and M motions (8, N, M).
        axis: Axis of the wrench, 0 to 5.
    """
    sign = MIRRORS[:, axis]
    return [np.tensordot(sign, images, 1) / 8.0, 0.5 * (images[0] + sign[PORT] * images[PORT]), images[0]]


def mirrored(axis: int) -> NDArray[np.bool_]:
    """Return a mask of the terms that an axis of the wrench can have on a hull with three planes of symmetry.

    Args:
        axis: Axis of the wrench, 0 to 5.

    Returns:
        Mask (63,): the six components of the scaled velocity z, then the 36 products |z_i| z_j, row by row,
        then the 21 products z_i z_j with i <= j.
    """
    return np.asarray((parities() == MIRRORS[:, [axis]]).all(axis=0))


def parts_of(one: Motion, other: Motion, images: Array, axis: int) -> list[Array]:
    """Return the covariance matrices (N, M) of the Gaussian processes whose sum is the hull force on an axis.

    The matrices are without the variances, by which the caller multiplies them.

    Args:
        one: Motion at N points.
        other: Motion at M points.
        images: Covariances between mirror images of the motions (8, N, M), from `images_of`.
        axis: Axis of the wrench, 0 to 5.

    Returns:
        List of matrices in the order of GUESSES without its last two entries, which are label noise.  Two
        more follow, which belong to no drag: the covariances of the products d_i d_j of directions with
        second power of the size, first those that the symmetry of the hull allows, then those that it
        excludes.  The matrices PRODUCTS_AT and OTHERS_AT of the list contain them.
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
    """Return the variance of each label's error (N,): a constant plus a part that grows with m^6.

    Args:
        motion: N motions, with their sizes m.
        logs: Logarithms of the variances, in the order of GUESSES; the last two are those of the label.
    """
    return np.asarray(np.exp(logs[-2]) * motion.size ** (2 * POWERS) + np.exp(logs[-1]))
