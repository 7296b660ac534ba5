"""Labels: the residual wrench that a vehicle's known physics does not explain; paper (3), (10), (11).

    tau_res = tau_prop - M nu_dot - g(eta)  ~  C(nu) nu + D(nu) nu,      M = M_RB + M_A

tau_prop is the wrench of the thrusters, M the mass matrix with added mass, and -g(eta) that of weight and
buoyancy.  tau_res is on the left-hand side of the balance and opposes motion: the wrench on the vehicle is
-tau_res.

With `subtract="effects"` all wrenches of the vehicle's effects are subtracted too: damping and others, the
Coriolis terms C_A of the added mass, and the current through nu_r and nu_r_dot.  If the effects are complete,
C_RB(nu) nu of the rigid body remains, because the rigid body is not an effect.  A simulation with a residual
model omits its own C_RB in either case (paper 5).

Effects of thrusters always enter tau_prop, and errors of the DVL are always corrected first.

All terms of a row refer to its time t_k: pose and velocity as logged, the smoothed acceleration, and the
thrust due to the commands before t_k (a command without lag acts from the next row).  A simulator that
computes fluid forces at t_k and holds them until t_k+1 lags half a step behind such labels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Literal

import numpy as np
import polars as pl

from hydro.core.columns import POSE, VELOCITY, WRENCH, Array, Array32, Rows, checked_commands
from hydro.core.distillation.labels_of_samples import (
    DEVIATIONS,
    Bounds,
    has_nulls,
    labels_of_samples,
    reach_of_samples,
)
from hydro.core.distillation.wrench_balance import (
    Terms,
    columns,
    constants,
    label_kernel,
    names,
)
from hydro.core.effects import current, effect_forces, sensor, thruster_table, velocity_log
from hydro.core.effects.catalogue import entries
from hydro.core.effects.columns import through_water
from hydro.core.errors import DataError
from hydro.core.recording.segments import Clock, common_sample_time, resumes, sample_time, segments
from hydro.core.recording.smoothing import (
    Design,
    acceleration_noise,
    estimate,
    estimate_in,
    gains,
    reach,
    smooth,
    windows,
)
from hydro.core.recording.supply import recorded_commands
from hydro.core.threads import spread
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import INFLOW, thrusts

Subtract = Literal["inertia", "effects"]

UNCERTAIN = DEVIATIONS[0]
"""Column that exists only in the labels of a recording with nulls."""
RATIO_FACTOR = 3.0  # factor on q dt^3 / R (jerk density q, noise R) of the likeliest filter
BATCH = 32_768  # rows per batch: they fit the processor's cache, and no whole column is copied to float64


def labels(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    acceleration: str = "rts",
    noise: Sequence[float] | None = None,
    design: Design | None = None,
    subtract: Subtract = "inertia",
    limits: Bounds | None = None,
) -> pl.DataFrame:
    """Return a raw table with smoothed motion, thrusts and the residual wrench tau_res of every row.

    tau_res is the wrench that the known physics does not explain.  If pose or velocity has nulls, only rows
    that the samples determine have labels; other rows have nulls.  Columns of standard deviations are then
    added.

    Args:
        vehicle: Rigid body, buoyancy, thrusters and effects.
        raw: Raw table: `session`, `t` [s], pose (NED), velocity of CO in body axes (FRD), `cmd_1` ...
            `cmd_n`; optionally the supply `voltage` [V].
        acceleration: Method of `smoothing.smooth`: rts, kalman or kalman-difference.
        noise: Standard deviation of each measured velocity, six numbers [m/s, rad/s]; by default estimated.
        design: Filter that smooths the velocities; by default designed for the recording (`filter_design`).
        subtract: `inertia` subtracts only M nu_dot, with the mass matrix M (added mass included) and the
            acceleration nu_dot; `effects` also the wrenches of all effects.
        limits: For a recording with nulls, the greatest standard deviations of a row with a label; by default
            those of `Bounds`.

    Returns:
        The raw columns unchanged, and as float32: smoothed velocity `u_s` ... `r_s`, acceleration `u_dot` ...
        `r_dot`, thrusts `f_1` ... `f_n` [N], tau_prop (the thrusters' wrench) `X_prop` ... `N_prop` and
        tau_res `X_res` ... `N_res` about CO in body axes [N, N m].

    Raises:
        DataError: The sample time is not constant, a row is isolated between gaps, the commands do not fit
            the thrusters, a value is not finite, or an effect is not in the catalogue.  Also if a recording
            with nulls is to be smoothed by another method than `rts`.
    """
    if has_nulls(raw):
        if acceleration != "rts" or design is not None:
            raise DataError(
                "a recording with nulls requires --acceleration rts; for another method import the log with "
                "`hydro import --fill`, which interpolates between samples"
            )
        return labels_of_samples(vehicle, raw, noise=noise, subtract=subtract, limits=limits)
    commands = checked_commands(raw.columns, len(vehicle.thruster), vehicle.name)
    bounds = segments(raw)
    _require_no_isolated_rows(raw, bounds)
    chosen = design or filter_design(raw, noise)
    designed, log, table = gains(chosen), velocity_log(vehicle), thruster_table(vehicle)
    known = constants(vehicle, table)
    water = current(vehicle) if (table[:, INFLOW] != 0.0).any() else None
    after_gap, driven = resumes(raw, bounds), recorded_commands(vehicle, raw)
    count = len(commands)
    out: Array32 = np.empty((2 * 6 + count + 2 * 6, raw.height), np.float32)

    def work(first: int, last: int) -> None:
        start, stop = int(bounds[first, 0]), int(bounds[last - 1, 1])
        part, within = raw[start:stop], bounds[first:last] - start
        motion = smooth(_velocities(part, within, log), within, chosen, acceleration, designed)
        pose = sensor.true_pose(log, columns(part, POSE))
        nu_r = None if water is None else through_water(water, pose, motion[:, :, 0], part["t"])
        thrust = thrusts(
            table, driven[start:stop], part["t"], within, after_gap=after_gap[first:last], nu_r=nu_r
        )
        forces = np.empty((0, 6))
        if subtract == "effects":
            given = driven[start:stop]
            forces = effect_forces(vehicle, pose, motion[:, :, 0], within, part["t"], given)
        label_kernel(Terms(motion, np.ascontiguousarray(pose[:, 3:]), thrust, forces), known, start, out)

    spread(lambda batch: work(*batch), _batches(bounds))
    _require_finite(raw, out)
    return raw.with_columns(pl.Series(name, column) for name, column in zip(names(count), out, strict=True))


def subtracted(vehicle: Vehicle, subtract: Subtract) -> list[str]:
    """Return the names of the effects that labels exclude from the residual wrench, in the file's order.

    Args:
        vehicle: The vehicle.
        subtract: `inertia` (effects that add inertia only) or `effects` (all), as for `labels`.
    """
    kinds = ("wrench", "inertia", "flow")
    return [
        effect.name
        for effect, _, _ in entries(vehicle)
        if effect.inertia is not None or (subtract == "effects" and effect.kind in kinds)
    ]


def filter_design(raw: pl.DataFrame, noise: Sequence[float] | None = None) -> Design:
    """Return the filter design that `labels` uses for a raw or labels table, estimated from its velocities.

    The design follows the log more closely than the likeliest filter, which has the smallest error in each
    row. A regression on labels averages thousands of rows: noise cancels, but the bias of smoothed
    acceleration peaks does not.

    Args:
        raw: Table with `session`, `t` and `u` ... `r`.
        noise: Standard deviation of each velocity, six numbers [m/s, rad/s]; by default estimated.

    Raises:
        DataError: The sample time is not constant, or `noise` is not six numbers of at least 0.
    """
    likeliest = estimate(columns(raw, VELOCITY), segments(raw), sample_time(raw), noise)
    return likeliest.following(RATIO_FACTOR)


def filter_design_of_sessions(
    clocks: Mapping[str, Clock],
    velocity: Callable[[str], pl.DataFrame],
    noise: Sequence[float] | None = None,
) -> Design:
    """Return the filter design of `labels` for a large recording whose sessions are read one at a time.

    Args:
        clocks: Times of the rows of each session, in the order of the sessions.
        velocity: Function from the name of a session to its table with `u` ... `r`; called only for sessions
            from which the noise is estimated.
        noise: Standard deviation of each velocity, six numbers [m/s, rad/s]; by default estimated.

    Raises:
        DataError: A session has another sample time than most, or `noise` is not six numbers of at least 0.
    """
    dt, ends = common_sample_time(clocks), np.cumsum([clock.rows for clock in clocks.values()])
    starts = ends - [clock.rows for clock in clocks.values()]
    every = [clock.bounds + start for clock, start in zip(clocks.values(), starts, strict=True)]
    chosen, pieces = windows(np.concatenate(every)), list[Array]()
    for session, start, end in zip(clocks, starts, ends, strict=True):
        own = chosen[(chosen[:, 0] >= start) & (chosen[:, 0] < end)] - start
        if len(own):
            nu = columns(velocity(session), VELOCITY)
            pieces += [nu[first:last] for first, last in own]
    edges = np.concatenate([[0], np.cumsum(chosen[:, 1] - chosen[:, 0])])
    within = np.stack([edges[:-1], edges[1:]], axis=1)
    return estimate_in(np.concatenate(pieces), within, dt, noise).following(RATIO_FACTOR)


def labelled(labels: pl.DataFrame) -> pl.DataFrame:
    """Return the rows of a labels or split table in which the residual wrench tau_res is known."""
    return labels.filter(pl.col(f"{WRENCH[0]}_res").is_not_null()) if UNCERTAIN in labels.columns else labels


def smoother_reach(labels: pl.DataFrame) -> int:
    """Return how many rows before a row, and as many after it, influence its smoothed motion.

    Args:
        labels: Labels table.

    Raises:
        DataError: The sample time is not constant, or no row has a label.
    """
    return reach_of_samples(labels) if UNCERTAIN in labels.columns else reach(filter_design(labels))


def acceleration_sd(labels: pl.DataFrame, noise: Sequence[float] | None = None) -> Array:
    """Return the standard deviations of the accelerations of a labels table due to sensor noise, (6,).

    They are those of u_dot ... r_dot [m/s^2, rad/s^2].

    Args:
        labels: Labels or split table.
        noise: Standard deviation of each logged velocity, six numbers [m/s, rad/s]; by default estimated.
    """
    if UNCERTAIN not in labels.columns:
        return acceleration_noise(filter_design(labels, noise))
    spread = columns(labelled(labels), [f"{name}_dot_sd" for name in VELOCITY])
    return np.asarray(np.sqrt(np.mean(spread**2, axis=0)))


def _require_no_isolated_rows(raw: pl.DataFrame, bounds: Rows) -> None:
    """Refuse a recording with a row between two gaps, because such a row has no acceleration."""
    isolated = bounds[bounds[:, 1] - bounds[:, 0] < 2, 0]
    if isolated.size:
        raise DataError(
            f"{isolated.size} rows stand alone between gaps in t and have no acceleration "
            f"(first: row {isolated[0]}, session {raw['session'][int(isolated[0])]}); remove them"
        )


def _require_finite(raw: pl.DataFrame, out: Array32) -> None:
    """Refuse labels that are not finite.

    A bad raw value spreads over its segment, so the message names the first bad row.
    """
    broken = ~np.isfinite(out[-6:]).all(axis=0)
    if broken.any():
        row = int(np.argmax(broken))
        raise DataError(
            f"the labels are not finite in {broken.sum()} of {raw.height} rows (first: row {row}, session "
            f"{raw['session'][row]}): a raw value of that session is missing or not finite; see `hydro check`"
        )


def _batches(bounds: Rows) -> Iterator[tuple[int, int]]:
    """Yield ranges of segments [first, last) with at least BATCH rows together; the last may have fewer."""
    first = 0
    for last in range(1, len(bounds) + 1):
        if last == len(bounds) or bounds[last - 1, 1] - bounds[first, 0] >= BATCH:
            yield first, last
            first = last


def _velocities(frame: pl.DataFrame, bounds: Rows, log: Array) -> Array:
    """Return the velocity of CO (N, 6) [m/s, rad/s], with the DVL errors `log` corrected."""
    nu = columns(frame, VELOCITY)
    if log.any() and np.isfinite(nu).all():  # values that are not finite are reported after all labels exist
        t = frame["t"].to_numpy()
        for begin, end in bounds:
            nu[begin:end] = sensor.corrected(log, t[begin:end], nu[begin:end])
    return nu
