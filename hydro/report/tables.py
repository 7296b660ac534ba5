"""Metrics (tables of errors) in the form of the tables of Wu et al., for figures and for the terminal."""

from __future__ import annotations

import polars as pl

from hydro.core.columns import VELOCITY, WRENCH

PIECE_SUFFIX = r" ([\d.]+-[\d.]+ s)$"
"""Pattern of the end of the data set name for a piece of a recording."""


def replay_errors(metrics: pl.DataFrame) -> pl.DataFrame:
    """Return the errors of a replay as in Table III of Wu et al.: a row per variant, a column per velocity.

    Args:
        metrics: Metrics of one replay.

    Returns:
        Columns `variant` and the root mean square errors of u, v, w [m/s], p, q, r [rad/s]. If a replay
        diverged, its errors are null, and the column `diverged at` has the time [s].
    """
    metrics = metrics.filter(~of_a_piece())
    errors = _by_axis(metrics.filter(pl.col("metric") == "rmse"), "variant", VELOCITY)
    diverged = metrics.filter(pl.col("metric") == "diverged").select(
        "variant", pl.col("value").alias("diverged at")
    )
    table = (
        metrics.select("variant")
        .unique(maintain_order=True)
        .join(errors, on="variant", how="left", maintain_order="left")
    )
    return (
        table
        if diverged.is_empty()
        else table.join(diverged, on="variant", how="left", maintain_order="left")
    )


def piece_errors(metrics: pl.DataFrame) -> pl.DataFrame:
    """Return the errors of a replay by piece of the recording: one row per piece and variant.

    Args:
        metrics: Metrics of one replay that was measured by piece.

    Returns:
        Columns `piece`, such as `10-20 s`; `variant`; and the root mean square errors of u, v, w [m/s] and
        p, q, r [rad/s].
    """
    chosen = metrics.filter(
        of_a_piece(), pl.col("metric") == "rmse", pl.col("axis").is_in(VELOCITY)
    ).with_columns(piece=pl.col("dataset").str.extract(PIECE_SUFFIX))
    return chosen.pivot(
        on="axis",
        index=["piece", "variant"],
        values="value",
        aggregate_function="first",
        maintain_order=True,
    ).sort(pl.col("piece").str.extract(r"^([\d.]+)").cast(pl.Float64), maintain_order=True)


def of_a_piece() -> pl.Expr:
    """Return the polars expression that is true for rows measured on a piece of a recording."""
    return pl.col("dataset").str.contains(PIECE_SUFFIX)


def conditioning_shares(metrics: pl.DataFrame) -> pl.DataFrame:
    """Return how often the conditioning of a learned wrench acted, one row per variant with a network.

    Args:
        metrics: Metrics of one replay.

    Returns:
        Columns `variant`; the shares (0 to 1) of control steps in which `X`, `Y`, `Z`, `K`, `M`, `N` was
        clipped; and `dead band`, the share in which the dead band reduced the wrench.
    """
    clipped = _by_axis(metrics.filter(pl.col("metric") == "clipped"), "variant", WRENCH)
    held_back = metrics.filter(pl.col("metric") == "held_back").select(
        "variant", pl.col("value").alias("dead band")
    )
    return clipped.join(held_back, on="variant", how="left", maintain_order="left")


def prediction_errors(metrics: pl.DataFrame) -> pl.DataFrame:
    """Return the errors of models over all rows, as in Table II and Fig. 2 of Wu et al..

    Args:
        metrics: Metrics of predicted wrenches.

    Returns:
        One row per model with the columns `model`; the root mean square errors of `X`, `Y`, `Z` [N], `K`,
        `M`, `N` [N m]; the root mean square error `RMSE` over all rows and six axes without weights, with the
        ends `low` and `high` of its 95 % interval; the mean absolute error `MAE` over the same; and `R2`, the
        mean R^2 of the axes.
    """
    metrics = metrics.filter(pl.col("variant") == "")
    table = _by_axis(metrics.filter(pl.col("metric") == "rmse"), "model", WRENCH)
    overall = pl.col("axis") == "all"
    for metric, axis, columns in (
        ("rmse", overall, {"RMSE": "value", "low": "low", "high": "high"}),
        ("mae", overall, {"MAE": "value"}),
        ("r2", pl.col("axis") == "mean", {"R2": "value"}),
    ):
        chosen = metrics.filter(pl.col("metric") == metric, axis)
        table = table.join(
            chosen.select("model", **{name: pl.col(column) for name, column in columns.items()}),
            on="model",
            how="left",
            maintain_order="left",
        )
    return table


def regime_errors(metrics: pl.DataFrame) -> pl.DataFrame:
    """Return errors of predicted wrenches by regime of motion, one row per regime, one column per model.

    Args:
        metrics: Metrics of predicted wrenches, measured by regime.

    Returns:
        Columns `regime`, and for each model, named after it, the root mean square error over all six axes
        without weights.
    """
    chosen = metrics.filter(pl.col("variant") != "", pl.col("metric") == "rmse", pl.col("axis") == "all")
    table = chosen.pivot(
        on="model", index="variant", values="value", aggregate_function="first", maintain_order=True
    )
    return table.rename({"variant": "regime"})


def _by_axis(metrics: pl.DataFrame, row: str, axes: tuple[str, ...]) -> pl.DataFrame:
    """Return values with one row per `row` in order of appearance, and one column per available axis."""
    chosen = metrics.filter(pl.col("axis").is_in(axes))
    table = chosen.pivot(
        on="axis", index=row, values="value", aggregate_function="first", maintain_order=True
    )
    return table.select(row, *[axis for axis in axes if axis in table.columns])
