"""Figures of a report as PNG files, for a paper or a slide."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from hydro.core.columns import UNITS, VELOCITY
from hydro.io.files import explained
from hydro.report import figures, words
from hydro.report.comparison import MOTIONS
from hydro.report.ladder import by_dataset
from hydro.report.plots import DATASET_STYLES, FOUND, GIVEN, NOISE, wide
from hydro.report.sources import Sources
from hydro.report.standing import at_horizon
from hydro.report.tables import replay_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw(sources: Sources, folder: Path) -> list[Path]:
    """Write a PNG file for each available table: worst regimes, findings, ladder, replays and errors.

    Args:
        sources: Artefacts of the report.
        folder: Output folder, which is made if necessary.

    Returns:
        Paths of the files, in the order of the page.

    Raises:
        DataError: The files cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        written = []
        for name, drawn in _all(sources):
            figures.save(drawn, folder / f"{name}.png")
            written.append(folder / f"{name}.png")
        return written
    except OSError as error:
        raise explained(str(folder), error) from error


def _all(sources: Sources) -> Iterator[tuple[str, Figure]]:
    """Yield the name and the figure of every picture."""
    if sources.comparisons:
        yield "places", draw_places(sources.comparisons[0].frame)
    if (
        sources.diagnoses
        and (frame := sources.diagnoses[0].frame)["share_of_error_explained"].is_not_null().any()
    ):
        yield "findings", draw_findings(frame)
    if sources.ladder is not None:
        yield "ladder", draw_ladder(sources.ladder.frame)
    for number, one in enumerate(sources.replays):
        suffix = f"-{number + 1}" if number else ""
        yield f"replay{suffix}", figures.draw_overlay(figures.overlay_table(one.frame))
    for number, one in enumerate(sources.metrics):
        errors = replay_errors(one.frame)
        if set(VELOCITY) & set(errors.columns):
            yield f"errors-{number + 1}" if number else "errors", figures.draw_errors(errors)


def draw_places(comparison: pl.DataFrame) -> Figure:
    """Return a figure with a bar for each of the worst regimes: its share of the unexplained error.

    Args:
        comparison: Comparison table.
    """
    rows = comparison.filter(pl.col("rank").is_not_null()).sort("rank")
    names = [f"{MOTIONS[axis]} {place}" for axis, place in rows.select("axis", "place").rows()]

    def paint(panel: Axes) -> None:
        bars = panel.barh(range(len(names)), (100.0 * rows["share"]).to_list(), color=GIVEN, height=0.6)
        panel.bar_label(bars, [words.percent(share) for share in rows["share"]], padding=4)
        panel.set_yticks(range(len(names)), names)
        panel.set_xlabel("share of the unexplained error [%]")

    return _listed(paint, len(names), "Where the model fails")


def draw_findings(diagnosis: pl.DataFrame) -> Figure:
    """Return a figure with the share of the error that every finding explains, with its 95 % interval.

    Args:
        diagnosis: Diagnosis table.
    """
    rows = diagnosis.filter(pl.col("share_of_error_explained").is_not_null()).sort("rank")
    names = [
        f"{words.verdict(row)[0].lower()}: {words.effect_name(row['effect'])}" for row in rows.to_dicts()
    ]

    def paint(panel: Axes) -> None:
        spread = figures.error_bars(rows, "share_of_error_explained", "share_")
        panel.errorbar(
            100.0 * rows["share_of_error_explained"],
            range(len(names)),
            xerr=[100.0 * side for side in spread],
            fmt="o",
            color=FOUND,
            markersize=7,
            linewidth=2,
        )
        panel.set_yticks(range(len(names)), [name.removesuffix(": ") for name in names])
        panel.set_xlim(0.0, 100.0)
        panel.set_xlabel("share of the squared error explained [%], 95 % interval")

    return _listed(paint, len(names), "What is missing")


def draw_ladder(ladder: pl.DataFrame) -> Figure:
    """Return a figure with the error of every axis at each step of a study, with noise floors, by data set.

    Args:
        ladder: Ladder table.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    rows = at_horizon(ladder)
    far = wide(rows.filter(axis="all")["rmse"])
    with mpl.rc_context(figures.STYLE):
        drawn = Figure(figsize=(11.2, 5.4), layout="constrained")
        for panel, axis in zip(drawn.subplots(2, 3, sharex=True).ravel(), VELOCITY, strict=True):
            _draw_rungs(panel, rows.filter(axis=axis), axis)
            if far:
                panel.set_yscale("log")
            else:
                panel.set_ylim(bottom=0.0)
        handles, labels = drawn.axes[0].get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
        for panel in drawn.axes[-3:]:
            panel.set_xlabel("step")
    return drawn


def _draw_rungs(panel: Axes, rows: pl.DataFrame, axis: str) -> None:
    """Draw the errors of one axis after each step into a panel."""
    for name, label, one in by_dataset(rows):
        (colour, _, dash), spread = DATASET_STYLES[name], figures.error_bars(one, "rmse")
        panel.errorbar(one["step"], one["rmse"], yerr=spread, fmt="o-", color=colour, label=label, capsize=3)
        style = {"dot": ":", "dash": "--"}[dash]
        panel.plot(one["step"], one["noise_floor"], style, color=NOISE, label=f"noise floor, {label}")
    panel.set_xticks(rows["step"].unique().sort().to_list())
    panel.set_title(f"{figures.TITLES[axis]} {axis} [{UNITS[axis]}]")


def _listed(paint: Callable[[Axes], None], count: int, title: str) -> Figure:
    """Return a figure of one panel with a row for each of `count` items, the first on top.

    Args:
        paint: Function that draws into the panel.
        count: Number of items.
        title: Title of the figure.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(figures.STYLE | {"axes.grid.axis": "x"}):
        drawn = Figure(figsize=(9.0, 1.3 + 0.42 * max(count, 1)), layout="constrained")
        panel = drawn.subplots()
        paint(panel)
        panel.invert_yaxis()
        panel.margins(x=0.12)
        panel.tick_params(axis="y", length=0)
        panel.set_title(title)
    return drawn
