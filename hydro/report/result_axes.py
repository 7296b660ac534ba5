"""Plots of results of the Python functions, in Matplotlib axes of a new figure or of the user."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.errors import UsageError
from hydro.core.interval import NORMAL_95
from hydro.report import words
from hydro.report.figures import STYLE, error_bars
from hydro.report.ladder import by_dataset
from hydro.report.plots import DATASET_STYLES, FOUND, GIVEN, HELD_OUT, NOISE, wide

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes

    from hydro.core.diagnosis.findings import Prediction

WIDTH = 9.0
"""Width of a figure [inch]; notebooks show it without scaling."""
ROTATION = ("p", "q", "r", "phi", "theta", "psi")
"""Axes with radians in their unit."""
SYMBOLS = {"circle": "o", "diamond": "D"}
"""Matplotlib's marks for the marks of `DATASET_STYLES`."""
MARKS = {
    "before": ("model before", "o", GIVEN),
    "zero_velocity": ("zero velocity", "s", NOISE),
    "least_squares": ("least squares", "D", HELD_OUT),
    "error": ("model", "o", FOUND),
    "noise_floor": ("noise floor", "_", "black"),
}
"""Label, mark and colour of each error of a comparison."""
MARK: Any = {"linestyle": "", "markersize": 8, "markeredgewidth": 2, "fillstyle": "none"}
"""Style of hollow marks, which do not hide each other."""


def panels(
    given: Axes | Sequence[Axes] | None, count: int, height: float, heights: Sequence[float] = (1.0,)
) -> NDArray[np.object_]:
    """Return the Matplotlib axes to draw into, (count,): the user's, or those of a new figure.

    Args:
        given: Axes of the user; None for a new figure.
        count: Number of axes that are needed.
        height: Height of a new figure [inch].
        heights: Relative heights of the rows of a new figure.

    Raises:
        UsageError: The number of given axes is wrong.
    """
    if given is None:
        import matplotlib as mpl
        from matplotlib import pyplot

        with mpl.rc_context(STYLE):
            _, made = pyplot.subplots(
                len(heights),
                count // len(heights),
                figsize=(WIDTH, height),
                height_ratios=heights,
                layout="constrained",
                squeeze=False,
            )
        return np.asarray(made, object).ravel()
    found = np.atleast_1d(np.asarray(given, object)).ravel()
    if len(found) != count:
        raise UsageError(f"plot draws into {count} axes, but {len(found)} were given")
    return found


def draw_prediction(panel: Axes, prediction: Prediction) -> None:
    """Draw the error of predictions as given and with the findings added, and the noise floor, as bars.

    Args:
        panel: Axes to draw into.
        prediction: Errors before and after the findings are added [m/s].
    """
    bars = {"as given": (prediction.given, GIVEN)}
    if prediction.added != prediction.given:
        bars["with the findings,\nheld out"] = (prediction.added, FOUND)
    errors, colours = zip(*bars.values(), strict=True)
    drawn = panel.barh(range(len(bars)), errors, color=colours, height=0.55)
    panel.bar_label(drawn, [words.figure(one) for one in errors], padding=4)
    if prediction.floor is not None:
        panel.axvline(prediction.floor, color=NOISE, linestyle="--", label="noise floor")
        panel.legend(loc="lower right", frameon=False)
    panel.set_yticks(range(len(bars)), list(bars))
    panel.set_ylim(len(bars) - 0.3, -0.7)
    panel.set_xlim(0.0, 1.25 * max(*errors, prediction.floor or 0.0))
    panel.set_xlabel(f"error {prediction.horizon:g} s ahead [m/s]")
    panel.set_title("Predictions")


def draw_findings(panel: Axes, diagnosis: pl.DataFrame, *, changed: bool) -> None:
    """Draw the share of the error that each finding explains, with its 95 % interval.

    Args:
        panel: Axes to draw into.
        diagnosis: Diagnosis table.
        changed: Whether the findings are changes since a recording before.
    """
    panel.set_xlabel("explained error [%], 95 % interval")
    panel.set_title("What has changed" if changed else "What is missing")
    panel.set_xlim(-3.0, 103.0)
    rows = diagnosis.filter(pl.col("share_of_error_explained").is_not_null()).sort("rank")
    if rows.is_empty():
        _say(panel, "no finding explains a part of the squared error")
        return
    down, up = error_bars(rows, "share_of_error_explained", "share_")
    panel.errorbar(
        100.0 * rows["share_of_error_explained"],
        range(rows.height),
        xerr=[100.0 * down, 100.0 * up],
        fmt="o",
        color=FOUND,
        markersize=7,
        linewidth=2,
    )
    panel.set_yticks(range(rows.height), [_finding(row, changed) for row in rows.iter_rows(named=True)])
    panel.set_ylim(rows.height - 0.5, -0.5)


def draw_errors_ahead(
    given: Axes | Sequence[Axes] | None, errors: pl.DataFrame, horizon: float | None
) -> NDArray[np.object_]:
    """Draw prediction errors into two panels: axes of translation in the first, of rotation in the second.

    Args:
        given: Two axes to draw into; None for a new figure.
        errors: `axis`, `error`, `noise_floor`, `least_squares`, `zero_velocity`, `unit`, and `before` of an
            earlier comparison.
        horizon: Horizon of the predictions [s]; None for whole sessions.

    Returns:
        The axes, (2,).
    """
    axes = panels(given, 2, height=3.6)
    turning = pl.col("axis").is_in(ROTATION)
    for panel, rows, title in (
        (axes[0], errors.filter(~turning), "Translation"),
        (axes[1], errors.filter(turning), "Rotation"),
    ):
        marks = {name: mark for name, mark in MARKS.items() if name in rows and rows[name].count()}
        for name, (label, mark, colour) in marks.items():
            panel.plot(range(rows.height), rows[name].to_list(), mark, color=colour, label=label, **MARK)
        panel.set_title(title)
        panel.set_xticks(range(rows.height), rows["axis"].to_list())
        panel.set_xlim(-0.5, rows.height - 0.5)
        panel.set_xlabel("axis")
        panel.set_ylabel(f"error, {words.horizon(horizon)} [{rows['unit'][0]}]")
        if wide(pl.concat([rows[name].drop_nulls() for name in marks])):
            _logarithmic(panel)
        else:
            panel.set_ylim(bottom=0.0)
    if given is None:
        handles, labels = axes[0].get_legend_handles_labels()
        axes[0].figure.legend(handles, labels, loc="outside lower center", ncols=len(MARKS), frameon=False)
    else:
        axes[1].legend(frameon=False)
    return axes


def draw_ladder(panel: Axes, rows: pl.DataFrame) -> None:
    """Draw the prediction error of each step of a study, with its 95 % interval and its noise floor.

    Args:
        panel: Axes to draw into.
        rows: Rows of the ladder table of one axis and horizon.
    """
    for name, label, one in by_dataset(rows):
        (colour, symbol, dash), spread = DATASET_STYLES[name], error_bars(one, "rmse")
        panel.errorbar(
            one["step"],
            one["rmse"],
            yerr=spread,
            fmt=f"{SYMBOLS[symbol]}-",
            color=colour,
            label=label,
            capsize=3,
        )
        style = {"dot": ":", "dash": "--"}[dash]
        panel.plot(one["step"], one["noise_floor"], style, color=NOISE, label=f"noise floor, {label}")
    steps = rows.unique("step", maintain_order=True).sort("step")
    names = [
        f"{k}: {words.effects_named(added) or 'as given'}" for k, added in steps["step", "effect"].rows()
    ]
    panel.set_xticks(steps["step"].to_list(), names)
    panel.set_xlim(steps["step"][0] - 0.3, steps["step"][-1] + 0.3)
    if wide(rows["rmse"]):
        _logarithmic(panel)
    else:
        panel.set_ylim(bottom=0.0)
    panel.set_xlabel("step, and what it added")
    panel.set_ylabel(f"error, {words.horizon(rows['horizon'][0])} [{rows['unit'][0]}]")
    panel.legend(frameon=False)


def draw_parameters(given: Axes | Sequence[Axes] | None, table: pl.DataFrame) -> NDArray[np.object_]:
    """Draw fitted values with 95 % intervals, one panel for each unit.

    Args:
        given: Axes to draw into, one for each unit; None for a new figure.
        table: Columns `parameter`, `value`, `standard_error`, `unit`, `determined`.

    Returns:
        The axes, one for each unit, in the order of the table, (n,).
    """
    groups = table.partition_by("unit", maintain_order=True)
    heights = [1.0 + one.height for one in groups]
    axes = panels(given, len(groups), height=1.0 + 0.35 * sum(heights), heights=heights)
    for panel, rows in zip(axes, groups, strict=True):
        places = np.arange(rows.height)
        known = rows["determined"].to_numpy()
        values, spread = rows["value"].to_numpy(), NORMAL_95 * rows["standard_error"].to_numpy()
        for chosen, fill, label in ((known, FOUND, ""), (~known, "white", "not determined")):
            if chosen.any():
                panel.errorbar(
                    values[chosen],
                    places[chosen],
                    xerr=spread[chosen],
                    fmt="o",
                    color=FOUND,
                    markerfacecolor=fill,
                    label=label,
                )
        panel.axvline(0.0, color=NOISE, linestyle=":")
        panel.set_yticks(places, rows["parameter"].to_list())
        panel.set_ylim(rows.height - 0.5, -0.5)
        unit = rows["unit"][0]
        panel.set_xlabel("value, 95 % interval" if unit == "1" else f"value [{unit}], 95 % interval")
        if (~known).any():
            panel.legend(frameon=False)
    return axes


def _logarithmic(panel: Axes) -> None:
    """Make the vertical axis logarithmic, with numbers at 1, 2 and 5 in each decade."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    panel.set_yscale("log")
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    panel.yaxis.set_minor_formatter(NullFormatter())


def _finding(row: dict[str, object], changed: bool) -> str:
    """Return the label of a finding: its verdict and its effect."""
    label = words.verdict(row, changed)[0].lower()
    effect = words.effect_name(str(row["effect"]))
    return f"{label}:\n{effect}" if effect else label


def _say(panel: Axes, sentence: str) -> None:
    """Write a sentence into a panel in which there is nothing to draw."""
    panel.set_yticks([])
    panel.text(0.5, 0.5, sentence, transform=panel.transAxes, ha="center", va="center")


def time_lines(table: pl.DataFrame, axes: Axes | Sequence[Axes] | None = None) -> NDArray[np.object_]:
    """Draw the estimates of each parameter of a history over the dives, with 95 % intervals and levels.

    Args:
        table: History table.
        axes: Axes to draw into, one per parameter; None for a new figure.

    Returns:
        The axes, one per parameter, (n,).
    """
    names = table["parameter"].unique(maintain_order=True).to_list()
    drawn = panels(axes, len(names), 1.6 * max(len(names), 1), (1.0,) * max(len(names), 1))
    for panel, name in zip(drawn, names, strict=True):
        rows = table.filter(pl.col("parameter") == name)
        number = rows["number"].to_numpy()
        half = NORMAL_95 * rows["standard_error"].to_numpy()
        panel.errorbar(number, rows["value"].to_numpy(), half, linestyle="", marker="o", color=FOUND)
        panel.plot(number, rows["level"].to_numpy(), color=GIVEN, drawstyle="steps-mid")
        panel.set(ylabel=f"{name} [{rows['unit'][0]}]")
    for panel in drawn[-1:]:
        panel.set(xlabel="dive")
    return drawn
