"""Noise of velocities that is not white, from kinematics alone.

A Doppler log that averages, or a filter behind it, errs alike for a while: from row to row such an error
hardly changes, so that `recording.noise` does not see it, and over a second it looks like motion.  But it
moves nothing.  What the slope of the pose less the integral of the velocities has beyond the white noise of
both is therefore an error of the velocities, whatever forces act, as long as the pose's own noise is white.
It is counted as the white noise that would make these slopes scatter as much, so that velocities weigh what
they are worth over the length of a shot.
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
"""Lengths over which slopes are taken: the one that shows most counts."""
SURE = 4.0
"""Standard errors by which slopes must scatter more than white noise lets them,"""
PLAIN_EXCESS = 1.2
"""times the white noise that it must then be, and that a model must leave in the channel."""
LEAST_SLOPES = 30
POSE_CHANNELS = 6


def coloured(sigma: Array, normal: Normal, record: Recording, tests: Mapping[str, KinematicTest]) -> Array:
    """Deviations of the twelve channels, of velocities with the noise that is not white.

    Args:
        sigma: Those of the white noise, (12,).
        normal: The problem weighed by them, about the best that the vehicle's own effects can do.
        record: The recording.
        tests: What kinematics shows of the velocity log's other errors.

    Returns:
        (12,), all of them smaller by as much as makes the mean squared residual of a true model 1 again:
        velocities that weigh little leave little.  `sigma` itself where only white noise shows,
        or kinematics nothing.
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
    """White noise of velocity and rates that errs as much over a second or two as theirs does, (6,).

    Args:
        record: The recording.
        tests: What kinematics shows of the velocity log's other errors, which are no noise.
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
    """The same by slopes of the `pose_error` over so many rows; 0 where white noise does as much."""
    starts = np.concatenate([np.arange(a, b - length + 1, length) for a, b in record.segments])
    if len(starts) < LEAST_SLOPES:
        return np.zeros(len(sigma) - POSE_CHANNELS)
    rows, (position, attitude) = starts[:, None] + np.arange(length), error
    time = (np.arange(length) - 0.5 * (length - 1)) * record.dt
    weight = time / (time @ time)
    body = rotation(*record.eta[starts + length // 2, 3:].T)
    moved = np.einsum("l,wli,wij->wj", weight, position[rows], body)
    slopes = np.hstack([moved, np.einsum("l,wli->wi", weight, attitude[rows])])
    summed = np.cumsum(weight[::-1])[::-1][1:] * record.dt  # how a slope answers to each velocity
    white = sigma[:POSE_CHANNELS] ** 2 * (weight @ weight) + sigma[POSE_CHANNELS:] ** 2 * (summed @ summed)
    square = (slopes**2).mean(axis=0)
    clear = square - white > SURE * square * np.sqrt(2.0 / len(slopes))
    size: Array = np.sqrt(np.where(clear, (square - white) / (summed @ summed), 0.0))
    return size
