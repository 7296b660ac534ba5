"""Predictions of trained models, and their errors on labels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl
import torch
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.distillation.features import features
from hydro.core.errors import DataError, UsageError
from hydro.core.evaluation.metrics import Subject, consecutive, measure
from hydro.io.model import Model
from hydro.learn import networks, rows
from hydro.learn.regimes import regimes, require_ways

BLOCK = 150  # rows per bootstrap block of tables without `block`, as in `distillation.split`
ROWS_PER_PASS = 16384  # rows per evaluation of a network, to limit memory


def predict(model: Model, states: ArrayLike, past: ArrayLike | None = None) -> Array:
    """Return the residual wrench that a trained model predicts for many states.

    Args:
        model: a trained model.
        states: (nu, nu_dot) in body axes, FRD, shape (N, 12) [m/s, rad/s, m/s^2, rad/s^2].
        past: the past velocities (N, 6 (window - 1)) of a model with a window, newest first, one control step
            apart; by default a constant velocity nu.

    Returns:
        tau_res (N, 6) [N and N m], body FRD.  It stands on the left-hand side of the equations of motion: the
        wrench on the vehicle is -tau_res.

    Raises:
        DataError: If the tensors or features of the model do not fit its architecture.
    """
    given = np.asarray(states, dtype=np.float64).reshape(-1, 12)
    made = features(given, model.features)
    window = model.architecture.get("window", 1)
    before = np.tile(given[:, :6], window - 1) if past is None else np.asarray(past, dtype=np.float64)
    return _predict(model, np.hstack([made, before]))


def predict_rows(model: Model, table: pl.DataFrame, part: str = "test") -> tuple[pl.DataFrame, Array]:
    """Return the residual wrench that a model predicts for training, test or all rows of labels.

    Args:
        model: a trained model.
        table: labels; all rows of their sessions in order if the model has a window.
        part: `test`, `train`, or `all` rows, including the guard rows between the two.

    Returns:
        The selected rows, and tau_res (N, 6) [N and N m] as in `predict`.

    Raises:
        DataError: If the part is empty, a column is missing or not finite, or the model is broken.
    """
    chosen, inputs = rows.inputs(table, part, model.architecture)
    return chosen, _predict(model, inputs)


def _predict(model: Model, inputs: Array) -> Array:
    if tuple(model.inputs) != networks.inputs(model.architecture):
        raise DataError(f"model {model.name}: its features are not those of this version: train it again")
    network = networks.load(model)
    wrenches = np.empty((len(inputs), 6))
    with torch.inference_mode():
        for start in range(0, len(inputs), ROWS_PER_PASS):
            part = inputs[start : start + ROWS_PER_PASS].astype(np.float32)
            wrenches[start : start + ROWS_PER_PASS] = network(torch.from_numpy(part)).numpy()
    return wrenches


def evaluate(
    models: Sequence[Model],
    table: pl.DataFrame,
    *,
    part: str = "test",
    dataset: str = "labels",
    by: Sequence[str] = (),
) -> pl.DataFrame:
    """Return the errors of models on labels, per axis and over all axes (Table II of Wu et al.), as a table.

    Args:
        models: trained models with different names.
        table: labels, with `part` unless all rows are used; if it has `block`, the bootstrap draws whole
            blocks.
        part: `test`, `train`, or `all` rows, including the guard rows between the two.
        dataset: name of the data in the table.
        by: divisions of the rows by motion, `speed`, `drift` or `reach`, evaluated in addition to all rows.

    Returns:
        A metrics table: root mean square error, mean absolute error and R^2 (`metric`, `value`) by `model`
        and `axis`, with a 95 % bootstrap interval from `low` to `high`.  Column `variant` names the regime of
        motion; it is empty for all rows together.

    Raises:
        DataError: If the part is empty, a column is missing or not finite, or a model is broken.
        UsageError: If two models have one name, or `by` has an unknown entry.
    """
    repeated = [model.name for model in models if sum(other.name == model.name for other in models) > 1]
    if repeated:
        raise UsageError(f"two models are called '{repeated[0]}': evaluate them one by one")
    require_ways(by)
    measured = []
    for model in models:
        chosen, predicted = predict_rows(model, table, part)
        blocks = chosen["block"] if "block" in chosen.columns else consecutive(chosen.height, BLOCK)
        truth, number = rows.wrenches(chosen), pl.Series(blocks).rank("dense").to_numpy()
        everything = ("", np.ones(len(truth), dtype=bool))
        nu = rows.states(chosen)[:, :6]
        for name, some in (everything, *(regime for way in by for regime in regimes(model, nu, way))):
            measured.append(
                measure(truth[some], predicted[some], number[some], Subject(model.name, dataset, name))
            )
    return pl.concat(measured)
