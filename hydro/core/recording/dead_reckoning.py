"""Difference of the logged pose and the integral of the logged velocities: an error of the log, not a force.

A constant difference of the turn is a gyro's bias.  Linear velocities have more kinds of errors, see
`diagnosis.sensor_tests`.
"""

from __future__ import annotations

import numpy as np
import scipy

from hydro.core.columns import Array
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.frames import rotation

TURN_LENGTH = 2.0
"""Length over which turns are compared [s]."""
LEAST_TURNS = 16  # minimum number of such lengths
CHANCE = 1e-9
"""Maximum p-value at which a gyro bias is reported."""
PLAIN_BIAS = 1e-3  # rad/s, minimum size of a reported bias


def pose_error(record: Recording, nu: Array) -> tuple[Array, Array]:
    """Return the error of the logged pose relative to dead reckoning from given velocities.

    Args:
        record: The recording, with N rows.
        nu: Velocities, body axes, (N, 6) [m/s, rad/s], integrated by trapezoids.

    Returns:
        Logged minus integrated position, NED, (N, 3) [m], and attitude about body axes, (N, 3) [rad].
        Differences between rows of two segments have no meaning.
    """
    R = rotation(*record.eta[:, 3:].T)
    along = np.einsum("kij,kj->ki", R, nu[:, :3])
    steps = np.diff(record.eta[:, :3], axis=0) - 0.5 * record.dt * (along[1:] + along[:-1])
    turned = np.einsum("kji,kjl->kil", R[:-1], R[1:])
    skew = 0.5 * (turned - turned.transpose(0, 2, 1))
    turns = skew[:, [2, 0, 1], [1, 2, 0]] - 0.5 * record.dt * (nu[1:, 3:] + nu[:-1, 3:])
    start = np.zeros((1, 3))
    return np.concatenate([start, steps.cumsum(axis=0)]), np.concatenate([start, turns.cumsum(axis=0)])


def rate_bias(record: Recording) -> Array:
    """Return the constant bias of p, q and r [rad/s], (3,); 0 where it is not significant.

    It is 0 if attitude or rates have no samples.  A scale error grows with the rate and is fitted together
    with the bias.
    """
    if record.seen is not None and not record.seen[:, [3, 4, 5, 9, 10, 11]].any(axis=0).all():
        return np.zeros(3)
    _, turned = pose_error(record, record.nu)
    length = max(round(TURN_LENGTH / record.dt), 2)
    starts = np.concatenate([np.arange(a, b - length, length) for a, b in record.segments])
    bias = np.zeros(3)
    if len(starts) < LEAST_TURNS:
        return bias
    error = (turned[starts] - turned[starts + length]) / (length * record.dt)
    rate = np.stack([record.nu[a : a + length, 3:].mean(axis=0) for a in starts])
    for axis in range(3):
        columns = np.column_stack([np.ones(len(starts)), rate[:, axis]])
        found, *_ = np.linalg.lstsq(columns, error[:, axis], rcond=None)
        spread = np.linalg.pinv(columns.T @ columns) * np.var(error[:, axis] - columns @ found)
        if abs(found[0]) > max(PLAIN_BIAS, -scipy.special.ndtri(0.5 * CHANCE) * np.sqrt(spread[0, 0])):
            bias[axis] = found[0]
    return bias
