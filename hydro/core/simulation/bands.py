"""Prediction bands: how far the uncertainty of estimated numbers lets a prediction stray.

Vehicles are drawn from the covariance of their estimates, each is moved by the same commands, and 95 % of
them lie within the band at every moment.  It holds what the numbers leave open, not what the model lacks, nor
the sensors' noise.
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
"""Vehicles drawn, by default."""
LEVELS = (0.025, 0.975)
MOTION = (*POSE, *VELOCITY)
ANGLES = slice(3, 6)
LEAST = 0.5
"""Part of the draws that must not diverge."""


def bands(
    vehicle: Vehicle,
    estimates: Estimates,
    commands: pl.DataFrame,
    *,
    draws: int = DRAWS,
    seed: int = 0,
    progress: Progress | None = None,
) -> pl.DataFrame:
    """Predicted motion under commands with 95 % bands.

    Args:
        vehicle: The vehicle with its estimated numbers.
        estimates: These, with their covariance.
        commands: As for `simulate`.
        draws: Vehicles drawn.
        seed: Of the draws.
        progress: Called with a few words and the share of the work done.

    Returns:
        The bands table: `session`, `t`, the motion that the vehicle itself makes (pose in NED [m, rad],
        velocity in the body frame [m/s, rad/s]), and the ends of the band of each, `x_low` ... `r_high`.

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
    """Lower and upper end of the band about what a vehicle does, (N, 12) each.

    Args:
        vehicle: The vehicle.
        estimates: Its estimated numbers.
        predicted: Pose and velocity that a vehicle makes, (N, 12); NaN, or an error, where it diverges.
        draws: Vehicles drawn.
        seed: Of the draws.
        progress: Called with a few words and the share of the work done.

    Raises:
        DataError: Most draws diverge.
    """
    middle, strayed = predicted(vehicle), list[Array]()
    for number, one in enumerate(estimates.drawn(vehicle, draws, seed)):
        if progress is not None:
            progress("draws", number / draws)
        try:
            strayed.append(_off(predicted(one), middle))
        except DataError:  # a draw that no vehicle can be
            continue
    if len(strayed) < LEAST * draws:
        raise DataError(
            f"the motion of {draws - len(strayed)} of {draws} vehicles drawn from the covariance diverges: "
            "the recording that it comes from leaves too much open"
        )
    ends = np.nanquantile(np.stack(strayed), LEVELS, axis=0)
    return middle + ends[0], middle + ends[1]


def table(rows: pl.DataFrame, middle: Array, low: Array, high: Array) -> pl.DataFrame:
    """The bands table of motions (N, 12), behind the columns `session` and `t` of `rows`."""
    ends = [
        pl.Series(f"{name}_{side}", values[:, i])
        for i, name in enumerate(MOTION)
        for side, values in (("low", low), ("high", high))
    ]
    return rows.with_columns(*pl.DataFrame(middle, schema=list(MOTION)), *ends)


def _off(motion: Array, middle: Array) -> Array:
    """How far a motion is off another, (N, 12), angles the short way round."""
    off: Array = motion - middle
    off[:, ANGLES] = (off[:, ANGLES] + np.pi) % (2.0 * np.pi) - np.pi
    return off
