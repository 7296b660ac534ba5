"""A model beside the simple predictors: errors of the same predictions, and to which of them it loses."""

from __future__ import annotations

import polars as pl

from hydro.core.columns import VELOCITY
from hydro.core.errors import listed
from hydro.core.evaluation.yardsticks import (
    JUDGED,
    LEAST_SQUARES,
    LEVEL,
    PREDICTORS,
    Yardstick,
    column,
    lost,
    reason,
)
from hydro.core.recording.arrays import Recording
from hydro.report import words

MODEL = "model"


def of_comparison(comparison: pl.DataFrame) -> pl.DataFrame:
    """Errors of the model and of the simple predictors.

    Returns:
        `axis`, `horizon`, `unit`, `predictor`, `model` and `simple`, the root mean square errors; no rows of
        a comparison that was made before there were such predictors.
    """
    key = ["axis", "horizon"]
    model = comparison.filter(level="replay", by="all").select(*key, "unit", model="rmse")
    simple = comparison.filter(level=LEVEL).select(*key, predictor="by", simple="rmse")
    return model.join(simple, on=key, how="inner", maintain_order="left_right")


def of_ladder(ladder: pl.DataFrame, step: int, dataset: str) -> pl.DataFrame:
    """The same of one step of a ladder and one of its data sets."""
    there = [name for name in PREDICTORS if column(name) in ladder.columns]
    rows = ladder.filter(step=step, dataset=dataset)
    each = [
        rows.select("axis", "horizon", "unit", predictor=pl.lit(name), model="rmse", simple=column(name))
        for name in there
    ]
    return pl.concat(each).drop_nulls("simple") if each else _nothing()


def judged_on(ladder: pl.DataFrame) -> str:
    """The data set on which a study's model is held against the simple predictors: what was held out."""
    return "holdout" if "holdout" in ladder["dataset"] else "fit"


def verdict(errors: pl.DataFrame) -> str:
    """To which simple predictors the model loses: `loses to constant velocity on p and r`; empty if to none.

    Args:
        errors: As `of_comparison` gives them.
    """
    found = lost(errors.filter(horizon=JUDGED))
    told = []
    for name in PREDICTORS:
        if axes := [axis for axis, best in found if best == name]:
            told.append(f"to {name} on {listed(axes)}")
    return f"loses {listed(told)}" if told else ""


def sentence(errors: pl.DataFrame) -> str:
    """The same as a sentence that says what was done."""
    told = verdict(errors)
    if not told:
        return (
            f"{JUDGED:g} s ahead the model loses to no simple predictor on any axis." if errors.height else ""
        )
    return f"{JUDGED:g} s ahead the model {told}."


def explained(errors: pl.DataFrame, yardstick: Yardstick, record: Recording) -> list[str]:
    """Return a sentence for each axis on which the model loses to least squares: what that gains from.

    Args:
        errors: As `of_comparison` gives them.
        yardstick: The simple predictors, fitted to the training recording.
        record: That recording.
    """
    behind = [axis for axis, name in lost(errors.filter(horizon=JUDGED)) if name == LEAST_SQUARES]
    return [
        f"On {axis} least squares gains most from {reason(yardstick, record, VELOCITY.index(axis))}."
        for axis in behind
    ]


def table(errors: pl.DataFrame) -> pl.DataFrame:
    """One row per axis, one column per predictor; in each the errors at all horizons, the shortest first."""
    horizons = errors["horizon"].unique().sort().to_list()
    rows = []
    for axis in [axis for axis in (*VELOCITY, "all") if axis in errors["axis"]]:
        one = errors.filter(axis=axis)
        cells = {MODEL: dict(one.select("horizon", MODEL).iter_rows())}
        for name in PREDICTORS:
            cells[name] = dict(one.filter(predictor=name).select("horizon", "simple").iter_rows())
        told = {
            name: " / ".join(words.figure(cell.get(h), 2) for h in horizons) for name, cell in cells.items()
        }
        rows.append({"axis": axis, **told, "unit": one["unit"][0]})
    return pl.DataFrame(rows)


def ahead(errors: pl.DataFrame) -> str:
    """The horizons of the table's cells: `1 / 5 / 20 s ahead`."""
    return " / ".join(f"{one:g}" for one in errors["horizon"].unique().sort()) + " s ahead"


def _nothing() -> pl.DataFrame:
    """No errors."""
    text, number = pl.String, pl.Float64
    kinds = {
        "axis": text,
        "horizon": number,
        "unit": text,
        "predictor": text,
        MODEL: number,
        "simple": number,
    }
    return pl.DataFrame(schema=kinds)
