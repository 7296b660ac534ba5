"""Figures of trainings: learning curves over seeds (Fig. 6 of Wu et al.), and paths of flights (Fig. 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from hydro.core.columns import Array
from hydro.io.files import explained
from hydro.report import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURES = {"reward": "mean reward of an evaluation", "success": "share of an evaluation that arrived"}


def curves_table(evaluations: pl.DataFrame) -> pl.DataFrame:
    """Return mean and spread over seeds of the learning curves, one row per condition and step.

    A training that has ended keeps its last value, so that seeds which finish the curriculum early stay in
    the mean.

    Args:
        evaluations: Evaluations of several trainings; those with the purpose `curve` are used.

    Returns:
        Columns `condition`, `steps`, `seeds` (their number), and the mean and standard deviation (`_sd`) over
        seeds of reward and success. The standard deviation is null with one seed.
    """
    points = evaluations.filter(pl.col("purpose") == "curve").sort("steps")
    rows = []
    for (condition,), of_condition in points.group_by("condition", maintain_order=True):
        grid = of_condition.select(pl.col("steps").unique().sort())
        for (_,), one in of_condition.group_by("seed", maintain_order=True):
            known = one.select("steps", *MEASURES)
            rows.append(
                grid.join_asof(known, on="steps").with_columns(condition=pl.lit(condition)).drop_nulls()
            )
    means = [pl.col(name).mean() for name in MEASURES]
    spreads = [pl.col(name).std().alias(f"{name}_sd") for name in MEASURES]
    return (
        pl.concat(rows)
        .group_by("condition", "steps", maintain_order=True)
        .agg(pl.len().alias("seeds"), *means, *spreads)
        .sort("condition", "steps")
    )


def draw_curves(table: pl.DataFrame) -> Figure:
    """Return a figure of learning curves: mean over seeds and a band of one standard deviation per condition.

    Args:
        table: Result of `curves_table`.
    """
    from matplotlib import pyplot as plt

    with plt.rc_context(figures.STYLE):
        drawn, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
        for panel, (name, title) in zip(axes, MEASURES.items(), strict=True):
            for colour, ((condition,), one) in zip(
                figures.COLOURS, table.group_by("condition", maintain_order=True), strict=False
            ):
                _draw_curve(panel, one, name, f"{condition!s} ({one['seeds'].max()!s})", colour)
            panel.set(title=title, xlabel="control steps of all vehicles")
            panel.locator_params(axis="x", nbins=5)  # six-digit numbers side by side
            panel.xaxis.set_major_formatter("{x:,.0f}")
        axes[1].set_ylim(-0.02, 1.02)
        axes[1].legend(title="condition (seeds)", frameon=False)
        return drawn


def _draw_curve(panel: Axes, one: pl.DataFrame, name: str, label: str, colour: str) -> None:
    """Draw one condition in one panel."""
    steps, mean = one["steps"].to_numpy(), one[name].to_numpy()
    spread = one[f"{name}_sd"].fill_null(0.0).to_numpy()
    panel.fill_between(steps, mean - spread, mean + spread, color=colour, alpha=0.2, linewidth=0)
    panel.plot(steps, mean, color=colour, label=label)


@dataclass(frozen=True)
class Tank:
    """Tank of a flight.

    Attributes:
        size: Length north, width east and depth [m], from the corner at the origin.
        pillars: Axes of the pillars, NED [m], (P, 2).
        radius: Radius of the pillars [m].
        goal: Goal, NED [m], (3,).
        reach: Distance to the goal that counts as success [m].
    """

    size: tuple[float, float, float]
    pillars: Array
    radius: float
    goal: Array
    reach: float


def draw_flight(path: Array, way: Array, tank: Tank, title: str) -> Figure:
    """Return a figure of a flight's path in its tank from above and from the side, with pillars and plan.

    In the view from above, north is to the right and east is down.

    Args:
        path: Path (K, 3), NED [m].
        way: Corners of the planned path (W, 3), W may be 0.
        tank: The tank, its pillars and the goal.
        title: Title of the figure.
    """
    from matplotlib import pyplot as plt
    from matplotlib.patches import Circle

    length, width, depth = tank.size
    with plt.rc_context(figures.STYLE):
        drawn, (above, beside) = plt.subplots(
            2, 1, figsize=(8, 6.4), layout="constrained", height_ratios=(width, depth), sharex=True
        )
        for x, y in tank.pillars:
            above.add_patch(Circle((x, y), tank.radius, color="#555555"))
            beside.axvspan(x - tank.radius, x + tank.radius, color="#555555", alpha=0.25, linewidth=0)
        for panel, axis, end in ((above, 1, width), (beside, 2, depth)):
            panel.add_patch(Circle((tank.goal[0], tank.goal[axis]), tank.reach, color="#009E73", alpha=0.4))
            if len(way):
                panel.plot(way[:, 0], way[:, axis], color="#CC79A7", linestyle="--", label="plan")
            panel.plot(path[:, 0], path[:, axis], color="#0072B2", label="flown")
            panel.plot(path[0, 0], path[0, axis], "o", color="#0072B2", label="start")
            panel.set(xlim=(0.0, length), ylim=(end, 0.0), aspect="equal")
        above.set(ylabel="east [m]")
        beside.set(xlabel="north [m]", ylabel="depth [m]")
        drawn.suptitle(title, x=0.02, ha="left")
        drawn.legend(*above.get_legend_handles_labels(), loc="outside lower right", frameon=False, ncols=3)
        return drawn


def save(drawn: Figure, path: Path) -> None:
    """Write a Matplotlib figure as a PNG file.

    Raises:
        DataError: The file cannot be written.
    """
    try:
        figures.save(drawn, path)
    except OSError as error:
        raise explained(str(path), error) from error


def together(tables: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """Return evaluations of several trainings as one table."""
    return pl.concat(tables, how="vertical_relaxed")
