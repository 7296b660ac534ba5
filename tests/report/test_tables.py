"""Metrics laid out as the paper's tables."""

from __future__ import annotations

import polars as pl
import pytest

from hydro.report import figures, tables


def line(name: str, axis: str, metric: str, value: float, low: float | None = None) -> dict[str, object]:
    return {
        "model": name,
        "variant": name,
        "dataset": "run",
        "axis": axis,
        "metric": metric,
        "value": value,
        "low": low,
        "high": low,
    }


def test_replay_errors_keep_order_and_axes() -> None:
    metrics = pl.DataFrame(
        [line(name, axis, "rmse", k + 0.5) for name in ("MJ4", "MJ0") for k, axis in enumerate("rqpwvu")]
    )
    table = tables.replay_errors(metrics)
    assert table.columns == ["variant", *"uvwpqr"]
    assert table.rows() == [("MJ4", 5.5, 4.5, 3.5, 2.5, 1.5, 0.5), ("MJ0", 5.5, 4.5, 3.5, 2.5, 1.5, 0.5)]


def test_a_diverged_replay_has_only_its_time() -> None:
    metrics = pl.DataFrame(
        [
            line("MJ0", "u", "rmse_before_divergence", 3.0),
            line("MJ0", "all", "diverged", 12.5),
            line("MJ4", "u", "rmse", 0.01),
        ]
    )
    table = tables.replay_errors(metrics)
    assert table.columns == ["variant", "u", "diverged at"]
    assert table.rows() == [("MJ0", None, 12.5), ("MJ4", 0.01, None)]
    texts = [text.get_text() for panel in figures.draw_errors(table).axes for text in panel.texts]
    assert texts == ["–", "0.0100"]


def test_conditioning_shares_are_of_networks_alone() -> None:
    metrics = pl.DataFrame(
        [
            line("MJ0", "u", "rmse", 3.0),
            *(line("MJ4", axis, "clipped", k / 10) for k, axis in enumerate("XYZKMN")),
            line("MJ4", "all", "held_back", 0.25),
        ]
    )
    table = tables.conditioning_shares(metrics)
    assert table.columns == ["variant", *"XYZKMN", "dead band"]
    assert table.rows() == [("MJ4", 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.25)]
    assert tables.conditioning_shares(metrics.head(1)).is_empty()


def test_prediction_errors_list_axes_then_totals() -> None:
    metrics = pl.DataFrame(
        [
            *(line("mlp", axis, "rmse", float(k)) for k, axis in enumerate("XYZKMN")),
            *(line("mlp", axis, "mae", 9.0) for axis in "XYZKMN"),
            line("mlp", "all", "rmse", 11.8, low=11.0),
            line("mlp", "all", "mae", 5.9),
            line("mlp", "mean", "r2", 0.98),
        ]
    )
    table = tables.prediction_errors(metrics.with_columns(variant=pl.lit("")))
    assert table.columns == ["model", *"XYZKMN", "RMSE", "low", "high", "MAE", "R2"]
    assert table.row(0) == ("mlp", 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 11.8, 11.0, 11.0, 5.9, 0.98)


def test_axes_that_were_not_measured_have_no_column() -> None:
    metrics = pl.DataFrame([line("mlp", "X", "rmse", 1.0), line("mlp", "all", "rmse", 2.0)])
    assert tables.prediction_errors(metrics.with_columns(variant=pl.lit(""))).drop_nulls("RMSE").row(0)[
        :3
    ] == pytest.approx(("mlp", 1.0, 2.0))
