"""Wrench of a hull as radial basis functions on the sphere of motion directions, with mirror symmetry.

Motion about a centre c is z = scale * nu_c, of size m = |z| and direction d = z / m; near rest, m is EPSILON.

    tau = L z  +  sum_p m^p (B_p b(d) + sum_k sum_s W_pks S_s(d, d_k)),        p = 1, 2, 3

nu_c is the velocity of the point c, L a (6, 6) matrix, B_p and W_pks are trained weights, and d_k is the
direction of point k of the training data.

b(d) are the 57 products |d_i| d_j and d_i d_j; drag and Coriolis forces are sums of these at p = 2.  The S
are made of radial functions R(d, d_k) = (1 + r) exp(-r) between directions, with r = sqrt(3) |d - d_k| /
WIDTH (Matern kernel of order 3/2: drag has kinks where it changes sides):

    0  sum over the eight mirror images g of chi(g) R(g d, d_k) / 8
    1  (R(d, d_k) + chi R(d', d_k)) / 2, d' the image under port-starboard reflection
    2  R(d, d_k)

chi(g) = +-1 is the sign of the axis under the reflection g.  So S 0 holds for a hull with three planes of
symmetry, S 1 for a port-starboard symmetric hull, and S 2 for any hull.

There are two such expressions for tau, called stages.  The drag F is the first without the d_i d_j at p = 2.
F modulates the second, since a drag coefficient may depend on the direction of force and moment.  With the
trained matrix T, the wrench about c is

    tau_c,i = tau_i  +  sum_j T_ij F_i |F_j| / |F|

where j and |F| run over the forces for a force, and over the moments for a moment.  Far from all points the R
vanish and the remaining terms grow with the powers of the speed.  Beyond the largest m of the training data
the wrench grows as the square of the speed.
"""

from __future__ import annotations

import math

import numpy as np

from hydro.core.columns import Array, Array32
from hydro.core.compiled import kernel

AXES, POWERS, SUMS, STAGES = 6, 3, 3, 2
WIDTH = 2.0
"""Length scale of the radial functions: the largest distance between two directions."""
EPSILON = 0.05  # size m of the motion at rest
PRODUCTS = 57  # number of products b(d): 36 of |d_i| d_j and 21 of d_i d_j
SIGNED = 36
"""Number of products of the form |d_i| d_j."""
PORT = 2
"""Index of the port-starboard reflection; 0 is the identity."""
MIRRORS = np.array(
    [[a, b, c, b * c, a * c, a * b] for a in (1.0, -1.0) for b in (1.0, -1.0) for c in (1.0, -1.0)]
)
"""Signs chi of (u, v, w, p, q, r), and of X to N, in each of eight mirror images, (8, 6)."""
CENTRE, SCALE, TOP, STEERING, LINEAR = 0, 3, 9, 10, 28
LIBRARY = LINEAR + STAGES * AXES * AXES
POINTS = LIBRARY + STAGES * POWERS * PRODUCTS * AXES
"""Offsets of the weights: c, scale, greatest m, T, L row by row, B by power, product and axis, points."""
OF_POINT = AXES + STAGES * SUMS * POWERS * AXES
"""Number of weights of a point: its direction, then W by stage, sum, power and axis."""
TINY = 1e-9
"""Smallest drag used as a divisor [N or N m]."""
SCRATCH = 155
"""Number of values of the kernel's scratch space."""


def products(z: Array) -> Array:
    """Return the products |z_i| z_j, then z_i z_j with i <= j, (N, PRODUCTS), for N vectors z (N, 6)."""
    signed = [np.abs(z[:, [i]]) * z for i in range(AXES)]
    return np.hstack([*signed, *(z[:, [i]] * z[:, i:] for i in range(AXES))])


def parities() -> Array:
    """Return the signs of six velocities and of their products in eight mirror images, (8, 6 + PRODUCTS)."""
    one = np.ones((1, AXES))
    plain = np.hstack([one, products(one)])
    return np.vstack([np.hstack([one * g, products(one * g)]) / plain for g in MIRRORS])


@kernel
def mirrored_wrench(
    weights: Array32, start: int, points: int, nu: Array, scratch: Array, out: Array32
) -> None:
    """Write the wrench of a velocity about CO to `out`, by the model of this module.

    Args:
        weights: All weights of a network.
        start: Offset of the weights of this model.
        points: Number of points d_k.
        nu: Velocity of CO in body axes, (6,) [m/s, rad/s].
        scratch: Memory for sums in float64, since weights of neighbouring points nearly cancel, (SCRATCH,).
        out: Output: wrench, (6,) [N, N m].
    """
    z, d, even, image = scratch[:6], scratch[6:12], scratch[12:18], scratch[18:26]
    x, b = scratch[26:32], scratch[32 : 32 + PRODUCTS]
    sums, tau = scratch[89:107].reshape(SUMS, AXES), scratch[107:119].reshape(STAGES, AXES)
    grown = scratch[119:155].reshape(STAGES, POWERS, AXES)
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
    beyond = max(math.sqrt(square) / weights[start + TOP], 1.0)
    square = 0.0
    for i in range(AXES):
        z[i] /= beyond
        square += z[i] ** 2
    m = math.sqrt(square + EPSILON**2)
    for i in range(AXES):
        d[i] = z[i] / m
    at = start + LINEAR
    for stage in range(STAGES):
        for i in range(AXES):
            for j in range(AXES):
                tau[stage, i] += weights[at + j] * z[j]
            at += AXES
    _grow_products(weights, start + LIBRARY, d, b, even, grown)
    square /= m * m
    for k in range(points):
        at = start + POINTS + OF_POINT * k
        _images(weights, at, d, square, x, image)
        _sum_images(image, sums)
        at += AXES
        for stage in range(STAGES):
            for s in range(SUMS):
                for p in range(POWERS):
                    for i in range(AXES):
                        grown[stage, p, i] += weights[at + i] * sums[s, i]
                    at += AXES
    for stage in range(STAGES):
        for i in range(AXES):
            rest = grown[stage, 1, i] + m * grown[stage, 2, i]
            tau[stage, i] += m * (grown[stage, 0, i] + m * rest)
    for i in range(AXES):
        tau[0, i] -= m * m * even[i]
    _steer(weights, start + STEERING, tau[0], tau[1])
    force, moment = tau[1, :3], tau[1, 3:]
    for i in range(AXES):
        tau[1, i] *= beyond**2
    out[0], out[1], out[2] = np.float32(force[0]), np.float32(force[1]), np.float32(force[2])
    out[3] = np.float32(moment[0] + two * force[2] - three * force[1])
    out[4] = np.float32(moment[1] + three * force[0] - one * force[2])
    out[5] = np.float32(moment[2] + one * force[1] - two * force[0])


@kernel
def _steer(weights: Array32, at: int, drag: Array, tau: Array) -> None:
    """Add T_ij F_i |F_j| / |F| to the wrench `tau` (6,), with F the drag (6,) and T stored from `at` on."""
    for half in range(2):
        square = 0.0
        for j in range(3):
            square += drag[3 * half + j] ** 2
        size = max(math.sqrt(square), TINY)
        for i in range(3):
            factor = 0.0
            for j in range(3):
                factor += weights[at + j] * abs(drag[3 * half + j])
            tau[3 * half + i] += factor * drag[3 * half + i] / size
            at += 3


@kernel
def _grow_products(weights: Array32, at: int, d: Array, b: Array, even: Array, grown: Array) -> None:
    """Add B_p b(d) to `grown` (stages, p, 6); write the part of d_i d_j at stage 0, p = 2, to `even` (6,).

    `b` (57,) is scratch; B is stored from `at` on.
    """
    count = 0
    for i in range(AXES):
        for j in range(AXES):
            b[count] = abs(d[i]) * d[j]
            count += 1
    for i in range(AXES):
        for j in range(i, AXES):
            b[count] = d[i] * d[j]
            count += 1
    even[:] = 0.0
    for stage in range(STAGES):
        for p in range(POWERS):
            for j in range(PRODUCTS):
                for i in range(AXES):
                    grown[stage, p, i] += weights[at + i] * b[j]
                    if stage == 0 and p == 1 and j >= SIGNED:
                        even[i] += weights[at + i] * b[j]
                at += AXES


@kernel
def _images(weights: Array32, at: int, d: Array, square: float, x: Array, image: Array) -> None:
    """Write R(g d, d_k) for the eight images g to `image`; `square` is |d|^2, `x` (6,) scratch."""
    far = square
    for i in range(AXES):
        x[i] = 2.0 * d[i] * weights[at + i]
        far += weights[at + i] ** 2
    for g in range(8):
        apart = far
        for i in range(AXES):
            apart -= MIRRORS[g, i] * x[i]
        r = math.sqrt(3.0 * max(apart, 0.0)) / WIDTH
        image[g] = (1.0 + r) * math.exp(-r)


@kernel
def _sum_images(image: Array, sums: Array) -> None:
    """Write the three symmetric sums S_s of each axis to `sums` (3, 6), from R of the eight images (8,)."""
    for i in range(AXES):
        total = 0.0
        for g in range(8):
            total += MIRRORS[g, i] * image[g]
        sums[0, i] = total / 8.0
        sums[1, i] = 0.5 * (image[0] + MIRRORS[PORT, i] * image[PORT])
        sums[2, i] = image[0]
