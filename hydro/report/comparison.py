"""Comparisons laid out for a person: errors by axis and horizon, and where a model fails, in words."""

from __future__ import annotations

import polars as pl

from hydro.core.columns import DOF, WRENCH

MOTIONS = dict(zip(WRENCH, DOF, strict=True)) | {"all": "all axes"}
"""What a pilot calls the axes of a wrench."""


def forces(comparison: pl.DataFrame) -> pl.DataFrame:
    """The wrench that the model leaves out, one row per axis, with its interval and the noise floor."""
    whole = comparison.filter(level="force", by="all")
    return whole.select(
        pl.col("axis").replace_strict(MOTIONS).alias("force on"),
        *(["before"] if "before" in whole.columns else []),
        "rmse",
        pl.col("low").alias("from"),
        pl.col("high").alias("to"),
        pl.col("noise_floor").alias("noise alone"),
        _percent(pl.col("share")).alias("share"),
        "unit",
    )


def predictions(comparison: pl.DataFrame) -> pl.DataFrame:
    """Errors of predictions, one row per axis and one column per horizon.

    With each error the one before, `2.1 -> 0.4`, or else in brackets the noise floor, `2.1 (0.01)`.
    """
    whole = comparison.filter(level="replay", by="all")
    now = pl.col("rmse").map_elements(_figure, pl.String)
    if "before" in whole.columns:
        text = pl.col("before").map_elements(_figure, pl.String) + " -> " + now
    else:
        text = now + " (" + pl.col("noise_floor").map_elements(_figure, pl.String) + ")"
    table = whole.select("axis", "unit").unique(maintain_order=True)
    for horizon in whole["horizon"].unique(maintain_order=True):
        name = "whole run" if horizon is None else f"{horizon:g} s"
        chosen = whole.filter(pl.col("horizon").eq_missing(horizon)).select("axis", text.alias(name))
        table = table.join(chosen, on="axis", how="left", maintain_order="left")
    return table.select("axis", *table.columns[2:], "unit")


def failures(comparison: pl.DataFrame) -> pl.DataFrame:
    """The places where the model fails, in the order of their rank."""
    return _placed(comparison, pl.col("rank").is_not_null()).sort("rank")


def former_failures(comparison: pl.DataFrame) -> pl.DataFrame:
    """The places of the earlier comparison that are not among those of this one."""
    return _placed(comparison, pl.col("rank").is_null() & (pl.col("by") == "place")).drop("rank")


def headline(comparison: pl.DataFrame) -> str:
    """The whole comparison in one sentence."""
    ranked = failures(comparison)
    if ranked.is_empty():
        return "Noise explains all of the error."
    place, share, time = ranked.select("place", "error", "time").row(0)
    return f"{place[:1].upper()}{place[1:]}: {share} of the unexplained error in {time} of the time."


def _placed(comparison: pl.DataFrame, chosen: pl.Expr) -> pl.DataFrame:
    """Rows of places, with words that say the axis too."""
    rows = comparison.filter(level="force", by="all")["rows"].max()
    words = pl.concat_str(pl.col("axis").replace_strict(MOTIONS), pl.col("place"), separator=" ")
    return comparison.filter(chosen).select(
        "rank",
        _percent(pl.col("share")).alias("error"),
        _percent(pl.col("rows") / rows).alias("time"),
        *(["before"] if "before" in comparison.columns else []),
        "rmse",
        "unit",
        words.alias("place"),
    )


def _percent(share: pl.Expr) -> pl.Expr:
    """A share as text: `41 %`, `0.6 %`."""
    whole = (100.0 * share).round().cast(pl.Int64).cast(pl.String)
    small = (100.0 * share).round(1).cast(pl.String)
    return pl.when(share >= 0.01).then(whole).otherwise(small) + " %"


def _figure(value: float) -> str:
    """Two significant figures: four columns of pairs have to stand side by side."""
    if value >= 10.0:
        return f"{value:.0f}"
    return f"{value:#.2g}" if value >= 1e-4 else f"{value:.1g}"
