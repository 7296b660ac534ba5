"""Conversion of readings of a mounted sensor to the body, and rates derived from the attitude."""

from __future__ import annotations

import numpy as np
import scipy

from hydro.core.columns import Array, Rows
from hydro.core.errors import DataError
from hydro.core.logs import conventions
from hydro.core.logs.conventions import AXES, BODIES, UNITS, SessionLog, turn
from hydro.core.logs.logmap import Attitude, Rates, Velocity, named

SLOPE_SAMPLES = 5
"""Default number of attitude samples in a local parabola."""
DERIVED = tuple(f"{name}, from the attitude" for name in "pqr")
"""Names of derived rates, which are not columns of the log."""


def mounted_rates(log: SessionLog, block: Rates) -> dict[str, Array]:
    """Return a mounted gyroscope's samples, converted to body axes, in new columns of the log.

    The samples stay in the frame and unit that the map declares.

    Args:
        log: The session.
        block: The block of the rates, with its mount.

    Returns:
        By column name, one number for each row of the session, NaN without a sample.
    """
    assert block.mount is not None
    t, rows = _samples(log, block)
    return _written(log, block, rows, conventions.rates(log, block, t) @ turn(block.mount).T)


def mounted_velocity(
    log: SessionLog, block: Velocity, rates: Rates | None, attitude: Attitude | None
) -> dict[str, Array]:
    """Return a mounted velocity sensor's samples, converted to the body origin, in new columns of the log.

    The samples stay in the frame and unit that the map declares.  The velocity of the body origin is v = R
    v_s - omega x r: R rotates the sensor's axes to the body's, v_s is the reading, omega the angular velocity
    and r the sensor's place from the body origin, all in body axes.

    Args:
        log: The session, with corrected rates.
        block: The velocity block, with its mount.
        rates: The block of the rates.
        attitude: The block of the attitude, which rotates a velocity along world axes.

    Returns:
        By column name, one number for each row of the session, NaN without a sample.

    Raises:
        DataError: A lever arm is given without rates.
    """
    assert block.mount is not None
    t, rows = _samples(log, block)
    R: Array = np.tile(np.eye(3), (len(t), 1, 1))
    if block.frame not in BODIES and attitude is not None:
        R = conventions.attitude(log, attitude, t)
    v = conventions.velocity(log, block, t, R) @ turn(block.mount).T
    arm = np.array(block.mount.position, float)
    if arm.any():
        if rates is None:
            raise DataError(
                "velocity.mount.position: a lever arm needs rates; give rates, or rates from the attitude"
            )
        v = v - np.cross(conventions.rates(log, rates, t), arm)
    if block.frame not in BODIES:
        v = np.einsum("nij,nj->ni", R, v)
    return _written(log, block, rows, v)


def derived_rates(log: SessionLog, block: Attitude, window: float | None) -> tuple[Array, Array]:
    """Return the angular velocity, computed from the slope of the attitude's samples.

    A local parabola is fitted to the small rotation vectors from a sample to its neighbours.  Its slope in
    the middle is exactly the angular velocity in body axes.

    Args:
        log: The session.
        block: The block of the attitude.
        window: Length of the window of a parabola [s]; by default that of five samples.

    Returns:
        Times [s], shape (n,), and rates about FRD [rad/s], (n, 3); NaN where the window has too few samples.
    """
    first = block.quaternion[0] if block.quaternion else (block.columns or ("",))[0]
    t = log.channel(first).t
    if len(t) < SLOPE_SAMPLES:
        return t, np.full((len(t), 3), np.nan)
    R = scipy.spatial.transform.Rotation.from_matrix(conventions.attitude(log, block, t))
    step = float(np.median(np.diff(t)))
    reach = 0.5 * (window if window is not None else (SLOPE_SAMPLES - 1) * step)
    limit = 1.001 * max(reach, step)
    out = np.full((len(t), 3), np.nan)
    starts, stops = np.searchsorted(t, t - limit), np.searchsorted(t, t + limit, side="right")
    for k, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        if stop - start < 3 or k in (start, stop - 1):
            continue
        s = (t[start:stop] - t[k]) / limit
        turned = (R[k].inv() * R[start:stop]).as_rotvec()
        powers = np.stack([s, s**2], axis=1)  # no constraint at the middle sample, which would keep its noise
        design = np.column_stack([np.ones(len(s)), powers])
        out[k] = np.linalg.lstsq(design, turned, rcond=None)[0][1] / limit
    return t, out


def _samples(log: SessionLog, block: Velocity | Rates) -> tuple[Array, Rows]:
    """Return times [s] and row numbers of the complete samples of a three-column vector."""
    names = [named(source).column for source in block.columns]
    values = np.stack([log.columns[name] for name in names])
    rows = np.flatnonzero(np.isfinite(values).all(axis=0))
    return log.time_of(names[0])[rows], rows


def _written(log: SessionLog, block: Velocity | Rates, rows: Rows, values: Array) -> dict[str, Array]:
    """Return vectors in FRD or NED at some rows as columns in the block's frame and unit.

    Args:
        log: Session of the log.
        block: Velocity or rates of the map.
        rows: Numbers of the rows; others are NaN.
        values: Vectors at these rows.
    """
    own = values @ AXES[block.frame] / UNITS[block.unit]
    found = {}
    for source, part in zip(map(named, block.columns), own.T, strict=True):
        column = np.full(len(log.time_of(source.column)), np.nan)
        column[rows] = (part - source.offset) / source.scale
        found[source.column] = column
    return found
