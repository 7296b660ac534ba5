"""A whole motion where sensors gave samples of a part of it: a place to begin from, no measurement.

Lines between the samples of a channel; a velocity that was never measured from the slope of the pose, and a
position that was never measured from the sum of the velocities.  What neither shows stands still.
"""

from __future__ import annotations

import numpy as np
import scipy

from hydro.core.columns import Array, Mask, Rows
from hydro.core.vehicle.frames import quaternion_from_euler, rotation, wrapped

SLOPE_SECONDS = 0.5
"""Length of the cubic whose slope is a velocity."""
ANGLES = slice(3, 6)


def filled(motion: Array, bounds: Rows, dt: float) -> Array:
    """Pose and velocity without NaN, (N, 12); what was measured stays as it is.

    Args:
        motion: Pose and velocity, NaN where there is no sample, (N, 12) [m, rad, m/s, rad/s].
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
    """Which channels of a segment neither samples (N, 12) nor slopes of those of the pose show, (12,)."""
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
    """Fill the channels of one segment that have no sample at all from the others, in place."""
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
    """Standard deviation of the slope of a pose with white noise of 1 [1/s]."""
    return float(np.linalg.norm(scipy.signal.savgol_coeffs(max(_width(dt), 5), 3, deriv=1, delta=dt)))


def _width(dt: float) -> int:
    """Rows of the cubic whose slope is a velocity."""
    return 2 * round(0.5 * SLOPE_SECONDS / dt) + 1


def _slope(values: Array, dt: float) -> Array:
    """Derivative of (n, k) along its rows, through local cubics."""
    width = min(_width(dt), (len(values) - 1) // 2 * 2 + 1)
    if width < 5 or not values.size:  # scipy refuses an array without columns
        return np.zeros_like(values)
    slope: Array = scipy.signal.savgol_filter(values, width, 3, deriv=1, delta=dt, axis=0)
    return slope


def _rates(quaternion: Array, turning: Array) -> Array:
    """Rates of turn about the body's axes, twice the vector part of q^* dq/dt, (n, 3) [rad/s]."""
    w, v, dw, dv = quaternion[:, :1], quaternion[:, 1:], turning[:, :1], turning[:, 1:]
    rates: Array = 2.0 * (w * dv - dw * v - np.cross(v, dv))
    return rates


def steady(quaternion: Array) -> Array:
    """The same rotations (N, 4) without the sign of the quaternion jumping from row to row."""
    turned = np.einsum("ki,ki->k", quaternion[1:], quaternion[:-1]) < 0.0
    out = quaternion.copy()
    out[1:][np.cumsum(turned) % 2 == 1] *= -1.0
    return out
