"""Smoothed motion of a recording, and its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from hydro.core.columns import Array, Mask
from hydro.core.recording import smoothing
from hydro.core.recording.arrays import LEAST_NOISE, Recording, noise
from hydro.core.recording.filling import slope_noise, unshown
from hydro.core.recording.shots import CHANNELS
from hydro.core.vehicle.frames import euler_from_quaternion

STEEP = 0.3
"""Cosine of the pitch below which roll and heading are not smoothed: they jump at the vertical."""
IMPULSE_REACH = 1000
"""Rows on each side of an impulse in the computation of the smoother's weights."""


@dataclass(frozen=True)
class Motion:
    """Smoothed motion of a recording of N rows, with its uncertainty.

    Attributes:
        eta: Pose with unwrapped angles, NED, (N, 6) [m, rad].
        nu: Velocity as logged, body axes, (N, 6) [m/s, rad/s].
        nu_dot: Derivative of `nu`, (N, 6).
        sigma: Standard deviation of the noise of the twelve channels, (12,); 0 for a channel without samples.
        uncertainty: Standard deviation of the smoothed channels, in the first row of a segment (row 0) and
            far from its ends (row 1), (2, 12).
        pose: Settings of the smoother of the pose.
        velocity: Settings of the smoother of the velocity.
    """

    eta: Array
    nu: Array
    nu_dot: Array
    sigma: Array
    uncertainty: Array
    pose: smoothing.Design
    velocity: smoothing.Design

    @classmethod
    def of(cls, record: Recording) -> Motion:
        """Return the smoothed motion of a recording, with the noise estimated from the recording itself.

        Raises:
            DataError: A segment has a single row, or none has eight.
        """
        sigma = noise(record)
        never: Mask = np.zeros(CHANNELS, bool)
        if record.seen is not None:
            never = np.logical_not(record.seen.any(axis=0))
        doubt = _doubt(record, sigma)
        sigma[never] = LEAST_NOISE
        angles, steep = record.eta.copy(), bool((np.cos(record.eta[:, 4]) <= STEEP).any())
        for start, stop in record.segments:
            part = record.eta[start:stop, 3:]
            angles[start:stop, 3:] = turned(part) if steep else np.unwrap(part, axis=0)
        if steep and not never[3:6].any():
            sigma[3:6] = noise(replace(record, eta=angles))[3:6]
        pose = smoothing.estimate(angles, record.segments, record.dt, sigma[:6].tolist())
        velocity = smoothing.estimate(record.nu, record.segments, record.dt, sigma[6:].tolist())
        eta = smoothing.smooth(angles, record.segments, pose)[:, :, 0]
        nu, nu_dot = np.moveaxis(smoothing.smooth(record.nu, record.segments, velocity), 2, 0)
        left = np.hstack([angles - eta, record.nu - nu]).var(axis=0)
        uncertainty = _uncertainty(np.stack([_weights(pose), _weights(velocity)]), sigma, left)
        sigma[never] = 0.0
        uncertainty[:, never] = doubt[never]
        if steep:
            eta[:, 3:] = _turned_back(record.eta[:, 3:], eta[:, 3:] - angles[:, 3:])
        return cls(
            eta=np.ascontiguousarray(eta),
            nu=np.ascontiguousarray(nu),
            nu_dot=np.ascontiguousarray(nu_dot),
            sigma=sigma,
            uncertainty=uncertainty,
            pose=pose,
            velocity=velocity,
        )


def turned(attitude: Array) -> Array:
    """Return the turn about body axes up to each row, summed from row to row, (n, 3) [rad].

    Unlike Euler angles this turn is continuous through the vertical, so it can be smoothed.

    Args:
        attitude: phi, theta, psi of n consecutive rows, (n, 3) [rad].
    """
    R = scipy.spatial.transform.Rotation.from_euler("ZYX", attitude[:, ::-1])
    steps = (R[:-1].inv() * R[1:]).as_rotvec()
    return np.concatenate([np.zeros((1, 3)), steps.cumsum(axis=0)])


def _turned_back(attitude: Array, correction: Array) -> Array:
    """Return phi, theta, psi, (N, 3) [rad], of attitudes after small turns about body axes, (N, 3) [rad]."""
    turn = scipy.spatial.transform.Rotation
    R = turn.from_euler("ZYX", attitude[:, ::-1]) * turn.from_rotvec(correction)
    return euler_from_quaternion(np.roll(R.as_quat(), 1, axis=1))


def _doubt(record: Recording, sigma: Array) -> Array:
    """Return the standard deviation of channels without samples, (12,).

    That of velocities follows from the noise of the pose.
    """
    pose = np.repeat([sigma[:3].max(), sigma[3:6].max()], 3)
    doubt = np.concatenate([sigma[:6], pose * slope_noise(record.dt)])
    if record.seen is None or record.doubt is None:
        return doubt
    dark = np.any([unshown(record.seen[a:b]) for a, b in record.segments], axis=0)
    return np.where(dark, record.doubt, doubt)


def _weights(design: smoothing.Design) -> Array:
    """Return the smoother's weight of a row's own measurement, and the sum of all squared weights.

    They are given for the first row of a segment and for rows far from its ends, (2, 2, 6).
    """
    impulse = np.zeros((2, 2 * IMPULSE_REACH + 1, 6))
    impulse[0, 0] = impulse[1, IMPULSE_REACH] = 1.0
    bounds = [[0, 2 * IMPULSE_REACH + 1]]
    first, inner = (smoothing.smooth(one, bounds, design)[:, :, 0] for one in impulse)
    squares = [(one**2).sum(axis=0) for one in (first, inner)]
    return np.stack([np.stack([first[0], inner[IMPULSE_REACH]]), np.stack(squares)])


def _uncertainty(weights: Array, sigma: Array, left: Array) -> Array:
    """Return the standard deviation of the smoothed channels in the first row and in the middle, (2, 12).

    Noise passes with the sum of squared weights.  A variance of the residual beyond its share of the noise is
    motion that the smoothed value lacks.

    Args:
        weights: Weights of pose and velocity from `_weights`, (2, 2, 2, 6).
        sigma: Noise of the channels, (12,).
        left: Variance of measured minus smoothed values, (12,).
    """
    own, passed = np.concatenate([weights[0], weights[1]], axis=2)
    blurred = np.maximum(left - sigma**2 * (1.0 - 2.0 * own[1] + passed[1]), 0.0)
    spread: Array = np.sqrt(sigma**2 * passed + blurred)
    return spread
