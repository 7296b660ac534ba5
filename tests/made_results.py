"""Results of the Python functions made up for tests, without a fit: their tables keep the schemas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import studies

import hydro
from hydro.core.diagnosis.findings import Diagnosis as Found
from hydro.core.diagnosis.findings import Finding, Prediction, extended
from hydro.core.diagnosis.status import Reference, status
from hydro.core.evaluation.yardsticks import LEVEL, PREDICTORS
from hydro.core.identification.outcome import Fit as Outcome
from hydro.core.prediction.parameters import free
from hydro.io import vehicle as vehicles
from hydro.io.table import conform

VEHICLE = vehicles.parse(studies.TEXT)
CHI2 = (9.0, 4.0, 1.1)
DT = 0.02
CURRENT = replace(studies.FOUND_CURRENT, members=("ocean_current",), error_added=0.06)
GAIN = Finding(
    "suspect", "thruster_gain", ("thruster_gain",), share=0.2, confidence=0.7, parameters={"g": [0.0] * 8}
)
UNSEEN = Finding("not_excited", "surface_suction", ("surface_suction",), excited=False)
NOTHING = Finding("nothing_missing")
PREDICTION = Prediction(horizon=5.0, given=0.121, added=0.05, spread=0.003, floor=0.016)


def diagnosis(
    findings: Sequence[Finding] = (CURRENT, GAIN, UNSEEN), prediction: Prediction | None = PREDICTION
) -> hydro.Diagnosis:
    """A current of 0.35 m/s is missing, a gain is suspected, and one effect is not visible."""
    found = Found(tuple(findings), VEHICLE, CHI2, prediction=prediction)
    found = replace(found, status=status(findings, Reference(VEHICLE, DT)))
    return hydro.Diagnosis.of(found, VEHICLE, conform("diagnosis", found.frame()), changed=False)


def comparison(worst: str = "while turning right") -> hydro.Comparison:
    """Errors of 2 m/s 5 s ahead, twice and three times as large of the simple predictors."""
    table = studies.comparison(worst=worst)
    own = table.filter(pl.col("horizon").is_not_null(), level="replay", by="all")
    simple = [
        own.with_columns(level=pl.lit(LEVEL), by=pl.lit(name), rmse=factor * pl.col("rmse"))
        for name, factor in zip(PREDICTORS, (3.0, 3.0, 2.0), strict=True)
    ]
    return hydro.Comparison(conform("comparison", pl.concat([table, *simple])))


def fit(warnings: Sequence[str] = ("one entry is not determined",)) -> hydro.Fit:
    """Linear damping with its last entry undetermined."""
    unknown = free(VEHICLE, ["linear_damping"])
    count = len(unknown.entries)
    values = np.linspace(10.0, 60.0, count)
    errors = np.geomspace(0.1, 20.0, count)
    outcome = Outcome(
        unknown.at(values),
        unknown,
        values,
        errors,
        np.diag(errors**2),
        np.arange(count) < count - 1,
        1.02,
        "output",
        tuple(warnings),
    )
    return hydro.Fit.of(outcome, VEHICLE, DT)


ANSWER = "The model needs 1 correction: A current of 0.35 m/s (±0.01) flows toward 43° (NE)."


def study() -> hydro.Study:
    """A current added in one step: 2.0 to 0.2 m/s on the recording, 1.8 to 0.3 m/s on held-out data."""
    ladder = conform("ladder", studies.ladder())
    table = studies.CURRENT | {"standard_error": {"v_N": 0.01, "v_E": 0.01, "v_D": 0.01}}
    current, steps = extended(VEHICLE, [table]), []
    for number, found in enumerate((diagnosis(), diagnosis((NOTHING,)))):
        steps.append(
            hydro.Step(
                number,
                ("ocean_current",) if number else (),
                bool(number),
                (table,) if number else (),
                current if number else VEHICLE,
                comparison(),
                found,
                ladder.filter(step=number),
            )
        )
    return hydro.Study.of(steps, best=1, ending="nothing more is found", answer=ANSWER)


@cache
def every() -> dict[str, hydro.Diagnosis | hydro.Comparison | hydro.Fit | hydro.Study]:
    """One result of each kind."""
    return {"diagnosis": diagnosis(), "comparison": comparison(), "fit": fit(), "study": study()}
