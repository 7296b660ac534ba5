"""What the report says of simple predictors, of the recording, and of what was added already."""

from __future__ import annotations

import dataclasses
import re

import polars as pl
import pytest
import studies

from hydro.core.evaluation.yardsticks import CONSTANT, LEAST_SQUARES, ZERO
from hydro.io import schema, table
from hydro.report import cards, ladder, plots, yardsticks
from hydro.report.charts import Charts
from hydro.report.page import render
from hydro.report.sources import Named, Sources, gather

SIMPLE = {"zero_velocity": 0.5, "constant_velocity": 0.25, "least_squares": 0.1}
"""Errors 5 s ahead of the simple predictors on every axis; the study's file ends at 0.2 and 0.3 m/s."""


def judged() -> pl.DataFrame:
    """The ladder of the study with simple predictors beside it."""
    far = pl.col("horizon").is_not_null() & (pl.col("axis") != "pose")
    return studies.ladder().with_columns(
        pl.when(far).then(pl.lit(size)).alias(name) for name, size in SIMPLE.items()
    )


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Sources:
    found = gather([studies.write(tmp_path_factory.mktemp("study"))])
    made = table.make("ladder", judged(), stage="explain", vehicle_text=studies.TEXT)
    return dataclasses.replace(found, ladder=Named("ladder.parquet", made))


def test_a_ladder_with_predictors_keeps_its_schema():
    rules = schema.load("ladder")
    assert rules.check(rules.conform(judged()), "x").height == judged().height
    rules.check(rules.conform(studies.ladder()), "x")


def test_the_best_predictor_that_beats_the_model_is_named():
    frame = judged()
    assert yardsticks.judged_on(frame) == "holdout"
    told = yardsticks.verdict(yardsticks.of_ladder(frame, 1, "holdout"))
    assert told == "loses to least squares on u, v, w, p, q and r"
    better = frame.with_columns(least_squares=pl.lit(0.4), constant_velocity=pl.lit(0.4))
    assert yardsticks.verdict(yardsticks.of_ladder(better, 1, "holdout")) == ""
    one = better.with_columns(
        constant_velocity=pl.when(pl.col("axis") == "r").then(0.1).otherwise(pl.col("constant_velocity"))
    )
    assert yardsticks.verdict(yardsticks.of_ladder(one, 1, "holdout")) == f"loses to {CONSTANT} on r"
    told = yardsticks.sentence(yardsticks.of_ladder(better, 1, "holdout"))
    assert told.startswith("5 s ahead no simple predictor (")
    assert told.endswith("on any axis.")
    rates = better.filter(pl.col("axis").is_in(["p", "q", "r"]))
    assert yardsticks.sentence(yardsticks.of_ladder(rates, 1, "holdout")).endswith("on p, q or r.")


def test_without_simple_predictors_there_is_no_sentence():
    nothing = yardsticks.of_ladder(studies.ladder(), 1, "holdout")
    assert nothing.is_empty()
    assert yardsticks.sentence(nothing) == ""
    assert yardsticks.of_comparison(studies.comparison()).is_empty()


def test_the_terminal_ladder_lists_predictors_above_the_noise_floor():
    shown = ladder.errors(judged(), "holdout")
    assert shown["step"].to_list()[-4:] == [ZERO, CONSTANT, LEAST_SQUARES, "noise floor"]
    assert shown.row(-2) == (LEAST_SQUARES, *[0.1] * 7)


def test_the_page_names_the_predictor_that_beats_the_model(sources):
    page = re.sub(r"<[^>]*>", " ", render(sources).partition("<script>")[0])
    assert "loses to least squares on u, v, w, p, q and r" in page
    assert "on held-out data, of the same predictions" in page


def recorded(comparison: pl.DataFrame) -> pl.DataFrame:
    """A comparison that says what was recorded: 90 s at 10 Hz, noise on u, none on v."""
    row = comparison.row(0, named=True) | {"level": "recording", "horizon": None, "by": "all", "place": "all"}
    told = [
        row | {"axis": "t", "by": "session", "place": "dive 7", "rows": 900, "rmse": 0.1, "unit": "s"},
        row | {"axis": "u", "rmse": 0.0123, "unit": "m/s"},
        row | {"axis": "v", "rmse": 1e-4, "unit": "m/s"},
    ]
    return pl.concat([comparison, pl.DataFrame(told, schema=comparison.schema)])


def test_the_page_describes_the_recording():
    made = table.make("comparison", recorded(studies.comparison()), stage="compare")
    page = render(Sources(comparisons=(Named("one.parquet", made),)))
    text = " ".join(re.sub(r"<[^>]*>", " ", page.partition("<script>")[0]).split())
    assert "dive 7 1.50 10.0" in text
    assert "u 0.012 m/s v &lt; 0.0001 m/s" in text


def test_a_card_does_not_repeat_the_next_step(sources):
    found = cards.findings(sources, Charts())
    assert found is not None
    added, *_ = found["groups"]
    assert [card["verdict"] for card in added["cards"]] == ["missing", "retune"]
    assert [card["advice"] for card in added["cards"]] == ["", ""]


def test_bars_of_both_series_have_intervals():
    rows = studies.comparison().filter(by="speed", axis="Y")
    both = rows.with_columns(
        before=2.0 * pl.col("rmse"), before_low=pl.col("rmse"), before_high=9.0 * pl.col("rmse")
    )
    before, now = plots.conditions(both).data
    assert before.error_x.arrayminus == pytest.approx(rows["rmse"].to_list())
    assert now.error_x.array == pytest.approx((rows["high"] - rows["rmse"]).to_list())


def test_a_path_is_drawn_as_on_a_chart_and_depth_downwards():
    """North 0 to 10 m, east 0 to 5 m, sinking to 3 m."""
    t = [0.0, 1.0, 2.0]
    track = {"x": [0.0, 5.0, 10.0], "y": [0.0, 2.5, 5.0], "z": [0.0, 1.0, 3.0]}
    replay = pl.DataFrame({"session": ["a"] * 3, "variant": ["measured"] * 3, "t": t, **track})
    (line,) = plots.path(replay, "a").data
    assert list(line.x) == track["y"]
    assert list(line.y) == track["x"]
    drawn = plots.depth(replay, "a")
    assert list(drawn.data[0].y) == track["z"]
    assert drawn.layout.yaxis.autorange == "reversed"
