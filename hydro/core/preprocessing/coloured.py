"""Coloured noise of velocities, estimated from kinematics alone.

A DVL that averages, or a filter behind it, has errors that persist for a second or more.  Such an error
hardly changes between rows, so `recording.arrays.noise` does not detect it, and over a second it looks like
motion.  But the pose does not follow it.  So the slope of the pose over a second or two is compared with the
mean velocity.  A difference beyond the white noise of both is an error of the velocity, whatever forces act,
if the noise of the pose is white.  The error is expressed as the white noise that would scatter the slopes
equally.  So velocities get the right weight in shots, which are two seconds long.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import sensor
from hydro.core.prediction.normal_equations import Normal
from hydro.core.preprocessing.sensor_tests import ENTRIES, KinematicTest, shown
from hydro.core.recording.arrays import LEAST_NOISE, Recording, drawn, noise
from hydro.core.recording.dead_reckoning import pose_error
from hydro.core.vehicle.frames import rotation

SLOPE_LENGTHS = (0.5, 1.0, 2.0)
"""Durations over which slopes are fitted [s]; the duration with the largest noise counts."""
SURE = 4.0
"""Minimum excess of the mean squared slope over that of white noise, in standard errors."""
PLAIN_EXCESS = 1.2
"""Minimum ratio of coloured to white noise, and of a channel's residual to its white noise."""
LEAST_SLOPES = 30  # minimum number of slopes, so that their scatter is known to a quarter
POSE_CHANNELS = 6  # position and attitude are the first of the twelve channels


def coloured(sigma: Array, normal: Normal, record: Recording, tests: Mapping[str, KinematicTest]) -> Array:
    """Return standard deviations of the twelve channels in which coloured noise of velocities is included.

    Args:
        sigma: Standard deviations of the white noise, pose then velocity, (12,) [m, rad, m/s, rad/s].
        normal: Problem weighted by `sigma`, linearised at the best fit of the vehicle's effects.
        record: The recording.
        tests: Kinematic tests of DVL errors, by effect; shown errors are corrected first.

    Returns:
        A new array, (12,) [m, rad, m/s, rad/s].  All are scaled down so that a true model still has a reduced
        chi-square of 1, since velocities with a small weight have small residuals.  `sigma` unchanged if the
        noise is white or there are no tests.
    """
    if not tests:
        return sigma
    left = normal.rms[POSE_CHANNELS:]
    white = noise(record)
    grown = velocity_noise(record, tests) / white[POSE_CHANNELS:]
    known = [(white[of] > LEAST_NOISE).all() for of in (slice(3), slice(3, POSE_CHANNELS))]
    there = (left > PLAIN_EXCESS) & (grown > PLAIN_EXCESS) & np.repeat(known, 3)
    if drawn(record, slice(POSE_CHANNELS)) or not there.any():
        return sigma
    weighed: Array = sigma * np.concatenate([np.ones(POSE_CHANNELS), np.where(there, grown, 1.0)])
    return weighed * float(np.sqrt(1.0 - there.sum() / len(sigma)))


def velocity_noise(record: Recording, tests: Mapping[str, KinematicTest]) -> Array:
    """Return the size of white velocity noise that acts over a second or two as the coloured noise does.

    Args:
        record: The recording.
        tests: Kinematic tests of DVL errors, by effect; shown errors are corrected first, as they are not
            noise.

    Returns:
        Standard deviations of u v w p q r, (6,) [m/s, rad/s]; at least the white noise between rows.
    """
    sigma, log = noise(record), np.zeros(sensor.LOG)
    for name, (_, place) in ENTRIES.items():
        if shown(tests[name]):
            log[place] = tests[name].estimate
    nu = np.vstack([sensor.corrected(log, record.t[a:b], record.nu[a:b]) for a, b in record.segments])
    found, error = sigma[POSE_CHANNELS:], pose_error(record, nu)
    for seconds in SLOPE_LENGTHS:
        found = np.maximum(found, _over(record, error, sigma, max(round(seconds / record.dt) + 1, 4)))
    return found


def _over(record: Recording, error: tuple[Array, Array], sigma: Array, length: int) -> Array:
    """Return the velocity noise from slopes of the pose error over `length` rows, (6,) [m/s, rad/s].

    It is 0 where white noise explains the scatter of the slopes.

    Args:
        record: The recording.
        error: Position and attitude minus dead reckoning, (N, 3) each, from `pose_error`.
        sigma: White noise of the channels, (12,).
        length: Rows of each slope.
    """
    starts = np.concatenate([np.arange(a, b - length + 1, length) for a, b in record.segments])
    if len(starts) < LEAST_SLOPES:
        return np.zeros(len(sigma) - POSE_CHANNELS)
    rows, (position, attitude) = starts[:, None] + np.arange(length), error
    time = (np.arange(length) - 0.5 * (length - 1)) * record.dt
    weight = time / (time @ time)
    body = rotation(*record.eta[starts + length // 2, 3:].T)
    moved = np.einsum("l,wli,wij->wj", weight, position[rows], body)
    slopes = np.hstack([moved, np.einsum("l,wli->wi", weight, attitude[rows])])
    summed = np.cumsum(weight[::-1])[::-1][1:] * record.dt  # response of a slope to each velocity
    white = sigma[:POSE_CHANNELS] ** 2 * (weight @ weight) + sigma[POSE_CHANNELS:] ** 2 * (summed @ summed)
    square = (slopes**2).mean(axis=0)
    clear = square - white > SURE * square * np.sqrt(2.0 / len(slopes))
    size: Array = np.sqrt(np.where(clear, (square - white) / (summed @ summed), 0.0))
    return size
