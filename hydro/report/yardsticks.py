"""Comparison of a model with simple predictors on the same predictions, and which predictors are better."""

from __future__ import annotations

import polars as pl

from hydro.core.columns import VELOCITY, WRENCH_UNITS
from hydro.core.errors import listed
from hydro.core.evaluation.small_commands import unseen_small_commands
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
from hydro.core.vehicle.description import Vehicle
from hydro.report import words

MODEL = "model"
"""Name of the column of the model."""


def of_comparison(comparison: pl.DataFrame) -> pl.DataFrame:
    """Return a table of the errors of the model and of the simple predictors, for the same predictions.

    Args:
        comparison: Comparison table.

    Returns:
        One row per axis, horizon and simple predictor, with the columns `axis`, `horizon`, `unit`,
        `predictor`, and the root mean square errors `model` (of the vehicle) and `simple` (of the predictor);
        no rows for a comparison of an old version without such predictors.
    """
    key = ["axis", "horizon"]
    model = comparison.filter(level="replay", by="all").select(*key, "unit", model="rmse")
    simple = comparison.filter(level=LEVEL).select(*key, predictor="by", simple="rmse")
    return model.join(simple, on=key, how="inner", maintain_order="left_right")


def of_ladder(ladder: pl.DataFrame, step: int, dataset: str) -> pl.DataFrame:
    """Return a table of the errors of a study's step and of the simple predictors, for the same predictions.

    Args:
        ladder: Ladder table.
        step: Number of the step of the study.
        dataset: `fit` or `holdout`.

    Returns:
        Columns `axis`, `horizon`, `unit`, `predictor`, and the root mean square errors `model` and `simple`.
    """
    there = [name for name in PREDICTORS if column(name) in ladder.columns]
    rows = ladder.filter(step=step, dataset=dataset)
    each = [
        rows.select("axis", "horizon", "unit", predictor=pl.lit(name), model="rmse", simple=column(name))
        for name in there
    ]
    return pl.concat(each).drop_nulls("simple") if each else _nothing()


def judged_on(ladder: pl.DataFrame) -> str:
    """Return the data set on which the model and simple predictors are compared: `holdout`, or else `fit`."""
    return "holdout" if "holdout" in ladder["dataset"] else "fit"


def verdict(errors: pl.DataFrame) -> str:
    """Return words on the predictors that are better than the model: `loses to constant velocity on p and r`.

    The text is empty if no predictor is better.

    Args:
        errors: Errors in the form of `of_comparison`.
    """
    found = lost(errors.filter(horizon=JUDGED))
    told = []
    for name in PREDICTORS:
        if axes := [axis for axis, best in found if best == name]:
            told.append(f"to {name} on {listed(axes)}")
    return f"loses {listed(told)}" if told else ""


def sentence(errors: pl.DataFrame) -> str:
    """Return a sentence on the predictors that are better than the model, or that none is.

    Args:
        errors: Errors in the form of `of_comparison`; without rows, the sentence is empty.
    """
    told = verdict(errors)
    if not told:
        tried = [name for name in PREDICTORS if name in errors["predictor"]]
        simple = f"no simple predictor ({', '.join(tried)}) is better than the model"
        axes = [axis for axis in VELOCITY if axis in errors.filter(horizon=JUDGED)["axis"]]
        where = "on any axis" if len(axes) in (0, len(VELOCITY)) else f"on {listed(axes, 'or')}"
        return f"{JUDGED:g} s ahead {simple} {where}." if tried else ""
    return f"{JUDGED:g} s ahead the model {told}."


def explained(errors: pl.DataFrame, yardstick: Yardstick, record: Recording) -> list[str]:
    """Return a sentence, for each axis on which least squares is better than the model, on the reason.

    Args:
        errors: Errors in the form of `of_comparison`.
        yardstick: The simple predictors, fitted to the training recording.
        record: The training recording.
    """
    behind = [axis for axis, name in lost(errors.filter(horizon=JUDGED)) if name == LEAST_SQUARES]
    return [
        f"On {axis} least squares gains most from {reason(yardstick, record, VELOCITY.index(axis))}."
        for axis in behind
    ]


def unlearnt(errors: pl.DataFrame, vehicle: Vehicle, training: Recording, held_out: Recording) -> list[str]:
    """Return a sentence for each axis where a simple predictor is better and commands differ from training.

    The sentence states the share of small commands in both recordings, which show a thruster's dead band.

    Args:
        errors: Errors on the held-out recording, in the form of `of_comparison`.
        vehicle: Vehicle file.
        training: The training recording.
        held_out: The held-out recording.
    """
    behind = {axis for axis, _ in lost(errors.filter(horizon=JUDGED))}
    told = []
    for one in unseen_small_commands(vehicle, training, held_out):
        unit = WRENCH_UNITS[VELOCITY.index(one.axis)]
        if one.axis in behind:
            told.append(
                f"On {one.axis} {100.0 * one.held_out:.0f} % of the held-out commands are small "
                f"({one.low:.2g} to {one.high:.2g} {unit}), but only {100.0 * one.training:.0f} % of the "
                "training commands: the fit does not show the thrusters' dead band. Record small commands."
            )
    return told


def table(errors: pl.DataFrame) -> pl.DataFrame:
    """Return the errors of model and simple predictors as texts, one row per axis, one column per predictor.

    A cell has the errors at all horizons.

    Args:
        errors: Errors in the form of `of_comparison`.
    """
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
    """Return the prediction horizons of the cells of `table` as a text: `1 / 5 / 20 s ahead`.

    Args:
        errors: Errors in the form of `of_comparison`.
    """
    return " / ".join(f"{one:g}" for one in errors["horizon"].unique().sort()) + " s ahead"


def _nothing() -> pl.DataFrame:
    """Return a table without errors."""
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
