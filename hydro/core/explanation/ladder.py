"""Steps and the ladder that their errors make: which of them is the one to use.

All steps are measured by the yardstick of step 0: its weights of the axes, and the simple predictors that
were fitted to the recording.  Held-out predictions HORIZON ahead decide, or without such data predictions of
stretches of the recording by the fit to all others.  With the hull that a recording before has taught, errors
are measured in units of what its model leaves of that recording, on held-out data too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from hydro.core.diagnosis.findings import Status
from hydro.core.evaluation.yardsticks import LEVEL, PREDICTORS, column
from hydro.core.explanation.with_hull import BESIDE, FLOOR
from hydro.core.explanation.with_hull import LEVEL as OF_HULL
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle

HORIZON = 5.0
"""How far ahead the predictions look by whose error steps are compared [s]."""
RISE = 1.02
"""Held-out error over the least of the steps before from which a step counts as a step too far."""
DATASETS = ("fit", "holdout")
LEFT_OUT = "left_out"
"""The axis of all velocities together, of stretches of the recording left out of the fit."""
RUNG = ("dataset", "axis", "horizon", "rmse", "low", "high", "noise_floor", "unit")
UNKNOWN = pl.lit(None, pl.Float64)


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes:
        number: 0 is the file as given.
        added: Effects that the step added, or gave new values to where it added none; none of step 0.
        tables: All effects that were fitted together, with their standard errors; none of step 0.
        vehicle: The vehicle with them.
        comparison: It against the recording, see `evaluation.compare`.
        diagnosis: What is missing in it, see `diagnosis.findings`.
        chi2: Of the diagnosis.
        ladder: The errors of this step, the rows of the ladder table.
        estimates: The values of `tables` with their covariance; None of step 0.
        status: The answer of the diagnosis in words; None of a step that was read from its files.
    """

    number: int
    added: tuple[str, ...]
    tables: tuple[dict[str, Any], ...]
    vehicle: Vehicle
    comparison: pl.DataFrame
    diagnosis: pl.DataFrame
    chi2: tuple[float, ...]
    ladder: pl.DataFrame
    estimates: Estimates | None = None
    status: Status | None = None

    def error(self, dataset: str) -> float | None:
        """Error of all velocities together, predicted HORIZON ahead [m/s]; None without such data."""
        row = self.ladder.filter(dataset=dataset, axis="all", horizon=HORIZON)
        return None if row.is_empty() else float(row["rmse"][0])

    @property
    def left_out(self) -> float | None:
        """Error of stretches left out of the fit [m/s]; None where others decide which step to use."""
        row = self.ladder.filter(axis=LEFT_OUT)
        return None if row.is_empty() else float(row["rmse"][0])


def best(steps: Sequence[Step]) -> Step:
    """The step to use: the last, or the one before where the last went too far."""
    return steps[best_step(pl.concat(step.ladder for step in steps))]


def best_step(ladder: pl.DataFrame) -> int:
    """Number of the step to use in a ladder: the last, or the one before it where that predicts better.

    Held-out predictions HORIZON ahead decide, or those with the hull beside the file where its model is
    known; without such data stretches left out of the fit.
    """
    held_out = ladder.filter(dataset="holdout")
    tried = (
        held_out.filter(axis=FLOOR),
        held_out.filter(axis="all", horizon=HORIZON),
        ladder.filter(axis=LEFT_OUT),
    )
    rows = next((one.sort("step") for one in tried if not one.is_empty()), held_out)
    last, errors = int(ladder["step"].max() or 0), rows["rmse"].to_list()  # type: ignore[arg-type]
    return last - 1 if len(errors) > 1 and errors[-1] > RISE * min(errors[:-1]) else last


def rungs(number: int, added: Sequence[str], dataset: str, comparison: pl.DataFrame) -> pl.DataFrame:
    """Rows of the ladder from one comparison: the errors of predictions over all of the recording.

    With the model of the hull also that of all channels together in units of its floor.
    """
    key = ["axis", "horizon"]
    beside = (pl.col("level") == OF_HULL) & (pl.col("axis") == FLOOR) & (pl.col("by") == BESIDE)
    own = (pl.col("level") == "replay") & (pl.col("by") == "all")
    rungs = comparison.filter(own | beside).select(
        pl.lit(number, pl.Int64).alias("step"),
        pl.lit(", ".join(added)).alias("effect"),
        *(pl.lit(dataset).alias(name) if name == "dataset" else name for name in RUNG),
    )
    for name in PREDICTORS:
        simple = comparison.filter(level=LEVEL, by=name).select(*key, pl.col("rmse").alias(column(name)))
        rungs = rungs.join(simple, on=key, how="left", nulls_equal=True, maintain_order="left")
    return rungs.select(pl.exclude("unit"), "unit")


def left_out_rung(rungs: pl.DataFrame, error: float) -> pl.DataFrame:
    """The rung of stretches left out of the fit, beside those of predictions over all of the recording."""
    same = rungs.filter(horizon=HORIZON).select("step", "effect", *RUNG)[-1:]
    return same.with_columns(axis=pl.lit(LEFT_OUT), rmse=pl.lit(error), low=UNKNOWN, high=UNKNOWN)
