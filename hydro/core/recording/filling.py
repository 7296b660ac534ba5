"""Filling of motion channels without samples: initial guesses, not measurements.

Channels are interpolated linearly between samples.  A velocity without samples is the slope of the pose, and
a position without samples is the integral of the velocities.  If neither is measured, the channel is
constant.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array, Mask, Rows
from hydro.core.local_polynomials import savitzky_golay, savitzky_golay_weights
from hydro.core.vehicle.frames import quaternion_from_euler, rotation, wrapped

SLOPE_SECONDS = 0.5
"""Length of the local cubic whose slope is a velocity [s]."""
ANGLES = slice(3, 6)


def filled(motion: Array, bounds: Rows, dt: float) -> Array:
    """Return a copy of pose and velocity, (N, 12), in which each NaN is replaced by an initial guess.

    Measured values stay unchanged.

    Args:
        motion: Pose and velocity, NaN without a sample, (N, 12) [m, rad, m/s, rad/s].
        bounds: Segments [start, stop), (S, 2).
        dt: Sample time [s].
    """
    out = motion.copy()
    for start, stop in bounds:
        part = out[start:stop]
        seen = np.isfinite(part)
        for i in np.flatnonzero(seen.any(axis=0)):
            _draw_lines(part[:, i], seen[:, i], turns=bool(ANGLES.start <= i < ANGLES.stop))
        never = np.asarray(~seen.any(axis=0))
        part[:, ANGLES][:, never[ANGLES]] = 0.0
        _derive(part, never, dt)
    return out


def unshown(seen: Mask) -> Mask:
    """Return a mask, (12,), of the channels (pose, then velocity) that a segment's samples do not show.

    These are channels without samples, except velocities that follow from a sampled pose.

    Args:
        seen: Whether each of the segment's N rows has a sample of each channel, (N, 12).
    """
    never: Mask = np.logical_not(seen.any(axis=0))
    tilted = never[ANGLES].any()
    never[6:9] &= tilted or never[:3].any()
    never[9:] &= tilted
    return never


def _draw_lines(values: Array, seen: Mask, turns: bool) -> None:
    """Fill one channel between its samples, in place."""
    if seen.all():
        return
    rows, samples = np.arange(len(values)), values[seen]
    lines = np.interp(rows[~seen], rows[seen], np.unwrap(samples) if turns else samples)
    values[~seen] = wrapped(lines) if turns else lines


def _derive(part: Array, never: Mask, dt: float) -> None:
    """Derive the channels of one segment without any sample from the others, in place."""
    R = rotation(*part[:, ANGLES].T)
    if never[9:].any():
        attitude = steady(quaternion_from_euler(*part[:, ANGLES].T))
        rates = _rates(attitude, _slope(attitude, dt))
        part[:, 9:][:, never[9:]] = rates[:, never[9:]]
    if never[6:9].any():
        moving = np.zeros((len(part), 3))
        moving[:, ~never[:3]] = _slope(part[:, :3][:, ~never[:3]], dt)
        along = np.einsum("kji,kj->ki", R, moving)
        part[:, 6:9][:, never[6:9]] = along[:, never[6:9]]
    if never[:3].any():
        moving = np.einsum("kij,kj->ki", R, part[:, 6:9])
        path = np.zeros((len(part), 3))
        path[1:] = np.cumsum(0.5 * dt * (moving[1:] + moving[:-1]), axis=0)
        part[:, :3][:, never[:3]] = path[:, never[:3]]


def slope_noise(dt: float) -> float:
    """Return the noise of a velocity computed as the slope of the pose, per unit noise of the pose [1/s].

    Args:
        dt: Sample time [s].
    """
    return float(np.linalg.norm(savitzky_golay_weights(max(_width(dt), 5), 3, deriv=1, dt=dt)))


def _width(dt: float) -> int:
    """Return the rows of the local cubic whose slope is a velocity."""
    return 2 * round(0.5 * SLOPE_SECONDS / dt) + 1


def _slope(values: Array, dt: float) -> Array:
    """Return the derivative of (n, k) along its rows, by local cubics."""
    width = min(_width(dt), (len(values) - 1) // 2 * 2 + 1)
    if width < 5 or not values.size:  # no polynomial fits an array without columns
        return np.zeros_like(values)
    return savitzky_golay(values, width, 3, deriv=1, dt=dt)


def _rates(quaternion: Array, turning: Array) -> Array:
    """Return the angular velocity in body axes, twice the vector part of q^* dq/dt, (n, 3) [rad/s]."""
    w, v, dw, dv = quaternion[:, :1], quaternion[:, 1:], turning[:, :1], turning[:, 1:]
    rates: Array = 2.0 * (w * dv - dw * v - np.cross(v, dv))
    return rates


def steady(quaternion: Array) -> Array:
    """Return a copy of a series of quaternions, (N, 4), with signs that do not jump between rows.

    The rotations stay the same, as q and -q are the same rotation.

    Args:
        quaternion: Quaternions, (N, 4).
    """
    turned = np.einsum("ki,ki->k", quaternion[1:], quaternion[:-1]) < 0.0
    out = quaternion.copy()
    out[1:][np.cumsum(turned) % 2 == 1] *= -1.0
    return out
