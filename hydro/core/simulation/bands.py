"""Prediction bands from the uncertainty of estimated parameters.

Vehicles are drawn from the covariance of their estimates, and each is simulated with the same commands.  95 %
of the predictions lie within the band at every time.  The band contains the uncertainty of the parameters,
but neither model errors nor sensor noise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import polars as pl

from hydro.core.columns import POSE, VELOCITY, Array
from hydro.core.errors import DataError
from hydro.core.progress import Progress
from hydro.core.simulation.estimates import Estimates
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle

DRAWS = 100
"""Default number of drawn vehicles."""
LEVELS = (0.025, 0.975)  # quantiles that bound 95 %
MOTION = (*POSE, *VELOCITY)
ANGLES = slice(3, 6)
LEAST = 0.5
"""Minimum share of drawn vehicles whose motion must not diverge."""


def bands(
    vehicle: Vehicle,
    estimates: Estimates,
    commands: pl.DataFrame,
    *,
    draws: int = DRAWS,
    seed: int = 0,
    progress: Progress | None = None,
) -> pl.DataFrame:
    """Return the predicted motion of a vehicle under commands, with 95 % bands.

    Args:
        vehicle: The vehicle with its estimated numbers.
        estimates: The estimates, with their covariance.
        commands: Columns `session`, `t` and `cmd_1 ... cmd_n`.  Pose and velocity, if given, are initial
            states in the first row of a session and after a gap; otherwise sessions start at rest.
        draws: Number of vehicles to draw.
        seed: Seed of the draws.
        progress: Called with a few words and the share of the work done.

    Returns:
        The bands table: `session`, `t`, the motion of the vehicle itself (pose in NED [m, rad], velocity in
        the body frame [m/s, rad/s]), and the limits of each band, `x_low`, `x_high` ... `r_low`, `r_high`.

    Raises:
        DataError: The commands do not fit the vehicle, its motion diverges, or that of most draws does.
    """
    moved = simulate(vehicle, commands)

    def predicted(one: Vehicle) -> Array:
        return simulate(one, commands).select(MOTION).to_numpy()

    low, high = spread(vehicle, estimates, predicted, draws=draws, seed=seed, progress=progress)
    return table(moved.select("session", "t"), moved.select(MOTION).to_numpy(), low, high)


def spread(
    vehicle: Vehicle,
    estimates: Estimates,
    predicted: Callable[[Vehicle], Array],
    *,
    draws: int = DRAWS,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Array, Array]:
    """Return the lower and upper limit of the 95 % band about a vehicle's motion, (N, 12) each.

    Args:
        vehicle: The vehicle.
        estimates: Its estimated numbers, with their covariance.
        predicted: Function from a vehicle to its pose and velocity at N times, (N, 12) [m, rad, m/s, rad/s];
            gives NaN or raises a DataError if the motion diverges.
        draws: Number of vehicles to draw.
        seed: Seed of the draws.
        progress: Called with a few words and the fraction of the work done.

    Raises:
        DataError: Most draws diverge.
    """
    middle, strayed = predicted(vehicle), list[Array]()
    for number, one in enumerate(estimates.drawn(vehicle, draws, seed)):
        if progress is not None:
            progress("draws", number / draws)
        try:
            strayed.append(_off(predicted(one), middle))
        except DataError:  # a draw that is not a valid vehicle
            continue
    if len(strayed) < LEAST * draws:
        raise DataError(
            f"the motion of {draws - len(strayed)} of {draws} vehicles drawn from the covariance diverges: "
            "the recording that it comes from leaves too much open"
        )
    ends = np.nanquantile(np.stack(strayed), LEVELS, axis=0)
    return middle + ends[0], middle + ends[1]


def table(rows: pl.DataFrame, middle: Array, low: Array, high: Array) -> pl.DataFrame:
    """Return the bands table: `session`, `t`, the motion, and limits `x_low`, `x_high` ... `r_high`.

    Args:
        rows: Columns `session` and `t` of N rows.
        middle: Motion of the vehicle itself, pose in NED and body velocity, (N, 12) [m, rad, m/s, rad/s].
        low: Lower limits of the motion, (N, 12).
        high: Upper limits of the motion, (N, 12).
    """
    ends = [
        pl.Series(f"{name}_{side}", values[:, i])
        for i, name in enumerate(MOTION)
        for side, values in (("low", low), ("high", high))
    ]
    return rows.with_columns(*pl.DataFrame(middle, schema=list(MOTION)), *ends)


def _off(motion: Array, middle: Array) -> Array:
    """Return the difference of two motions, (N, 12), with angles wrapped to [-pi, pi)."""
    off: Array = motion - middle
    off[:, ANGLES] = (off[:, ANGLES] + np.pi) % (2.0 * np.pi) - np.pi
    return off
