"""Kinematic model of a body and of its sensors, linearised in closed form.

The nominal state is (x, R, nu, nu', nu'', b).  These are position of CO in NED, rotation from body to world
as a unit quaternion, and velocity over ground and rates in body axes with two derivatives.  The last part is
constant biases of the logged velocity and rates.  Between rows

    x' = R v,   R' = R [omega]x,   (nu')' = nu'' + white,   (nu'')' = white,   b' = 0.

White noise of (nu')' alone is the model of `smoothing`, but thruster forces with a lag are smoother than
that.  With both noises at their maximum-likelihood densities, the standard deviation of an acceleration
matches its error.  With the first alone, error and standard deviation are twice as large in slow manoeuvres.

Errors are additive, except for the attitude: R_true = R exp([delta]x) with delta in body axes.  So the error
has 30 components and no singularity (Sola 2017, Quaternion kinematics for the error-state Kalman filter).  A
rotation of the world about its vertical changes none of the body-fixed components.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask
from hydro.core.compiled import copy_kernel, jit
from hydro.core.effects import sensor
from hydro.core.vehicle.frames import quaternion_kernel, quaternion_product_kernel, rotation

ERRORS, STATES, CHANNELS = 30, 31, 12
POSITION, ATTITUDE, SPEED, RATES, ACCELERATION, JERK, SPEED_BIAS, RATE_BIAS = 0, 3, 6, 9, 12, 18, 24, 27
"""First index of each part of the error; in the state, parts from SPEED on are one place later."""
QUATERNION = 3
LEAST_COSINE = 0.1
"""Minimum cosine of the pitch for measurements of roll or yaw alone: near it both turn about one axis."""


class Model(NamedTuple):
    """Parameters of the kinematic smoother.  Its state has 31 numbers, the error of the state 30.

    Attributes:
        dt: Sample time [s].
        density: Spectral density of the white noise in the derivatives of nu' and nu'' of each axis, (6, 2)
            [m^2/s^5, rad^2/s^5; m^2/s^7, rad^2/s^7].
        variance: Variance of the white noise of each channel (pose, then velocity), (12,) [m^2, rad^2,
            m^2/s^2, rad^2/s^2].
        prior: Variance of each error before the first sample, (30,).
        log: Derivative of the velocity in the log by the error of the state, (6, 30).
        offset: Velocity in the log for a body at rest, (6,) [m/s, rad/s].
    """

    dt: float
    density: Array
    variance: Array
    prior: Array
    log: Array
    offset: Array


def velocity_rows(log: Array, late: float) -> tuple[Array, Array]:
    """Return the measurement model of a DVL, linear in the state's error: matrix (6, 30), offset (6,).

    A DVL measures u_m = G [v(t - d) + omega(t - d) x r] + b, with the velocity v and rates omega of the
    vehicle, matrix G of scale and rotation, delay d, place r and bias b.

    Args:
        log: Errors of the vehicle's DVL, (13,); see `effects.sensor`.
        late: Part of the delay d that remains after samples are moved by whole rows [s].
    """
    turned = (1.0 + log[sensor.SCALE])[:, None] * rotation(*log[sensor.ANGLES]).T
    x, y, z = log[sensor.LEVER]
    lever = turned @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # omega x r = -r x omega
    rows, offset = np.zeros((6, ERRORS)), np.zeros(6)
    for first, matrix in ((SPEED, turned), (RATES, lever)):
        for order, share in enumerate((1.0, -late, 0.5 * late**2)):
            rows[:3, first + 6 * order : first + 6 * order + 3] = share * matrix
    rows[:3, SPEED_BIAS : SPEED_BIAS + 3] = np.eye(3)
    rows[3:, RATES : RATES + 3] = rows[3:, RATE_BIAS : RATE_BIAS + 3] = np.eye(3)
    offset[:3] = log[sensor.BIAS]
    return rows, offset


@jit
def _cross_matrix(v: Array, out: Array) -> None:
    """Write [v]x into `out` (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = 0.0, -v[2], v[1]
    out[1, 0], out[1, 1], out[1, 2] = v[2], 0.0, -v[0]
    out[2, 0], out[2, 1], out[2, 2] = -v[1], v[0], 0.0


@jit
def _product(a: Array, b: Array, out: Array) -> None:
    """Write the product of two matrices to `out`, (3, 3) each."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@jit
def turn(quaternion: Array, twist: Array, out: Array) -> None:
    """Write q exp(twist / 2), the attitude turned about body axes, into `out`.

    Args:
        quaternion: Attitude q as a unit quaternion, (4,).
        twist: Rotation vector in body axes, (3,) [rad].
        out: Output: unit quaternion, (4,).
    """
    angle = math.sqrt(twist[0] ** 2 + twist[1] ** 2 + twist[2] ** 2)
    share = math.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    x, y, z = share * twist[0], share * twist[1], share * twist[2]
    quaternion_product_kernel(quaternion, math.cos(0.5 * angle), x, y, z, out)
    size = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
    for i in range(4):
        out[i] /= size


@jit
def corrected(state: Array, error: Array, out: Array) -> None:
    """Write to `out` a state plus an error.

    Args:
        state: Nominal state, (31,), with the attitude as a quaternion.
        error: Error of the state, (30,), with the attitude as a small rotation about body axes.
        out: Output: corrected state, (31,).
    """
    for i in range(3):
        out[i] = state[i] + error[i]
    turn(state[QUATERNION : QUATERNION + 4], error[ATTITUDE:SPEED], out[QUATERNION : QUATERNION + 4])
    for i in range(SPEED, ERRORS):
        out[i + 1] = state[i + 1] + error[i]


@jit
def advance(state: Array, dt: float, out: Array, phi: Array, R: Array) -> None:
    """Advance the state by one row, and compute how an error of the state changes in that row.

    The position is integrated by Simpson's rule, the attitude by the mean rate.

    Args:
        state: Nominal state, (31,).
        dt: Sample time [s].
        out: Output: state one row later, (31,).
        phi: Output: transition matrix of the error, (30, 30).  It must hold the identity before; not all
            entries are written.
        R: Output: rotation from body to world halfway between the rows, (3, 3).
    """
    R0, R1, mid, halfway, half, twist = (
        np.empty(9),
        np.empty(9),
        np.empty(4),
        np.empty(6),
        np.empty(3),
        np.empty(3),
    )
    S, N, B, square = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    nu, dot, jerk = state[7:13], state[13:19], state[19:25]
    q = state[QUATERNION : QUATERNION + 4]
    copy_kernel(state, out)
    for i in range(6):
        out[7 + i] = nu[i] + dt * dot[i] + dt**2 / 2.0 * jerk[i]
        out[13 + i] = dot[i] + dt * jerk[i]
        halfway[i] = nu[i] + dt / 2.0 * dot[i] + dt**2 / 8.0 * jerk[i]
    for i in range(3):
        half[i] = dt / 2.0 * nu[3 + i] + dt**2 / 8.0 * dot[3 + i] + dt**3 / 48.0 * jerk[3 + i]
        twist[i] = dt * nu[3 + i] + dt**2 / 2.0 * dot[3 + i] + dt**3 / 6.0 * jerk[3 + i]
    turn(q, half, mid)
    turn(q, twist, out[QUATERNION : QUATERNION + 4])
    quaternion_kernel(q, R0)
    quaternion_kernel(mid, R.reshape(9))
    quaternion_kernel(out[QUATERNION : QUATERNION + 4], R1)
    for i in range(3):
        for j in range(3):
            ends = R0[3 * i + j] * nu[j] + R1[3 * i + j] * out[7 + j]
            out[i] += dt / 6.0 * (ends + 4.0 * R[i, j] * halfway[j])
    _cross_matrix(halfway, S)
    _product(R, S, N)
    for i in range(3):
        for j in range(3):
            N[i, j] = -N[i, j]
    _cross_matrix(half, S)
    _product(N, S, B)
    _cross_matrix(twist, S)
    _product(S, S, square)
    for i in range(3):
        for j in range(3):
            one = 1.0 if i == j else 0.0
            # effect of the attitude's error at the middle of the row
            phi[i, ATTITUDE + j] = dt * (N[i, j] - B[i, j])
            phi[ATTITUDE + i, ATTITUDE + j] = one - S[i, j] + 0.5 * square[i, j]
            share, size = one - 0.5 * S[i, j] + square[i, j] / 6.0, dt
            for order in range(3):  # of nu, nu' and nu''
                phi[i, SPEED + 6 * order + j] = size * R[i, j]
                phi[i, RATES + 6 * order + j] = size * dt / (order + 2) * N[i, j]
                phi[ATTITUDE + i, RATES + 6 * order + j] = size * share
                size *= dt / (order + 2)
    for i in range(6):
        phi[SPEED + i, ACCELERATION + i] = phi[ACCELERATION + i, JERK + i] = dt
        phi[SPEED + i, JERK + i] = dt**2 / 2.0


@jit
def driven(axis: int, R: Array, entry: NDArray[np.int64], share: Array, times: NDArray[np.int64]) -> int:
    """Find the entries of the error vector (30,) that the white noise of one axis reaches.

    The noise acts on the derivative of nu''.

    Args:
        axis: Number of the axis, 0 to 5.
        R: Rotation from body to world halfway between two rows, (3, 3).
        entry: Output (6,): indices of the entries, nu'' of the axis first, then nu', nu and the pose.
        share: Output (6,): gain from the noise to each entry.
        times: Output (6,): number of integrations from nu'' to each entry.

    Returns:
        Number of entries written, 4 for a rotation and 6 for a translation.
    """
    for n in range(3):
        entry[n], share[n], times[n] = JERK - 6 * n + axis, 1.0, n
    if axis >= 3:
        entry[3], share[3], times[3] = axis, 1.0, 3
        return 4
    for i in range(3):
        entry[3 + i], share[3 + i], times[3 + i] = i, R[i, axis], 3
    return 6


@jit
def integrated(dt: float, first: int, second: int) -> float:
    """Return the covariance of two multiple integrals over time of the same unit white noise.

    It is the integral from 0 to dt of t^a/a! t^b/b!, with a and b the further integrations.

    Args:
        dt: Time of integration [s].
        first: Number a of integrations after the first one, for the first integral.
        second: The number b for the second integral.
    """
    size = dt ** (first + second + 1) / (first + second + 1)
    for n in range(2, first + 1):
        size /= n
    for n in range(2, second + 1):
        size /= n
    return size


@jit
def disturb(P: Array, density: Array, R: Array, dt: float) -> None:
    """Add to `P` the covariance of the state's error that white noise causes from one row to the next.

    Args:
        P: Covariance of the error, (30, 30), changed in place.
        density: Spectral densities of the noise, (6, 2), see `Model`.
        R: Rotation from body to world halfway between the rows.
        dt: Sample time [s].
    """
    entry, share, times = np.empty(6, np.int64), np.empty(6), np.empty(6, np.int64)
    for axis in range(6):
        for a in range(driven(axis, R, entry, share, times)):
            for b in range(4 if axis >= 3 else 6):
                size = density[axis, 1] * integrated(dt, times[a], times[b])
                if times[a] and times[b]:
                    size += density[axis, 0] * integrated(dt, times[a] - 1, times[b] - 1)
                P[entry[a], entry[b]] += size * share[a] * share[b]


@jit
def rotation_vector(q: Array, measured: Array, out: Array) -> None:
    """Write to `out` the rotation vector that turns a first attitude into a second.

    Args:
        q: First attitude, a unit quaternion (4,).
        measured: Second attitude, a unit quaternion (4,).
        out: Output: rotation vector about body axes, (3,) [rad].
    """
    turned, inverse = np.empty(4), np.empty(4)
    inverse[0], inverse[1], inverse[2], inverse[3] = q[0], -q[1], -q[2], -q[3]
    quaternion_product_kernel(inverse, measured[0], measured[1], measured[2], measured[3], turned)
    if turned[0] < 0.0:
        for i in range(4):
            turned[i] = -turned[i]
    size = math.sqrt(turned[1] ** 2 + turned[2] ** 2 + turned[3] ** 2)
    share = 2.0 * math.atan2(size, turned[0]) / size if size > 1e-12 else 2.0
    for i in range(3):
        out[i] = share * turned[1 + i]


@jit
def angles(q: Array, out: Array) -> None:
    """Write phi, theta, psi of a unit quaternion into `out` (3,) [rad]."""
    R = np.empty(9)
    quaternion_kernel(q, R)
    out[0] = math.atan2(R[7], R[8])
    out[1] = math.atan2(-R[6], math.hypot(R[0], R[3]))
    out[2] = math.atan2(R[3], R[0])


@jit
def attitude_rows(state: Array, z: Array, seen: Mask, e: Array, H: Array) -> None:
    """Write the residuals of the measured angles of one row, and their derivatives by the error of the state.

    Three angles are compared as one rotation, about body axes, without singularity.  Fewer angles are
    compared one by one.

    Args:
        state: State of the smoother, (31,).
        z: Samples of pose and velocity, (12,).
        seen: Mask of the existing samples, (12,).
        e: Output: residuals, (12,); only those of angles are written.
        H: Output: derivatives, (12, 30).
    """
    q, found, twist = state[QUATERNION : QUATERNION + 4], np.empty(3), np.empty(3)
    if seen[3] and seen[4] and seen[5]:
        c, s, measured = np.empty(3), np.empty(3), np.empty(4)
        for i in range(3):
            c[i], s[i] = math.cos(0.5 * z[3 + i]), math.sin(0.5 * z[3 + i])
        measured[0] = c[0] * c[1] * c[2] + s[0] * s[1] * s[2]
        measured[1] = s[0] * c[1] * c[2] - c[0] * s[1] * s[2]
        measured[2] = c[0] * s[1] * c[2] + s[0] * c[1] * s[2]
        measured[3] = c[0] * c[1] * s[2] - s[0] * s[1] * c[2]
        rotation_vector(q, measured, twist)
        for i in range(3):
            e[3 + i], H[3 + i, ATTITUDE + i] = twist[i], 1.0
        return
    angles(q, found)
    sine, cosine, pitch = math.sin(found[0]), math.cos(found[0]), math.cos(found[1])
    for i in range(3):
        if not seen[3 + i] or (i != 1 and pitch < LEAST_COSINE):
            continue
        difference = z[3 + i] - found[i]
        e[3 + i] = difference - 2.0 * math.pi * round(difference / (2.0 * math.pi))
        if i == 0:
            H[3, ATTITUDE] = 1.0
            H[3, ATTITUDE + 1], H[3, ATTITUDE + 2] = sine * math.tan(found[1]), cosine * math.tan(found[1])
        elif i == 1:
            H[4, ATTITUDE + 1], H[4, ATTITUDE + 2] = cosine, -sine
        else:
            H[5, ATTITUDE + 1], H[5, ATTITUDE + 2] = sine / pitch, cosine / pitch


@jit
def sensor_rows(state: Array, z: Array, seen: Mask, model: Model, e: Array, H: Array) -> None:
    """Write the residuals of all samples of one row, and their derivatives by the error of the state.

    Args:
        state: State of the smoother, (31,).
        z: Samples of pose and velocity, (12,).
        seen: Mask of the existing samples, (12,).
        model: Parameters of the smoother.
        e: Output: residuals, (12,), 0 without a sample.
        H: Output: derivatives, (12, 30), 0 without a sample.
    """
    e[:] = 0.0
    H[:] = 0.0
    for i in range(3):
        if seen[i]:
            e[i], H[i, i] = z[i] - state[i], 1.0
    attitude_rows(state, z, seen, e, H)
    for i in range(6):
        if seen[6 + i]:
            copy_kernel(model.log[i], H[6 + i])
            e[6 + i] = z[6 + i] - model.offset[i]
            for j in range(SPEED, ERRORS):
                e[6 + i] -= model.log[i, j] * state[j + 1]
