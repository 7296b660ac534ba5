"""The wrench of a hull as sums over points of the sphere of motions, each seen in the mirrors of the hull.

Motion about a centre c is z = scale * nu_c, of size m = |z| and direction d = z / m; near rest, m is EPSILON.

    tau_c = L z  +  sum_p m^p (B_p b(d) + sum_k sum_s W_pks S_s(d, d_k)),        p = 1, 2, 3

b(d) are the 57 numbers |d_i| d_j and d_i d_j, of which drag and Coriolis forces are sums at p = 2.  The S are
radial functions R(d, d_k) = exp(-|d - d_k|^2 / (2 l^2)) between directions:

    0, 1  sum over the eight mirror images g of chi(g) R(g d, d_k) / 8, of the narrow and of the wide l
    2     (R(d, d_k) + chi R(d', d_k)) / 2, d' the image in the plane of port and starboard, of the wide l
    3     R(d, d_k), of the wide l

chi(g) = +-1 is what the mirror makes of the axis, so that S 0 and 1 hold for a hull with three planes of
symmetry, S 2 for one whose sides are equal, and S 3 for any.  Far from all points the R are 0 and what is left
grows with the powers of the speed.  Beyond the greatest m that was seen the wrench grows as the square.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array, Array32
from hydro.core.compiled import kernel

AXES, POWERS, SUMS = 6, 3, 4
NARROW, WIDE = 0.7, 1.4
"""Widths l of the radial functions; the narrow one is the fourth power of the wide one."""
EPSILON = 0.05
PRODUCTS = 57
PORT = 2
"""Number of the image in the plane of port and starboard; 0 is the motion itself."""
MIRRORS = np.array(
    [[a, b, c, b * c, a * c, a * b] for a in (1.0, -1.0) for b in (1.0, -1.0) for c in (1.0, -1.0)]
)
"""chi: signs of (u, v, w, p, q, r), and of X to N, in each image, (8, 6)."""
CENTRE, SCALE, TOP, LINEAR, LIBRARY = 0, 3, 9, 10, 46
POINTS = LIBRARY + POWERS * PRODUCTS * AXES
"""Where the weights begin: c, scale, greatest m, L row by row, B by power, product and axis, points."""
OF_POINT = AXES + SUMS * POWERS * AXES
"""Weights of a point: its direction, then W by sum, power and axis."""
SCRATCH = 131
"""Numbers that the kernel works on."""


def products(z: Array) -> Array:
    """The numbers |z_i| z_j, then z_i z_j of i <= j, (N, PRODUCTS), of z (N, 6)."""
    signed = [np.abs(z[:, [i]]) * z for i in range(AXES)]
    return np.hstack([*signed, *(z[:, [i]] * z[:, i:] for i in range(AXES))])


def parities() -> Array:
    """Signs of the six z and of the products in each image, (8, 6 + PRODUCTS)."""
    one = np.ones((1, AXES))
    plain = np.hstack([one, products(one)])
    return np.vstack([np.hstack([one * g, products(one * g)]) / plain for g in MIRRORS])


@kernel
def mirrored_wrench(
    weights: Array32, start: int, points: int, nu: Array, scratch: Array, out: Array32
) -> None:
    """Write the wrench (6,) about CO [N, N m] of a velocity nu (6,), with weights from `start` on.

    Sums are in float64 (`scratch`, of SCRATCH numbers): weights of points side by side nearly cancel.
    """
    z, d, tau, image = scratch[:6], scratch[6:12], scratch[12:18], scratch[18:26]
    x, b = scratch[26:32], scratch[32 : 32 + PRODUCTS]
    sums, grown = scratch[89:113].reshape(SUMS, AXES), scratch[113:131].reshape(POWERS, AXES)
    tau[:] = 0.0
    grown[:] = 0.0
    one, two, three = weights[start], weights[start + 1], weights[start + 2]
    z[0] = nu[0] + nu[4] * three - nu[5] * two
    z[1] = nu[1] + nu[5] * one - nu[3] * three
    z[2] = nu[2] + nu[3] * two - nu[4] * one
    square = EPSILON**2
    for i in range(AXES):
        z[i] = (z[i] if i < 3 else nu[i]) * weights[start + SCALE + i]
        square += z[i] ** 2
    beyond = max(np.sqrt(square) / weights[start + TOP], 1.0)
    square = 0.0
    for i in range(AXES):
        z[i] /= beyond
        square += z[i] ** 2
    m = np.sqrt(square + EPSILON**2)
    for i in range(AXES):
        d[i] = z[i] / m
        for j in range(AXES):
            tau[i] += weights[start + LINEAR + AXES * i + j] * z[j]
    _grow_products(weights, start + LIBRARY, d, b, grown)
    square /= m * m
    for k in range(points):
        at = start + POINTS + OF_POINT * k
        _images(weights, at, d, square, x, image)
        _sum_images(image, sums)
        at += AXES
        for s in range(SUMS):
            for p in range(POWERS):
                for i in range(AXES):
                    grown[p, i] += weights[at + i] * sums[s, i]
                at += AXES
    for i in range(AXES):
        tau[i] = beyond**2 * (tau[i] + m * (grown[0, i] + m * (grown[1, i] + m * grown[2, i])))
    out[0], out[1], out[2] = np.float32(tau[0]), np.float32(tau[1]), np.float32(tau[2])
    out[3] = np.float32(tau[3] + two * tau[2] - three * tau[1])
    out[4] = np.float32(tau[4] + three * tau[0] - one * tau[2])
    out[5] = np.float32(tau[5] + one * tau[1] - two * tau[0])


@kernel
def _grow_products(weights: Array32, at: int, d: Array, b: Array, grown: Array) -> None:
    """Add B_p b(d) to each row of `grown`; b (57,) is scratch."""
    count = 0
    for i in range(AXES):
        for j in range(AXES):
            b[count] = abs(d[i]) * d[j]
            count += 1
    for i in range(AXES):
        for j in range(i, AXES):
            b[count] = d[i] * d[j]
            count += 1
    for p in range(POWERS):
        for j in range(PRODUCTS):
            for i in range(AXES):
                grown[p, i] += weights[at + i] * b[j]
            at += AXES


@kernel
def _images(weights: Array32, at: int, d: Array, square: float, x: Array, image: Array) -> None:
    """Write R(g d, d_k) of the wide l for the eight images g; square is |d|^2, x (6,) scratch."""
    far = square
    for i in range(AXES):
        x[i] = d[i] * weights[at + i] / WIDE**2
        far += weights[at + i] ** 2
    far /= 2.0 * WIDE**2
    for g in range(8):
        exponent = -far
        for i in range(AXES):
            exponent += MIRRORS[g, i] * x[i]
        image[g] = np.exp(exponent)


@kernel
def _sum_images(image: Array, sums: Array) -> None:
    """Write the four sums S of each axis."""
    for i in range(AXES):
        narrow, wide = 0.0, 0.0
        for g in range(8):
            square = image[g] * image[g]
            narrow += MIRRORS[g, i] * square * square
            wide += MIRRORS[g, i] * image[g]
        sums[0, i], sums[1, i] = narrow / 8.0, wide / 8.0
        sums[2, i] = 0.5 * (image[0] + MIRRORS[PORT, i] * image[PORT])
        sums[3, i] = image[0]
