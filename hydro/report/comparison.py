"""Comparisons as text and tables: errors by axis and horizon, and the regimes with the largest errors."""

from __future__ import annotations

from collections.abc import Iterator

import polars as pl

from hydro.core.columns import DOF, POSE, VELOCITY, WRENCH
from hydro.core.effects.wording import capital
from hydro.core.evaluation.failure_regimes import ELSEWHERE, THROUGHOUT
from hydro.core.evaluation.yardsticks import JUDGED, LEAST_SQUARES, LEVEL, ZERO
from hydro.report import change, words, yardsticks
from hydro.report.following import Call
from hydro.report.screen import EMPTY, Following, Text, laid, table

MOTIONS = dict(zip(WRENCH, DOF, strict=True)) | {"all": "all axes"}
"""Names of motion for the axes of a wrench."""
WORST = 3
"""Number of regimes of motion that an answer names."""
MISSING, CHANGED = "Find what is missing:", "Find what has changed:"
"""Labels of the next command."""
DIAGNOSED = ("--against",)
"""Options of `hydro compare` that `hydro diagnose` does not have."""


def answer(comparison: pl.DataFrame, call: Call, width: int, learned: str = "") -> list[Text]:
    """Return a comparison as lines of a terminal: headline, table of errors, and the worst regimes of motion.

    Args:
        comparison: Comparison table.
        call: The command.
        width: Columns of the terminal.
        learned: Sentences on the hull-force model of a recording before a change; empty without one.
    """
    changed = not change.errors(comparison).is_empty()
    lines = [Text(headline(comparison), bold=True), EMPTY]
    if changed:
        lines += [*change.table_of(comparison), Text(learned)]
    else:
        lines += ahead(comparison)
        lines += [
            Text(one) for one in filter(None, [yardsticks.sentence(yardsticks.of_comparison(comparison))])
        ]
        lines += worst(comparison)
    if changed or not within_noise(comparison):
        again = call.again("diagnose", "-o", "diagnosis.parquet", without=DIAGNOSED)
        lines += [EMPTY, *Following(CHANGED if changed else MISSING, again).lines(width)]
    return laid(lines, width)


def judged(comparison: pl.DataFrame) -> pl.DataFrame:
    """Return the errors of predictions 5 s ahead (JUDGED), or else at the longest horizon, one row per axis.

    Args:
        comparison: Comparison table.

    Returns:
        `axis`, `unit`, `horizon` [s] (null: whole sessions), `error`, `noise floor`, and, if they are known,
        `before` (error of an earlier comparison) and the errors of the predictors `least squares` and `zero
        velocity`. Axes are u v w p q r and all; without velocities they are x y z phi theta psi and pose.
    """
    replayed = comparison.filter(level="replay", by="all")
    axes = (*VELOCITY, "all") if "all" in replayed["axis"] else (*POSE, "pose")
    replayed = replayed.filter(pl.col("axis").is_in(axes))
    horizons = replayed["horizon"].unique().to_list()
    known = [one for one in horizons if one is not None and one <= JUDGED]
    horizon = max(known, default=None)
    shown = replayed.filter(pl.col("horizon").eq_missing(horizon)).select(
        "axis",
        "unit",
        "horizon",
        *([pl.col("before")] if "before" in replayed.columns else []),
        pl.col("rmse").alias("error"),
        pl.col("noise_floor").alias("noise floor"),
    )
    for name in (LEAST_SQUARES, ZERO):
        simple = comparison.filter(pl.col("horizon").eq_missing(horizon), level=LEVEL, by=name)
        if not simple.is_empty():
            columns = simple.select("axis", pl.col("rmse").alias(name))
            shown = shown.join(columns, on="axis", how="left", maintain_order="left")
    return shown


def ahead(comparison: pl.DataFrame) -> Iterator[Text]:
    """Yield the lines of a table for a terminal: prediction errors, one line per axis.

    Args:
        comparison: Comparison table.
    """
    shown = judged(comparison)
    if shown.is_empty():
        return
    columns = [name for name in shown.columns if name not in ("axis", "unit", "horizon")]
    header = [f"Error {words.horizon(shown['horizon'][0])}", *columns]
    yield from table(
        header,
        (
            [f"  {row['axis']} [{row['unit']}]", *(words.figure(row[name]) for name in columns)]
            for row in shown.iter_rows(named=True)
        ),
    )


def worst(comparison: pl.DataFrame) -> Iterator[Text]:
    """Yield one paragraph for each regime of motion with most of the error above the noise floor.

    Args:
        comparison: Comparison table.
    """
    if within_noise(comparison):
        return
    yield EMPTY
    yield Text("Where it fails most (share of the squared force error above the noise floor):", bold=True)
    for place, share, ratio in failures(comparison).head(WORST).select("place", "error", "ratio").rows():
        yield Text(f"{capital(place)}: {share}{relative(ratio)}.", indent=2)


def relative(ratio: float | None) -> str:
    """Return an error in a regime as words, `; 2.1 times the average of this axis`; empty for None.

    Args:
        ratio: Error in the regime, divided by the error of the axis over all motion.
    """
    return "" if ratio is None else f"; {ratio:.1f} times the average of this axis"


def forces(comparison: pl.DataFrame) -> pl.DataFrame:
    """Return the residual forces of a comparison (forces that the model does not explain), one row per axis.

    Args:
        comparison: Comparison table.

    Returns:
        Columns `force on` (the axis in words), `rmse` with its 95 % interval `from` to `to`, `noise floor`,
        `share` of all unexplained squared error, `unit`, and `before`, the error of an earlier comparison, if
        it is known.
    """
    whole = comparison.filter(level="force", by="all")
    return whole.select(
        pl.col("axis").replace_strict(MOTIONS).alias("force on"),
        *(["before"] if "before" in whole.columns else []),
        "rmse",
        pl.col("low").alias("from"),
        pl.col("high").alias("to"),
        pl.col("noise_floor").alias("noise floor"),
        _percent(pl.col("share")).alias("share"),
        "unit",
    )


def predictions(comparison: pl.DataFrame) -> pl.DataFrame:
    """Return a table of prediction errors as text, one row per axis and one column per horizon.

    A cell has the errors before and after the change of the file, `2.1 -> 0.4`, or the error with the noise
    floor, `2.1 (0.01)`.  The first column is `axis`, the last `unit`.

    Args:
        comparison: Comparison table.
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
    """Return the worst regimes of motion of a comparison as a table, the largest share of the error first.

    Args:
        comparison: Comparison table.
    """
    return _placed(comparison, pl.col("rank").is_not_null()).sort("rank")


def former_failures(comparison: pl.DataFrame) -> pl.DataFrame:
    """Return a table of regimes that were among the worst in the earlier comparison and no longer are.

    Args:
        comparison: Comparison table made with an earlier comparison.
    """
    return _placed(comparison, pl.col("rank").is_null() & (pl.col("by") == "place")).drop("rank")


def within_noise(comparison: pl.DataFrame) -> bool:
    """Return whether noise explains the error: no regime is ranked, or the error is below the noise floor."""
    shown = judged(comparison)
    below = not shown.is_empty() and shown["error"][-1] <= shown["noise floor"][-1]
    return below or failures(comparison).is_empty()


def headline(comparison: pl.DataFrame) -> str:
    """Return a sentence on the prediction error and its noise floor, and whether noise explains the error."""
    if told := change.summary(comparison):
        return told
    shown, exact = judged(comparison), within_noise(comparison)
    if shown.is_empty():
        return "The model predicts this log to within its noise." if exact else worst_place(comparison)
    row = shown.row(-1, named=True)
    far = "Over whole sessions" if row["horizon"] is None else capital(words.horizon(row["horizon"]))
    error, floor = (f"{words.figure(row[name])} {row['unit']}" for name in ("error", "noise floor"))
    told = f"{far} the error of the model is {error}; the noise floor is {floor}."
    return f"The model predicts this log to within its noise. {told}" if exact else told


def worst_place(comparison: pl.DataFrame) -> str:
    """Return a sentence on the regime with the largest share of the error; empty where none is ranked."""
    ranked = failures(comparison)
    if ranked.is_empty():
        return ""
    place, share, ratio = ranked.select("place", "error", "ratio").row(0)
    return f"{capital(place)}: {share} of the unexplained squared error{relative(ratio)}."


def _placed(comparison: pl.DataFrame, chosen: pl.Expr) -> pl.DataFrame:
    """Return the rows of regimes of motion that `chosen` selects, with the axis in their description.

    The column `time` is the share of the axis' samples.  The column `ratio` is the error relative to the
    error of the same axis in all motion; null for a regime that is not a kind of motion.
    """
    whole = comparison.filter(level="force", by="all")
    samples, average = (
        pl.col("axis").replace_strict(whole["axis"], whole[name], default=None) for name in ("rows", "rmse")
    )
    special = pl.col("place").is_in([ELSEWHERE, THROUGHOUT]).not_()
    words = pl.concat_str(pl.col("axis").replace_strict(MOTIONS), pl.col("place"), separator=" ")
    return comparison.filter(chosen).select(
        "rank",
        _percent(pl.col("share")).alias("error"),
        _percent(pl.col("rows") / samples).alias("time"),
        *(["before"] if "before" in comparison.columns else []),
        "rmse",
        pl.when(special).then((pl.col("rmse") / average).round(2)).alias("ratio"),
        "unit",
        words.alias("place"),
    )


def _percent(share: pl.Expr) -> pl.Expr:
    """Return a share as text: `41 %`, `0.6 %`."""
    whole = (100.0 * share).round().cast(pl.Int64).cast(pl.String)
    small = (100.0 * share).round(1).cast(pl.String)
    return pl.when(share >= 0.01).then(whole).otherwise(small) + " %"


def _figure(value: float) -> str:
    """Return a number with two significant figures, so that pairs of numbers fit into four columns."""
    if value >= 10.0:
        return f"{value:.0f}"
    return f"{value:#.2g}" if value >= 1e-4 else f"{value:.1g}"
