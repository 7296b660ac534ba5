"""Picture of an imported recording: track, depth, velocities and commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import polars as pl

from hydro.core.columns import COMMAND
from hydro.core.recording.segments import GAP, sample_time
from hydro.report.figures import COLOURS, POINTS_IN_PRINT, STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OVER_TIME = (
    ("Depth", "depth [m]", ("z",)),
    ("Velocity over ground, body axes", "m/s", ("u", "v", "w")),
    ("Attitude", "rad", ("phi", "theta", "psi")),
    ("Angular velocity, body axes", "rad/s", ("p", "q", "r")),
)
"""Panels over time: title, unit, columns of the raw table."""


def overview(raw: pl.DataFrame) -> pl.DataFrame:
    """Return the data of the picture of a recording: averages over bins, with all sessions on one clock.

    Args:
        raw: Raw table.

    Returns:
        The columns of `raw`, averaged over bins, and `clock` [s] from the first row. Sessions are one sample
        time apart. A row of nulls follows every piece without a gap, so that lines end there.
    """
    step = sample_time(raw)
    since = (pl.col("t") - pl.col("t").first()).over("session").cast(pl.Float64)
    laid = raw.with_columns(pl.col(pl.Float32).cast(pl.Float64), clock=since)
    order = raw["session"].unique(maintain_order=True).to_list()
    lengths = dict(laid.group_by("session").agg(pl.col("clock").max()).iter_rows())
    starts, begun = dict[str, float](), 0.0
    for name in order:
        starts[name], begun = begun, begun + lengths[name] + step
    offset = pl.col("session").replace_strict(starts, return_dtype=pl.Float64)
    laid = laid.with_columns(clock=pl.col("clock") + offset)
    every = max(1, -(-laid.height // POINTS_IN_PRINT))
    breaks = (pl.col("session") != pl.col("session").shift()) | (pl.col("t").diff() > GAP * step)
    laid = laid.with_columns(piece=breaks.fill_null(value=False).cum_sum())
    sampled = _thinned(laid, every)
    holes = sampled.group_by("piece", maintain_order=True).agg(pl.col("session", "clock").last())
    return pl.concat([sampled, holes], how="diagonal").sort("piece", maintain_order=True).drop("piece")


def _thinned(laid: pl.DataFrame, every: int) -> pl.DataFrame:
    """Average the samples over bins of `every` rows; commands are those of the first row of a bin."""
    if every == 1:
        return laid
    measured = [
        name for name in laid.columns if name not in ("session", "piece") and not name.startswith(COMMAND)
    ]
    bins = (pl.int_range(pl.len()).over("piece") // every).alias("bin")
    others = [name for name in laid.columns if name not in (*measured, "piece")]
    return (
        laid.with_columns(bins)
        .group_by("piece", "bin", maintain_order=True)
        .agg(pl.col(measured).mean(), pl.col(others).first())
        .drop("bin")
    )


def draw(rows: pl.DataFrame, title: str) -> Figure:
    """Return a figure of a recording: on the left the track, if known; all other quantities over time.

    Args:
        rows: Result of `overview`.
        title: Title of the figure.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    commands = [name for name in rows.columns if name.startswith(COMMAND)]
    shown = [panel for panel in OVER_TIME if _has(rows, panel[2])]
    placed = _has(rows, ("x", "y"))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(13.0 if placed else 9.0, 1.2 + 1.7 * (len(shown) + 1)), layout="constrained")
        grid = figure.add_gridspec(
            len(shown) + 1, 2 if placed else 1, width_ratios=[4, 5] if placed else None
        )
        if placed:
            _draw_track(figure.add_subplot(grid[:, 0]), rows)
        last = None
        for number, (name, unit, columns) in enumerate(
            (*shown, ("Commands of the thrusters", "-1 to 1", commands))
        ):
            last = figure.add_subplot(grid[number, -1], sharex=last)
            _draw_over_time(last, rows, name, unit, columns)
        if last is not None:
            last.set_xlabel("time [s], sessions one after another" if _several(rows) else "time [s]")
        figure.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
    return figure


def _has(rows: pl.DataFrame, columns: tuple[str, ...] | list[str]) -> bool:
    """Return whether any of these columns has samples."""
    return any(rows[name].count() for name in columns if name in rows.columns)


def _several(rows: pl.DataFrame) -> bool:
    """Return whether the rows belong to more than one session."""
    return rows["session"].n_unique() > 1


def _draw_track(panel: Axes, rows: pl.DataFrame) -> None:
    """Draw north over east in a colour for each session, with a dot at its start."""
    names = rows["session"].unique(maintain_order=True).to_list()
    for number, name in enumerate(names):
        one = rows.filter(pl.col("session") == name, pl.col("x").is_not_null(), pl.col("y").is_not_null())
        colour = COLOURS[number % len(COLOURS)]
        panel.plot(one["y"], one["x"], color=colour, linewidth=1.2, label=name)
        panel.plot(one["y"].head(1), one["x"].head(1), "o", color=colour, markersize=6)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set(title="Track (dot: start)", xlabel="east y [m]", ylabel="north x [m]")
    if 1 < len(names) <= len(COLOURS):
        panel.legend(frameon=False, fontsize=8)


def _draw_over_time(
    panel: Axes, rows: pl.DataFrame, title: str, unit: str, columns: tuple[str, ...] | list[str]
) -> None:
    """Draw columns over time: depth downward, commands as steps."""
    for number, name in enumerate(columns):
        if name not in rows.columns or not rows[name].count():
            continue
        hole = pl.col("t").is_null()
        one = rows.filter(pl.col(name).is_not_null() | hole)
        style = "steps-post" if name.startswith(COMMAND) else "default"
        colour = COLOURS[number % len(COLOURS)]
        panel.plot(one["clock"], one[name], color=colour, linewidth=1.0, drawstyle=style, label=name)
    if columns == ("z",):
        panel.invert_yaxis()
    else:
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
    panel.set(title=title, ylabel=unit)
    panel.margins(x=0.01)
