"""Results over networks of several seeds: means with their spread, and tests of comparisons."""

from __future__ import annotations

import math

import polars as pl

from hydro.core.columns import VELOCITY, WRENCH
from hydro.core.evaluation.metrics import Subject, rows_of
from hydro.io.table import conform
from hydro.report.ranking import agreement, no_better
from hydro.report.tables import of_a_piece


def seeds_together(errors: pl.DataFrame) -> pl.DataFrame:
    """Return a new metrics table with the mean error over the networks (seeds) of every model.

    Args:
        errors: Metrics of several networks, with a column `run` that names the network of its model.

    Returns:
        Per model, axis and metric the mean as `value`, and the smallest and largest value over networks as
        `low` and `high`; for a model with one network, the rows and intervals of that network.
    """
    about = ["model", "variant", "dataset", "axis", "metric", "unit"]
    runs = pl.len() > 1
    return (
        errors.group_by(about, maintain_order=True)
        .agg(
            pl.col("value").mean(),
            low=pl.when(runs).then(pl.col("value").min()).otherwise(pl.col("low").first()),
            high=pl.when(runs).then(pl.col("value").max()).otherwise(pl.col("high").first()),
        )
        .select("model", "variant", "dataset", "axis", "metric", "value", "low", "high", "unit")
    )


def ranking(predicted: pl.DataFrame, replayed: pl.DataFrame) -> pl.DataFrame:
    """Return the agreement of two rankings of models: by the predicted wrench and by the replayed velocity.

    Args:
        predicted: Metrics of predicted wrenches of several networks, with a column `run`.
        replayed: Metrics of their replays, with the same column. A network whose replay diverged has no
            error; it and its model then rank last.

    Returns:
        A metrics table: `kendall_tau`, Kendall's tau over models with its 95 % interval `low` to `high`, and
        `kendall_p`, the p-value of no relation. They are computed from errors over all six axes, and by axis
        (surge force against surge velocity, and so on). Empty for fewer than three models.
    """
    rows: list[tuple[str, str, float, float, float, str]] = []
    for wrench, velocity in (("all", "all"), *zip(WRENCH, VELOCITY, strict=True)):
        offline = _networks(predicted.filter(pl.col("variant") == ""), wrench)
        flown = _networks(replayed.filter(~of_a_piece()), velocity)
        both = offline.join(flown, on=["model", "run"], how="left", suffix="_flown", maintain_order="left")
        groups = [
            group.select("value", pl.col("value_flown").fill_null(float("inf"))).to_numpy().T
            for _, group in both.group_by("model", maintain_order=True)
        ]
        if len(groups) < 3:
            continue
        found = agreement([group[0] for group in groups], [group[1] for group in groups])
        rows.append((velocity, "kendall_tau", found.tau, found.low, found.high, "1"))
        rows.append((velocity, "kendall_p", found.p_value, math.nan, math.nan, "1"))
    known = [row for row in rows if math.isfinite(row[2])]
    return conform("metrics", rows_of(Subject("all", "study"), known))


def by_minutes(errors: pl.DataFrame) -> pl.DataFrame:
    """Return a copy of a metrics table with the minutes of training data in the models' names: `mlp, 3 min`.

    Args:
        errors: Metrics with a column `minutes`.
    """
    length = pl.format(", {} min", pl.col("minutes").map_elements("{:g}".format, return_dtype=pl.String))
    return errors.with_columns(model=pl.col("model") + length)


def behind_the_best(replayed: pl.DataFrame) -> pl.DataFrame:
    """Return p-values that models replay no worse than the best model, for every length of training data.

    Args:
        replayed: Metrics of replays of several networks, with the columns `run` and `minutes`.

    Returns:
        A metrics table: `behind_p`, the one-sided p-value of an exact rank-sum test over seeds that a model's
        errors over all six velocities are no larger than those of the model with the least mean.
    """
    rows = []
    for (share,), some in replayed.group_by("minutes", maintain_order=True):
        networks = some.select("model", "run").unique(maintain_order=True)
        flown = _networks(some.filter(~of_a_piece()), "all")
        known = networks.join(flown, on=["model", "run"], how="left", maintain_order="left")
        errors = {
            str(model): group["value"].fill_null(float("inf")).to_numpy()
            for (model,), group in known.group_by("model", maintain_order=True)
        }
        best = errors.pop(min(errors, key=lambda model: float(errors[model].mean())))
        rows += [(f"{model}, {share:g} min", no_better(one, best)) for model, one in errors.items()]
    found = [
        rows_of(Subject(name, "study"), [("all", "behind_p", p, math.nan, math.nan, "1")]) for name, p in rows
    ]
    return conform("metrics", pl.concat(found) if found else pl.DataFrame())


def ranking_table(metrics: pl.DataFrame) -> pl.DataFrame:
    """Return a new table of Kendall's tau between two rankings of the models, one row per axis.

    Args:
        metrics: Result of `ranking`.

    Returns:
        Columns `axis`, `tau`, `low` and `high` (95 % interval), and `p`, the p-value of no relation.
    """
    taus = metrics.filter(pl.col("metric") == "kendall_tau").select("axis", "low", "high", tau="value")
    chances = metrics.filter(pl.col("metric") == "kendall_p").select("axis", p="value")
    both = taus.join(chances, on="axis", how="left", maintain_order="left")
    return both.select("axis", "tau", "low", "high", "p")


def minutes_table(metrics: pl.DataFrame) -> pl.DataFrame:
    """Return errors by length of the training data, one row per length and model.

    Args:
        metrics: Errors of predicted wrenches and of replays, with models named by `by_minutes`, and
            `behind_p`.

    Returns:
        Columns `minutes`, `model`; `wrench` [N, N m] and `replay` [m/s, rad/s], the root mean square errors
        over all six axes of the wrench and of the replayed velocities, each with its smallest and largest
        value over seeds (`_low`, `_high`); and `p`, the one-sided p-value that the model replays no worse
        than the best.
    """
    of_all = metrics.filter(pl.col("axis") == "all", ~of_a_piece())
    errors = of_all.filter(pl.col("metric") == "rmse")
    offline = errors.filter(pl.col("variant") == "")
    flown = errors.filter(pl.col("variant") != "")
    table = offline.select("model", wrench="value", wrench_low="low", wrench_high="high")
    for more in (
        flown.select("model", replay="value", replay_low="low", replay_high="high"),
        of_all.filter(pl.col("metric") == "behind_p").select("model", p="value"),
    ):
        table = table.join(more, on="model", how="left", maintain_order="left")
    named = pl.col("model").str.extract_groups(r"^(?<model>.*), (?<minutes>[\d.e+-]+) min$")
    return (
        table.with_columns(named.struct.field("model"), named.struct.field("minutes").cast(pl.Float64))
        .select("minutes", "model", *table.columns[1:])
        .sort("minutes", maintain_order=True)
    )


def conditioning_table(metrics: pl.DataFrame) -> pl.DataFrame:
    """Return errors of replays by kind of conditioning (filter and limits of a network's wrench), as a table.

    Args:
        metrics: Errors of replays whose dataset is the kind, such as `off` or `paper-old`.

    Returns:
        One row per variant.  Columns `variant`, and for each kind, named after it, the root mean square error
        over all six velocities [m/s, rad/s]; null if the replay diverged.
    """
    rows = metrics.filter(pl.col("axis") == "all", pl.col("metric").is_in(["rmse", "diverged"]))
    return rows.with_columns(value=pl.when(pl.col("metric") == "rmse").then("value")).pivot(
        on="dataset", index="variant", values="value", aggregate_function="first", maintain_order=True
    )


def _networks(errors: pl.DataFrame, axis: str) -> pl.DataFrame:
    """Return `model`, `run` and the root mean square error of every network on an axis."""
    chosen = errors.filter(pl.col("metric") == "rmse", pl.col("axis") == axis)
    return chosen.select("model", "run", "value")
