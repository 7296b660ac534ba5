"""Pictures of learning and of what was learnt: curves over seeds (Fig. 6), the path of a flight (Fig. 7)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.io.files import explained
from hydro.report import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
PANELS = {"reward": "mean reward of an evaluation", "success": "share of an evaluation that arrived"}


def curves_table(evaluations: pl.DataFrame) -> pl.DataFrame:
    """Mean and spread over seeds, at every step that any seed was evaluated at.

    A training that has ended keeps its last value: seeds that pass the curriculum early stay in the mean.

    Args:
        evaluations: Evaluations of several trainings; those of the curve are taken.

    Returns:
        `condition`, `steps`, `seeds`, and of reward and success the mean and `_sd`, the standard deviation
        over seeds; null with one seed.
    """
    points = evaluations.filter(pl.col("purpose") == "curve").sort("steps")
    rows = []
    for (condition,), of_condition in points.group_by("condition", maintain_order=True):
        grid = of_condition.select(pl.col("steps").unique().sort())
        for (_,), one in of_condition.group_by("seed", maintain_order=True):
            known = one.select("steps", *PANELS)
            rows.append(
                grid.join_asof(known, on="steps").with_columns(condition=pl.lit(condition)).drop_nulls()
            )
    means = [pl.col(name).mean() for name in PANELS]
    spreads = [pl.col(name).std().alias(f"{name}_sd") for name in PANELS]
    return (
        pl.concat(rows)
        .group_by("condition", "steps", maintain_order=True)
        .agg(pl.len().alias("seeds"), *means, *spreads)
        .sort("condition", "steps")
    )


def draw_curves(table: pl.DataFrame) -> Figure:
    """Mean over seeds, and a band of one standard deviation, of every condition."""
    from matplotlib import pyplot as plt

    with plt.rc_context(figures.STYLE):
        drawn, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
        for panel, (name, title) in zip(axes, PANELS.items(), strict=True):
            for colour, ((condition,), one) in zip(
                figures.COLOURS, table.group_by("condition", maintain_order=True), strict=False
            ):
                _draw_curve(panel, one, name, f"{condition!s} ({one['seeds'].max()!s})", colour)
            panel.set(title=title, xlabel="control steps of all vehicles")
            panel.xaxis.set_major_formatter("{x:,.0f}")
        axes[1].set_ylim(-0.02, 1.02)
        axes[1].legend(title="condition (seeds)", frameon=False)
        return drawn


def _draw_curve(panel: Axes, one: pl.DataFrame, name: str, label: str, colour: str) -> None:
    """One condition in one panel."""
    steps, mean = one["steps"].to_numpy(), one[name].to_numpy()
    spread = one[f"{name}_sd"].fill_null(0.0).to_numpy()
    panel.fill_between(steps, mean - spread, mean + spread, color=colour, alpha=0.2, linewidth=0)
    panel.plot(steps, mean, color=colour, label=label)


def draw_flight(
    path: Array, goal: Array, pillars: Array, way: Array, *, radius: float, reach: float, title: str
) -> Figure:
    """The path of a flight from above, and its depth, with pillars and plan.

    Args:
        path: (K, 3), NED [m].
        goal: (3,).
        pillars: Axes (P, 2).
        way: Corners of the plan (W, 3), W may be 0.
        radius: Of the pillars [m].
        reach: Distance to the goal that is a success [m].
        title: Above it.
    """
    from matplotlib import pyplot as plt
    from matplotlib.patches import Circle

    with plt.rc_context(figures.STYLE):
        drawn, (above, beside) = plt.subplots(
            2, 1, figsize=(8, 6), layout="constrained", height_ratios=(3, 1), sharex=False
        )
        for x, y in pillars:
            above.add_patch(Circle((y, x), radius, color="#555555"))
        above.add_patch(Circle((goal[1], goal[0]), reach, color="#009E73", alpha=0.4))
        if len(way):
            above.plot(way[:, 1], way[:, 0], color="#CC79A7", linestyle="--", label="plan")
        above.plot(path[:, 1], path[:, 0], color="#0072B2", label="flown")
        above.plot(path[0, 1], path[0, 0], "o", color="#0072B2", label="start")
        above.set(xlabel="east [m]", ylabel="north [m]")
        above.set_aspect("equal", adjustable="datalim")  # a flight due north keeps the width of the panel
        drawn.suptitle(title, x=0.02, ha="left")
        drawn.legend(loc="outside upper right", frameon=False, ncols=3)
        beside.plot(_along(path), path[:, 2], color="#0072B2")
        if len(way):
            beside.plot(_along(way), way[:, 2], color="#CC79A7", linestyle="--")
        beside.axhline(goal[2], color="#009E73", linewidth=0.8)
        beside.invert_yaxis()
        beside.set(xlabel="way over ground [m]", ylabel="depth [m]")
        return drawn


def _along(path: Array) -> Array:
    """Horizontal length of a path up to each of its points."""
    steps = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    along: Array = np.concatenate([[0.0], steps.cumsum()])
    return along


def save(drawn: Figure, path: Path) -> None:
    """Write a figure as PNG.

    Raises:
        DataError: the operating system refuses.
    """
    try:
        figures.save(drawn, path)
    except OSError as error:
        raise explained(str(path), error) from error


def together(tables: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """Evaluations of several trainings as one table."""
    return pl.concat(tables, how="vertical_relaxed")
