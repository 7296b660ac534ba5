from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.columns import VELOCITY, WRENCH
from hydro.core.errors import DataError
from hydro.core.evaluation.metrics import Subject, consecutive, measure


def pair(rows: int = 400, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    truth = rng.normal(size=(rows, 6)) * [100, 80, 60, 5, 8, 10] + [50, 0, 0, 0, 0, 3]
    return truth, truth + rng.normal(size=(rows, 6)) * [5, 4, 3, 1, 0.5, 2] + 0.3


def table(truth, predicted, blocks=None, variant="", **options) -> pl.DataFrame:
    blocks = consecutive(len(truth), 20) if blocks is None else blocks
    return measure(truth, predicted, blocks, Subject("m", "d", variant), **options)


def value(frame: pl.DataFrame, axis: str, metric: str, column: str = "value") -> float:
    return frame.filter(axis=axis, metric=metric)[column].item()


@given(st.integers(2, 300), st.integers(1, 40), st.integers(0, 5))
def test_values_are_the_textbooks(rows, length, seed):
    truth, predicted = pair(rows, seed)
    made = table(truth, predicted, consecutive(rows, length))
    error = predicted - truth
    for i, axis in enumerate(WRENCH):
        assert value(made, axis, "rmse") == pytest.approx(math.sqrt(np.mean(error[:, i] ** 2)))
        assert value(made, axis, "mae") == pytest.approx(np.mean(np.abs(error[:, i])))
        r2 = 1 - np.sum(error[:, i] ** 2) / np.sum((truth[:, i] - truth[:, i].mean()) ** 2)
        assert value(made, axis, "r2") == pytest.approx(r2, rel=1e-6, abs=1e-9)


def test_the_papers_single_figures_take_all_axes_as_they_are():
    truth, predicted = pair()
    made = table(truth, predicted)
    assert value(made, "all", "rmse") == pytest.approx(np.sqrt(np.mean((predicted - truth) ** 2)))
    assert value(made, "all", "mae") == pytest.approx(np.mean(np.abs(predicted - truth)))
    assert value(made, "mean", "r2") == pytest.approx(np.mean([value(made, axis, "r2") for axis in WRENCH]))
    assert made.filter(axis="all")["unit"].unique().to_list() == ["N, N m"]


def test_columns_are_the_schemas():
    made = table(*pair(), variant="v")
    schema = json.loads((Path(__file__).parents[3] / "schemas" / "metrics.json").read_text())
    assert made.columns == [field["name"] for field in schema["fields"]]
    assert made.select("model", "variant", "dataset", "axis", "metric").is_unique().all()
    assert made.select("model", "variant", "dataset").unique().rows() == [("m", "v", "d")]
    assert dict(made.filter(metric="rmse").select("axis", "unit").rows())["K"] == "N m"


def test_velocity_axes():
    made = table(*pair(), axes=VELOCITY)
    assert made.filter(metric="mae")["axis"].to_list() == [*VELOCITY, "all"]
    assert made.filter(axis="r", metric="rmse")["unit"].item() == "rad/s"


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Errors constant within a block: 95 % intervals over blocks cover, over single rows they do not."""
    rng, trials, covered = np.random.default_rng(7), 40, {"blocks": 0, "rows": 0}
    for trial in range(trials):
        error = np.repeat(rng.normal(size=(60, 6)), 10, axis=0)
        for kind, blocks in (("blocks", consecutive(600, 10)), ("rows", np.arange(600))):
            made = table(np.zeros_like(error), error, blocks, seed=trial)
            covered[kind] += value(made, "X", "rmse", "low") <= 1.0 <= value(made, "X", "rmse", "high")
    assert covered["blocks"] >= 33
    assert covered["rows"] < 28


def test_same_seed_same_interval():
    truth, predicted = pair()
    assert table(truth, predicted, seed=3).equals(table(truth, predicted, seed=3))
    assert not table(truth, predicted, seed=3).equals(table(truth, predicted, seed=4))


def test_block_ids_and_numbers_are_alike():
    truth, predicted = pair()
    numbers = consecutive(400, 30)
    ids = pl.Series([f"{n:05d}" for n in numbers])
    assert table(truth, predicted, ids).equals(table(truth, predicted, numbers))
    order = np.random.default_rng(0).permutation(400)
    shuffled = table(truth[order], predicted[order], numbers[order])
    np.testing.assert_allclose(shuffled["high"], table(truth, predicted, numbers)["high"], rtol=1e-9)


def test_one_block_has_no_interval():
    made = table(*pair(20), np.zeros(20, int))
    assert made["low"].null_count() == made["high"].null_count() == made.height


def test_an_axis_that_never_changes_has_no_r2():
    truth, predicted = pair()
    truth[:, 3] = 0.1
    made = table(truth, predicted)
    assert "K" not in made.filter(metric="r2")["axis"]
    assert value(made, "K", "rmse") > 0
    assert made["value"].is_finite().all()


def test_an_axis_that_changes_in_one_block_alone_has_r2_without_an_interval():
    """Bootstrap draws without that block have no variance, hence no R^2; their errors are defined."""
    truth, predicted = pair(60)
    truth[20:, 3] = truth[0, 3]
    made = table(truth, predicted, consecutive(60, 20))
    assert np.isfinite(value(made, "K", "r2"))
    assert made.filter(pl.col("low").is_null()).select("axis", "metric").rows() == [
        ("K", "r2"),
        ("mean", "r2"),
    ]
    assert made.select(pl.col("low").is_null() == pl.col("high").is_null()).to_series().all()


@given(st.integers(1, 1000), st.integers(1, 200))
def test_consecutive_blocks(rows, length):
    blocks = consecutive(rows, length)
    sizes = np.bincount(blocks)
    assert (np.diff(blocks) >= 0).all()
    assert (sizes[:-1] == length).all()
    assert sizes[-1] < 2 * length


def test_bad_input():
    truth, predicted = pair()
    with pytest.raises(DataError, match="two tables of the same rows"):
        table(truth, predicted[:-1])
    with pytest.raises(DataError, match="at least one"):
        table(truth[:0], predicted[:0])
    predicted[7, 2] = np.inf
    with pytest.raises(DataError, match=r"1 of 400 rows are not \(first: row 7\)"):
        table(truth, predicted)
