"""The regime with the largest share of the error, in a sentence."""

from __future__ import annotations

import polars as pl

from hydro.report.comparison import worst_place

ROWS = pl.DataFrame(
    {
        "level": ["force"] * 2,
        "by": ["all", "place"],
        "axis": ["X", "X"],
        "place": ["", "at high speed"],
        "rank": [None, 1],
        "rows": [100, 25],
        "share": [1.0, 0.6],
        "rmse": [2.0, 3.0],
        "unit": ["N", "N"],
    }
)


def test_the_ranked_regime_is_named_with_its_share() -> None:
    assert worst_place(ROWS).endswith(
        "at high speed: 60 % of the unexplained squared error; 1.5 times the average of this axis."
    )


def test_a_table_without_a_ranked_regime_says_nothing() -> None:
    assert worst_place(ROWS.with_columns(rank=pl.lit(None, pl.Int64))) == ""
