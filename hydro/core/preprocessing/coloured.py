"""Coloured noise of velocities, estimated from kinematics alone.

A DVL that averages, or a filter behind it, has errors that persist for a while.  Such an error hardly changes
between rows, so `recording.noise` does not detect it, and over a second it looks like motion.  But it moves
nothing.  So compare the slope of the pose with the integral of the velocities: scatter beyond the white noise
of both is an error of the velocities, whatever forces act, if the noise of the pose is white.  It is
expressed as the white noise that would cause the same scatter of slopes.  So velocities have the right weight
over the length of a shot.
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
"""Lengths of the slopes [s]; the length with the largest noise counts."""
SURE = 4.0
"""Standard errors by which the scatter of the slopes must exceed that of white noise."""
PLAIN_EXCESS = 1.2
"""Minimum ratio of noise to white noise, both for the slopes and for the residual of the channel."""
LEAST_SLOPES = 30
POSE_CHANNELS = 6


def coloured(sigma: Array, normal: Normal, record: Recording, tests: Mapping[str, KinematicTest]) -> Array:
    """Return the standard deviations of the twelve channels with coloured noise of the velocities.

    Args:
        sigma: Standard deviations of the white noise, (12,).
        normal: The problem weighted by them, linearised at the best fit of the vehicle's effects.
        record: The recording.
        tests: Kinematic tests of the DVL's other errors.

    Returns:
        (12,), rescaled so that a true model still has a reduced chi-square of 1, since velocities with a
        small weight have small residuals.  `sigma` unchanged if only white noise is found or there are no
        tests.
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
    """Return the white noise of velocity and rates with the same error over a second or two, (6,).

    Args:
        record: The recording.
        tests: Kinematic tests of the DVL's other errors, which are not noise.
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
    """Return the noise from slopes of `pose_error` over `length` rows; 0 where white noise explains them."""
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
