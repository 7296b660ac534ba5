"""Prediction errors of a vehicle file with and without the hull-force model of an earlier recording.

Errors of short predictions are listed by axis, for the file alone and for the file with the hull force, in
the earlier recording and in the later one.  An excess in the later one shows a change.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl

from hydro.core.columns import POSE, POSE_UNITS, VELOCITY, VELOCITY_UNITS, Array
from hydro.core.diagnosis.contenders import Compared
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import unfitted
from hydro.core.diagnosis.settings import RESAMPLES
from hydro.core.evaluation.block_resampling import interval, weights
from hydro.core.prediction.normal_equations import Normal
from hydro.core.residual.hull import Hull
from hydro.core.vehicle.description import Vehicle

LEVEL = "hull"
"""Level of the rows that `with_hull` adds to a comparison."""
ALONE, BESIDE = "file alone", "with the hull"
"""Predictors in the column `by`."""
BEFORE, AFTER = "before", "after"
"""Recordings in the column `place`."""
FLOOR = "floor"
"""Name of the axis for all channels together, with errors in units of the floor of the hull model."""


def with_hull(comparison: pl.DataFrame, vehicle: Vehicle, log: Preprocessed, hull: Hull) -> pl.DataFrame:
    """Return a comparison extended by the errors that remain once the hull force is corrected for.

    Returns:
        The table with rows of the level `hull`.  `by` names the predictor: the file alone, or with the hull
        force.  `place` is `before` for the earlier recording and `after` for the later one.  `horizon` [s] is
        the length of a shot.  Errors are root mean squares, for each channel in its unit.  On the axis
        `floor` they are of all channels together, in units of the floor of the hull model.

    Raises:
        DataError: The recording is too short, or the vehicle's predictions diverge.
    """
    lines = pl.DataFrame(list(_lines(vehicle, log, hull)), infer_schema_length=None)
    return pl.concat([comparison, lines.cast({"rank": pl.Int64, "weight": pl.Float64})], how="diagonal")


def _lines(vehicle: Vehicle, log: Preprocessed, hull: Hull) -> Iterator[dict[str, Any]]:
    """Yield the rows of `with_hull`; those of the later recording have 95 % intervals."""
    compared, beside = Compared.of(hull.completed(vehicle), log, hull)
    alone = unfitted(vehicle, compared.problem).normal
    shots = compared.problem.shots
    shared = {
        "level": LEVEL,
        "horizon": shots.seconds,
        "rows": len(shots.starts) * (shots.length - shots.lead),
        "at_horizon": None,
        "share": 0.0,
        "rank": None,
        "weight": None,
    }
    scale = np.append(shots.sigma, 1.0)
    noise = np.append(log.noise, np.sqrt(np.mean((log.noise / shots.sigma) ** 2)))
    axes = list(zip((*POSE, *VELOCITY, FLOOR), (*POSE_UNITS, *VELOCITY_UNITS, "1"), strict=True))
    after = {ALONE: alone, BESIDE: beside.normal}
    for by, level in ((ALONE, hull.alone), (BESIDE, hull.floor)):
        rmse, low, high = scale * _levels(after[by], compared.weight)
        for i, (axis, unit) in enumerate(axes):
            if not np.isfinite(rmse[i]):
                continue
            key = shared | {"axis": axis, "by": by, "unit": unit}
            spread = {"low": low[i], "high": high[i]}
            yield key | spread | {"place": AFTER, "rmse": rmse[i], "noise_floor": noise[i]}
            if axis != FLOOR:
                told = {"rmse": level[i] * hull.sigma[i], "noise_floor": hull.sigma[i]}
                yield key | {"low": None, "high": None, "place": BEFORE} | told


def _levels(normal: Normal, weight: Array) -> Array:
    """Return root mean square residuals of C channels and of all together, with 95 % intervals.

    Returns:
        Value, lower and upper end, (3, C + 1); NaN for a channel without a sample.
    """
    squares = np.column_stack([normal.channels, normal.gram[:, -1, -1]])
    within = np.isfinite(squares).all(axis=1)
    squares, weight, free = squares[within], weight[within], normal.freedoms[within]
    samples = (np.ones_like(normal.channels) if normal.compared is None else normal.compared).sum(axis=0)
    part = np.append(np.where(samples > 0.0, samples, np.nan) / samples.sum(), 1.0)

    def root(shares: Array) -> Array:
        """Return these values for recordings with these shares of the shots, (..., S)."""
        return np.asarray(np.sqrt((shares @ squares) / (shares @ free)[..., None] / part))

    drawn = weights(len(squares), RESAMPLES, 0) * weight
    return np.vstack([root(weight), interval(root(drawn))])
