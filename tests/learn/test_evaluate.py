"""Evaluation of networks: physical units, and errors equal to numpy's."""

from __future__ import annotations

import dataclasses

import numpy as np
import polars as pl
import pytest

from hydro.core.distillation.features import features
from hydro.core.errors import DataError, UsageError
from hydro.io import schema
from hydro.learn import evaluate as evaluation
from hydro.learn import rows
from hydro.learn.evaluate import evaluate, predict
from hydro.learn.train import train


@pytest.fixture(scope="module")
def models(table):
    return [train(table(600), model=model, epochs=4) for model in ("mlp", "physfeat")]


def value(metrics: pl.DataFrame, **where: str) -> float:
    return metrics.filter(**where)["value"].item()


def test_errors_are_those_of_the_predictions_on_the_test_part(table, models):
    split = table(800, seed=1)
    metrics = evaluate(models, split, dataset="synthetic")
    test = split.filter(pl.col("part") == "test")
    truth = rows.wrenches(test)
    assert metrics["model"].unique(maintain_order=True).to_list() == ["mlp", "physfeat"]
    assert metrics["dataset"].unique().to_list() == ["synthetic"]
    for model in models:
        error = predict(model, rows.states(test)) - truth
        for axis, column in zip("XYZKMN", error.T, strict=True):
            assert value(metrics, model=model.name, axis=axis, metric="rmse") == pytest.approx(
                np.sqrt((column**2).mean())
            )
        single = value(metrics, model=model.name, axis="all", metric="rmse")
        assert single == pytest.approx(np.sqrt((error**2).mean()))
        r2 = 1.0 - (error**2).sum(axis=0) / ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
        assert value(metrics, model=model.name, axis="mean", metric="r2") == pytest.approx(r2.mean())


def test_errors_fit_the_schema_of_metrics(table, models):
    checked = schema.load("metrics").check(evaluate(models, table(400)), "metrics")
    assert set(checked["unit"]) >= {"N", "N m", "1"}


def test_all_rows_need_no_split(table, models):
    split = table(400)
    unsplit = split.drop("part", "block")
    for metrics in (evaluate(models, split, part="all"), evaluate(models, unsplit, part="all")):
        error = predict(models[0], rows.states(split)) - rows.wrenches(split)
        assert value(metrics, model="mlp", axis="all", metric="rmse") == pytest.approx(
            np.sqrt((error**2).mean())
        )
    with pytest.raises(DataError, match="split the labels first"):
        evaluate(models, unsplit)


def test_rows_do_not_depend_on_their_neighbours(table, models, monkeypatch):
    states = rows.states(table(200))
    whole = predict(models[1], states)
    monkeypatch.setattr(evaluation, "ROWS_PER_PASS", 7)
    np.testing.assert_allclose(predict(models[1], states), whole, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(predict(models[1], states[3])[0], whole[3], rtol=1e-5, atol=1e-3)


def test_prediction_is_the_layers_by_hand(models, table):
    model, states = models[1], rows.states(table(50))
    hidden = (features(states, "physfeat") - model.scalers["input_mean"]) / model.scalers["input_scale"]
    for i in range(4):
        hidden = hidden @ model.tensors[f"layers.{i}.weight"].T + model.tensors[f"layers.{i}.bias"]
        hidden = hidden / (1.0 + np.exp(-hidden)) if i < 3 else hidden
    expected = model.scalers["output_mean"] + model.scalers["output_scale"] * hidden
    np.testing.assert_allclose(predict(model, states), expected, rtol=1e-4, atol=1e-2)


def test_two_models_of_one_name_are_refused(table, models):
    with pytest.raises(UsageError, match="two models are called 'mlp'"):
        evaluate([models[0], models[0]], table(400))


def test_features_of_another_version_are_refused(models):
    strange = dataclasses.replace(models[1], inputs=tuple(reversed(models[1].inputs)))
    with pytest.raises(DataError, match="its features are not those of this version"):
        predict(strange, np.zeros((1, 12)))
