"""Figures of predictions: the tables hold every row, the drawings draw."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from hydro.core.evaluation.metrics import Subject, measure
from hydro.report import predictions
from hydro.report.figures import save
from hydro.report.tables import prediction_errors, regime_errors


@pytest.fixture(scope="module")
def arrays():
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(500, 6)) * [100.0, 50.0, 80.0, 3.0, 5.0, 8.0]
    return truth, truth + rng.normal(size=(500, 6))


@pytest.fixture(scope="module")
def metrics(arrays):
    blocks = np.arange(500) // 50
    found = [
        measure(arrays[0], size * arrays[1], blocks, Subject(name, "d", variant))
        for name, size in (("mlp", 1.0), ("physfeat", 1.1))
        for variant in ("", "speed 0-0.25 m/s", "speed 0.25-0.5 m/s", "drift 0-15 deg")
    ]
    return pl.concat(found)


def test_every_row_is_in_a_cell_near_the_diagonal(arrays):
    table = predictions.density_table(*arrays)
    assert table.group_by("axis").agg(pl.col("rows").sum())["rows"].unique().to_list() == [500]
    true = predictions.density_table(arrays[0], arrays[0])
    assert (true["truth"] == true["predicted"]).all()
    surge = table.filter(axis="X")
    away = (surge["truth"] - surge["predicted"]).abs().max()
    assert 2.0 < away < 5.0 + 2 * surge["cell"][0], "one sigma of noise is 1 N"


def test_tables_keep_regimes_apart(metrics):
    assert prediction_errors(metrics).height == 2
    table = regime_errors(metrics)
    assert table.columns == ["regime", "mlp", "physfeat"]
    assert table.height == 3


def test_figures_are_drawn(arrays, metrics, tmp_path):
    density = predictions.density_table(*arrays)
    for name, figure in (
        ("density", predictions.draw_density(density, "mlp")),
        ("axes", predictions.draw_axes(metrics)),
        ("regimes", predictions.draw_regimes(metrics)),
    ):
        save(figure, tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}.png").stat().st_size > 5000
    assert [panel.get_title(loc="left") for panel in predictions.draw_regimes(metrics).axes] == [
        "by speed [m/s]",
        "by drift [deg]",
    ]
    bars = [bar.get_height() for bar in predictions.draw_axes(metrics).axes[0].patches]
    expected = metrics.filter(pl.col("metric") == "rmse", pl.col("variant") == "", pl.col("axis") == "X")
    assert bars[0] == expected["value"][0]
