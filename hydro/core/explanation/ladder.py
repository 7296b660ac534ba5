"""Steps of a study, the ladder of their errors, and the choice of the step to use.

The errors of all steps are comparable, because step 0 fixes the weights of the axes and the simple
predictors beside them, which were fitted to the recording (`evaluation.yardsticks`).  The choice rests on
held-out predictions HORIZON ahead.  Without held-out data, each stretch of the recording is predicted by a
fit to all others.  With a hull-force model from an earlier recording, errors are in units of its floor: its
error on stretches of that recording that it was not fitted to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import polars as pl

from hydro.core.diagnosis.findings import Finding, Status, of_table
from hydro.core.diagnosis.settings import NEGLIGIBLE
from hydro.core.evaluation.yardsticks import JUDGED, LEVEL, PREDICTORS, column
from hydro.core.explanation.with_hull import BESIDE, FLOOR
from hydro.core.explanation.with_hull import LEVEL as OF_HULL
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle

HORIZON = JUDGED
"""Prediction horizon at which steps are compared [s]."""
DATASETS = ("fit", "holdout")
"""Names of the recording that is fitted to and of the held-out one."""
LEFT_OUT = "left_out"
"""Name of the ladder's axis for all velocities together, on held-out stretches of the recording."""
RUNG = ("dataset", "axis", "horizon", "rmse", "low", "high", "noise_floor", "unit")
"""Columns of a row of the ladder."""
UNKNOWN = pl.lit(None, pl.Float64)


@dataclass(frozen=True)
class Step:
    """One step of a study.

    Attributes:
        number: Number of the step; 0 is the file as given.
        added: Effects that the step added, or refitted if it added none; empty for step 0.
        tables: `[[effect]]` tables of all effects that were fitted together, with standard errors; empty for
            step 0.
        vehicle: Vehicle file of step 0 with the effects of `tables`.
        comparison: Comparison of `vehicle` with the recording, see `evaluation.compare`.
        diagnosis: Diagnosis of `vehicle` as a table, see `diagnosis.findings`.
        chi2: Mean squared residual in units of the noise: of `vehicle`, of the baseline fit of its diagnosis,
            and with the findings of that diagnosis.
        ladder: Errors of this step, as rows of the ladder table.
        estimates: Values of `tables` with their covariance; None for step 0.
        status: Answer of the diagnosis in words; None of a step that was read from its files.
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

    @cached_property
    def findings(self) -> list[Finding]:
        """Findings of the diagnosis, in the order of their rank."""
        return of_table(self.diagnosis)

    def with_values(self, *verdicts: str) -> list[Finding]:
        """Return the findings with these verdicts that have values, in the order of their rank."""
        return [one for one in self.findings if one.verdict in verdicts and one.parameters]

    def error(self, dataset: str) -> float | None:
        """Return the error of all velocities together, HORIZON ahead [m/s]; None without such data.

        `dataset` is one of DATASETS.
        """
        row = self.ladder.filter(dataset=dataset, axis="all", horizon=HORIZON)
        return None if row.is_empty() else float(row["rmse"][0])

    @property
    def left_out(self) -> float | None:
        """Root mean square error of velocity on stretches that this step's fit left out [m/s].

        All axes are combined into one speed.  It is None if another recording decides which step to use.
        """
        row = self.ladder.filter(axis=LEFT_OUT)
        return None if row.is_empty() else float(row["rmse"][0])


def best(steps: Sequence[Step]) -> Step:
    """Return the step to use: the last, or the one before if the last predicts worse."""
    return steps[best_step(pl.concat(step.ladder for step in steps))]


def best_step(ladder: pl.DataFrame) -> int:
    """Return the number of the step to use in a ladder: the last, or the one before if that predicts better.

    The first of these errors that the ladder has decides: of the held-out recording in units of the floor of
    a hull-force model; of that recording HORIZON ahead; of held-out stretches of the fitted recording.
    """
    held_out = ladder.filter(dataset="holdout")
    tried = (
        held_out.filter(axis=FLOOR),
        held_out.filter(axis="all", horizon=HORIZON),
        ladder.filter(axis=LEFT_OUT),
    )
    rows = next((one.sort("step") for one in tried if not one.is_empty()), held_out)
    last, errors = int(ladder["step"].max() or 0), rows["rmse"].to_list()  # type: ignore[arg-type]
    return last - 1 if len(errors) > 1 and errors[-1] > (1.0 + NEGLIGIBLE) * min(errors[:-1]) else last


def rungs(number: int, added: Sequence[str], dataset: str, comparison: pl.DataFrame) -> pl.DataFrame:
    """Return rows of the ladder from one comparison: errors of predictions over the whole recording.

    With a hull-force model, a row holds the error of all channels together in units of its floor.
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
    """Return the ladder's row for the held-out stretches of the recording.

    Args:
        rungs: Rows of the step; the noise floor is that of all velocities together.
        error: Root mean square error of all velocities together, HORIZON ahead [m/s].
    """
    ahead = rungs.filter(horizon=HORIZON).sort(pl.col("axis") == "all", maintain_order=True)
    row = ahead.select("step", "effect", *RUNG)[-1:]
    return row.with_columns(
        axis=pl.lit(LEFT_OUT), rmse=pl.lit(error), low=UNKNOWN, high=UNKNOWN, unit=pl.lit("m/s")
    )
