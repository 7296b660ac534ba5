"""Labels of a recording with nulls, only for rows that its samples determine, with standard deviations.

Pose, velocity and acceleration come from `recording.kinematic_smoother`.  A row has a label, the residual
wrench tau_res, if the standard deviations of its attitude, velocity and acceleration are within bounds.  The
standard deviation of tau_res is that of M nu_dot; it ignores the uncertainty of thrust, attitude, the mass
matrix M and the vehicle's effects.

Beyond the bounds a label contains more noise than information.  0.05 m/s is a tenth of the speed of a small
vehicle, 0.25 m/s^2 is half of the acceleration by its thrusters, and 0.05 rad rotates a twentieth of its
weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from hydro.core.columns import (
    DOF,
    MOTION,
    POSE,
    UNITS,
    VELOCITY,
    WRENCH,
    Array,
    Array32,
    Mask,
    Rows,
    checked_commands,
)
from hydro.core.distillation.wrench_balance import (
    Terms,
    columns,
    constants,
    label_kernel,
    names,
)
from hydro.core.effects import current, effect_forces, sensor, thruster_table, velocity_log
from hydro.core.effects.columns import through_water
from hydro.core.errors import DataError
from hydro.core.recording.arrays import LEAST_NOISE, UNSEEN, Recording
from hydro.core.recording.arrays import noise as channel_noise
from hydro.core.recording.filling import filled
from hydro.core.recording.kinematic_smoother import Smoothed, smooth
from hydro.core.recording.segments import resumes, sample_time, segments
from hydro.core.recording.supply import recorded_commands
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import INFLOW, thrusts

DEVIATIONS = (
    *(f"{name}_s_sd" for name in VELOCITY),
    *(f"{name}_dot_sd" for name in VELOCITY),
    *(f"{name}_res_sd" for name in WRENCH),
)
"""Columns of standard deviations, which exist only in the labels of a recording with nulls."""
ATTITUDE_BOUND = 0.05
"""Greatest standard deviation of the attitude in a row with a label [rad]."""
POSITION_BOUND = 0.1
"""Greatest standard deviation of the position in a row with a label [m], if an effect depends on position."""
DISPLACEMENT = 1.0  # displacement that reveals an effect that depends on position [m]
ANGLES = dict(zip(POSE[3:], ("roll", "pitch", "heading"), strict=True))
"""Names of the attitude angles in messages."""


class Bounds(NamedTuple):
    """Greatest standard deviations that the motion of a row with a label may have.

    Attributes:
        velocity: Bound of the velocities [m/s, rad/s].
        acceleration: Bound of the accelerations [m/s^2, rad/s^2].
    """

    velocity: float = 0.05
    acceleration: float = 0.25


def has_nulls(raw: pl.DataFrame) -> bool:
    """Return whether a raw table has nulls in pose or velocity."""
    return any(raw[name].null_count() for name in MOTION if name in raw.columns)


def labels_of_samples(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    noise: Sequence[float] | None = None,
    subtract: Literal["inertia", "effects"] = "inertia",
    limits: Bounds | None = None,
) -> pl.DataFrame:
    """Return a raw table with nulls, extended by labels in the rows that its samples determine.

    Args:
        vehicle: Rigid body, buoyancy, thrusters and effects.
        raw: Raw table; pose and velocity may be null.
        noise: Standard deviation of each measured velocity, six numbers [m/s, rad/s]; by default estimated.
        subtract: `inertia` subtracts only M nu_dot, with the mass matrix M (added mass included) and the
            acceleration nu_dot; `effects` also the wrenches of all effects.
        limits: Bounds of the standard deviations of a row with a label; by default those of `Bounds`.

    Returns:
        The raw columns; the label columns `u_s` to `N_res` of `wrench_balance.names`, null in rows without a
        label; and the standard deviations DEVIATIONS of each row, null in segments in which an angle was
        never measured.

    Raises:
        DataError: The sample time is not constant, the commands do not fit the thrusters, a value is not
            finite, or `noise` is not six numbers of at least 0.
    """
    commands = checked_commands(raw.columns, len(vehicle.thruster), vehicle.name)
    bounds, dt, samples = segments(raw), sample_time(raw), _samples(raw, commands)
    sigma = _noise(samples, bounds, dt, noise)
    log = velocity_log(vehicle)
    found = smooth(samples, bounds, dt, sigma, log=log)
    pose, motion = sensor.true_pose(log, np.nan_to_num(found.pose)), np.nan_to_num(found.motion)
    motion[:, :3] -= np.cross(motion[:, 3:6], log[sensor.POINT], axisa=1, axisc=1)  # smoothed at the point
    table = thruster_table(vehicle)
    known, inflow = constants(vehicle, table), (table[:, INFLOW] != 0.0).any()
    nu_r = through_water(current(vehicle), pose, motion[:, :, 0], raw["t"]) if inflow else None
    after_gap = resumes(raw, bounds)
    commanded = recorded_commands(vehicle, raw)
    thrust = thrusts(table, commanded, raw["t"], bounds, after_gap=after_gap, nu_r=nu_r)
    forces, needs_position = np.empty((0, 6)), False
    if subtract == "effects":
        forces, needs_position = _forces(vehicle, pose, motion[:, :, 0], bounds, raw["t"], commanded)
    out: Array32 = np.empty((24 + len(commands), raw.height), np.float32)
    label_kernel(Terms(motion, np.ascontiguousarray(pose[:, 3:]), thrust, forces), known, 0, out)
    out[:, ~_determined(found, limits or Bounds(), needs_position)] = np.nan
    wrench = np.sqrt(np.einsum("ij,njk,ik->ni", known.mass, found.covariance, known.mass))
    spread = np.hstack([found.motion_sd[:, :, 0], found.motion_sd[:, :, 1], wrench]).astype(np.float32)
    added = [*zip(names(len(commands)), out, strict=True), *zip(DEVIATIONS, spread.T, strict=True)]
    return raw.with_columns(pl.Series(name, column, nan_to_null=True) for name, column in added)


def unlabelled(labels: pl.DataFrame, limits: Bounds | None = None) -> str:
    """Return, in words, how many rows of a labels table have no label, and why; empty if all have labels.

    Args:
        labels: Result of `labels_of_samples` with the same bounds.
        limits: Bounds of the standard deviations; by default those of `Bounds`.
    """
    part = labels.filter(pl.col(f"{WRENCH[0]}_res").is_null())
    if part.is_empty():
        return ""
    causes, left, reasons = _causes(part, limits or Bounds()), np.ones(part.height, bool), list[str]()
    while left.any():
        words, rows = max(causes.items(), key=lambda cause: int((cause[1] & left).sum()))
        reasons.append(f"{words} ({int((rows & left).sum()):,})")
        left &= ~rows
    others = len(reasons) - 3
    more = f" and {others} more cause{'s' if others > 1 else ''}" if others > 0 else ""
    return f"{part.height:,} of {labels.height:,} rows have no label: {', '.join(reasons[:3])}{more}"


def reach_of_samples(labels: pl.DataFrame) -> int:
    """Return how many rows on either side of a row influence its smoothed motion.

    The number is estimated from the standard deviations.  The smoother is a low-pass filter, whose time
    constant is about the ratio of the standard deviations of velocity and acceleration (within a factor of
    the square root of 2).  The weight of a sample falls to a thousandth of the largest within 10 time
    constants if the velocity is measured, and within 20 if only the position is.

    Args:
        labels: Result of `labels_of_samples`.

    Raises:
        DataError: No row has a label.
    """
    there = labels.filter(pl.col(f"{WRENCH[0]}_res").is_not_null())
    if there.is_empty():
        raise DataError("no row has a label: `hydro labels` says what its recording does not determine")
    seconds = [
        (10.0 if there[name].null_count() < there.height else 20.0)
        * float(np.median(there[f"{name}_s_sd"].to_numpy() / there[f"{name}_dot_sd"].to_numpy()))
        for name in VELOCITY
    ]
    return int(np.ceil(max(seconds) / sample_time(labels)))


def _causes(part: pl.DataFrame, limits: Bounds) -> dict[str, Mask]:
    """Return masks of rows by the reason, in words, for which they have no label."""
    never = part[DEVIATIONS[0]].is_null().to_numpy()
    causes = dict[str, Mask]()
    if never.any():
        absent = [word for name, word in ANGLES.items() if not part.filter(never)[name].count()]
        why = f"{' and '.join(absent)} is not measured" if absent else "samples contradict each other"
        causes[why] = never
    for i, name in enumerate((*VELOCITY, *VELOCITY)):
        kind = "acceleration" if i >= 6 else "velocity" if i < 3 else "rate"
        bound = limits.acceleration if i >= 6 else limits.velocity
        unit = UNITS[name] + ("^2" if i >= 6 else "")
        far = ~(part[DEVIATIONS[i]].fill_null(0.0).fill_nan(np.inf).to_numpy() <= bound)
        causes[f"{DOF[i % 6]} {kind} is not determined to {bound:g} {unit}"] = far
    rest = ~np.any(list(causes.values()), axis=0)
    causes[f"attitude is not determined to {ATTITUDE_BOUND:g} rad, or position to {POSITION_BOUND:g} m"] = (
        rest
    )
    return causes


def _samples(raw: pl.DataFrame, commands: Sequence[str]) -> Array:
    """Return pose and velocity (N, 12), NaN instead of null; raise if a value is not finite."""
    for name in (*MOTION, *commands):
        if not raw[name].is_finite().all():  # ignores null
            row = int(np.argmin(raw[name].is_finite().fill_null(True).to_numpy()))
            raise DataError(
                f"{name} is not finite in row {row}, session {raw['session'][row]}; see `hydro check`"
            )
    return columns(raw, MOTION)


def _noise(samples: Array, bounds: Rows, dt: float, given: Sequence[float] | None) -> Array:
    """Return the standard deviation of each channel (12,): estimated, or as given for the velocities."""
    shown = np.array([np.isfinite(samples[a:b, 3:6]).any(axis=0).all() for a, b in bounds], dtype=bool)
    sigma = UNSEEN.copy()
    if shown.any():
        kept = np.concatenate([np.arange(a, b) for a, b in bounds[shown]])
        ends = np.cumsum(np.diff(bounds[shown], axis=1)[:, 0])
        edges = np.stack([np.concatenate([[0], ends[:-1]]), ends], axis=1)
        motion = filled(samples[kept], edges, dt)
        part = Recording(
            t=kept * dt,
            eta=motion[:, :6],
            nu=motion[:, 6:],
            commands=np.empty((len(kept), 0)),
            segments=edges,
            after_gap=np.zeros(len(edges), bool),
            session=np.arange(len(edges)),
            dt=dt,
            seen=np.isfinite(samples[kept]),
        )
        sigma = channel_noise(part)
    if given is not None:
        known = np.asarray(given, float)
        if known.shape != (6,) or not np.isfinite(known).all() or (known < 0.0).any():
            raise DataError(
                f"noise: give six standard deviations of at least 0 (m/s, rad/s), not {list(given)}"
            )
        sigma[6:] = np.maximum(known, LEAST_NOISE)
    return sigma


def _forces(
    vehicle: Vehicle, pose: Array, nu: Array, bounds: Rows, t: ArrayLike, commands: Array
) -> tuple[Array, bool]:
    """Return the wrench of the effects, (N, 6), and whether this wrench depends on position."""
    forces = effect_forces(vehicle, pose, nu, bounds, t, commands)
    displaced = pose.copy()
    displaced[:, :3] += DISPLACEMENT
    return forces, not np.allclose(effect_forces(vehicle, displaced, nu, bounds, t, commands), forces)


def _determined(found: Smoothed, limits: Bounds, needs_position: bool) -> Mask:
    """Return a mask of rows (N,) with known attitude, velocity, acceleration and, if needed, position."""
    known = (found.pose_sd[:, 3:] <= ATTITUDE_BOUND).all(axis=1)
    known &= (found.motion_sd[:, :, 0] <= limits.velocity).all(axis=1)
    known &= (found.motion_sd[:, :, 1] <= limits.acceleration).all(axis=1)
    if needs_position:
        known &= (found.pose_sd[:, :3] <= POSITION_BOUND).all(axis=1)
    return np.asarray(known)
