"""Whether errors of a vehicle file are those of its hull: with and without what a recording before taught.

Errors of short predictions, axis by axis, of the file alone and beside what the hull does, in the recording
before and in the one after: what the latter has more is what has changed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl

from hydro.core.columns import POSE, POSE_UNITS, VELOCITY, VELOCITY_UNITS, Array
from hydro.core.diagnosis.baseline import stable_shots
from hydro.core.diagnosis.contenders import Compared
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import as_it_is
from hydro.core.evaluation.block_resampling import interval, weights
from hydro.core.prediction.normal_equations import Normal
from hydro.core.residual.hull import Hull
from hydro.core.vehicle.description import Vehicle

LEVEL = "hull"
"""Level of a comparison's rows that tell of the hull."""
ALONE, BESIDE = "file alone", "with the hull"
"""Of what predicts, in the column `by`;"""
BEFORE, AFTER = "before", "after"
"""and of the recording, in the column `place`."""
FLOOR = "floor"
"""The axis of all channels together, in units of the floor."""
ERROR_RESAMPLES = 1000


def with_hull(comparison: pl.DataFrame, vehicle: Vehicle, log: Preprocessed, hull: Hull) -> pl.DataFrame:
    """A comparison with the errors that are left once the hull's share is taken out.

    Args:
        comparison: Comparison table of the same vehicle and recording.
        vehicle: The model.
        log: The recording after.
        hull: What the recording before has taught.

    Returns:
        The table with rows of the level `hull`: `by` says what predicts, `place` the recording, `horizon` [s]
        how long a shot is; root mean square errors of every channel, and on the axis `floor` of all together
        in units of what the model of the hull leaves of the recording before.

    Raises:
        DataError: The recording is too short, or the vehicle's predictions diverge.
    """
    lines = pl.DataFrame(list(_lines(vehicle, log, hull)), infer_schema_length=None)
    return pl.concat([comparison, lines.cast({"rank": pl.Int64, "weight": pl.Float64})], how="diagonal")


def _lines(vehicle: Vehicle, log: Preprocessed, hull: Hull) -> Iterator[dict[str, Any]]:
    """The rows: of the recording before as the hull tells them, of the one after with intervals."""
    compared, beside = Compared.of(log, stable_shots(vehicle, log), hull, vehicle)
    alone = as_it_is(vehicle, compared.problem).normal
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
    """Root mean square residual of each channel and of all, with its 95 % interval, (3, C + 1).

    NaN of a channel without a sample.
    """
    squares = np.column_stack([normal.channels, normal.gram[:, -1, -1]])
    within = np.isfinite(squares).all(axis=1)
    squares, weight, free = squares[within], weight[within], normal.freedoms[within]
    samples = (np.ones_like(normal.channels) if normal.compared is None else normal.compared).sum(axis=0)
    part = np.append(np.where(samples > 0.0, samples, np.nan) / samples.sum(), 1.0)

    def root(shares: Array) -> Array:
        """Of recordings in which shots have these shares, (..., S)."""
        return np.asarray(np.sqrt((shares @ squares) / (shares @ free)[..., None] / part))

    drawn = weights(len(squares), ERROR_RESAMPLES, 0) * weight
    return np.vstack([root(weight), interval(root(drawn))])
