"""Figures of a replay: functions that return the drawn data as a table, and functions that draw it.

The tables can be tested and queried, and the figures show nothing else.  Colours are those of Okabe and Ito,
which readers with any colour vision can distinguish.  The measured motion is a wide grey band.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from hydro.core.columns import UNITS
from hydro.io.files import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLES = {"u": "surge", "v": "sway", "w": "heave", "p": "roll rate", "q": "pitch rate", "r": "yaw rate"}
"""Name of the motion along each velocity axis."""
MEASURED = "measured"
"""Name of the measured motion among the variants of a replay."""
VELOCITY_PANELS = ("u", "p", "v", "q", "w", "r")
"""Axes in the order of the panels, in rows of two."""
LABELS = 7
"""Maximum number of labels on one line of a legend."""
HEADROOM = 0.35
"""Margin of a panel beyond the measured range, as a share of this range."""
POINTS_IN_PRINT = 3000
"""Maximum number of samples drawn per curve; more are not visible at print resolution."""

_INK = "#222222"
COLOURS = (
    *("#E69F00", "#CC79A7", "#0072B2", "#009E73", "#D55E00", "#56B4E9"),
    *("#8C8C00", "#7A5195", "#7F3B08", "#C51B7D", "#35978F", "#4D9221"),
)
STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": "#888888",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "text.color": _INK,
    "axes.labelcolor": _INK,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "figure.dpi": 100,
    "savefig.dpi": 150,
}


def overlay_table(replay: pl.DataFrame, axes: tuple[str, ...] = VELOCITY_PANELS) -> pl.DataFrame:
    """Return the data of a figure of measured and simulated velocities: one row per axis, variant and time.

    A curve ends where its error first exceeds the whole range of the measured motion: after that it has no
    information and would hide other curves.

    Args:
        replay: Replay table; its first session is drawn.
        axes: Velocity columns, one panel each.

    Returns:
        Columns `axis`, `variant`, `t` [s, from the start], `value` [m/s or rad/s], `lost` (true in the last
        row of a curve that ends early), and `bottom`, `top`: the panel's limits, set by the measured motion.
    """
    one = replay.filter(pl.col("session") == replay["session"][0])
    step = max(1, -(-one.filter(pl.col("variant") == MEASURED).height // POINTS_IN_PRINT))
    thinned = one.filter(pl.int_range(pl.len()).over("variant") % step == 0)
    series = thinned.select(
        "variant",
        (pl.col("t") - pl.col("t").min()).cast(pl.Float64),
        *[pl.col(axis).cast(pl.Float64) for axis in axes],
    ).unpivot(on=list(axes), index=["variant", "t"], variable_name="axis", value_name="value")
    measured = series.filter(pl.col("variant") == MEASURED).drop("variant").rename({"value": "measured"})
    low, high = pl.col("measured").min(), pl.col("measured").max()
    reach = (high - low).clip(1e-3).over("axis")
    against = measured.with_columns(
        reach=reach, bottom=low.over("axis") - HEADROOM * reach, top=high.over("axis") + HEADROOM * reach
    )
    away = (pl.col("value") - pl.col("measured")).abs() > pl.col("reach")
    curve = ["axis", "variant"]
    return (
        series.join(against, on=["axis", "t"], how="inner", maintain_order="left")
        .with_columns(times_away=away.cum_sum().over(curve))
        .with_columns(lost=pl.col("times_away") == 1)
        .filter(pl.col("times_away").shift(1, fill_value=0).over(curve) == 0)
        .select(*curve, "t", "value", "lost", "bottom", "top")
    )


def draw_overlay(table: pl.DataFrame) -> Figure:
    """Return a figure of measured and simulated velocities, one panel per axis.

    Args:
        table: Result of `overlay_table`.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    axes = table["axis"].unique(maintain_order=True).to_list()
    variants = [name for name in table["variant"].unique(maintain_order=True) if name != MEASURED]
    columns = 2 if len(axes) > 1 else 1
    rows = -(-len(axes) // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.6 * columns, 1.0 + 1.95 * rows), layout="constrained")
        panels = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
        for panel, axis in zip(panels, axes, strict=False):
            _draw_panel(panel, table.filter(pl.col("axis") == axis), variants)
        for spare in panels[len(axes) :]:
            spare.set_visible(False)
        for panel in panels[max(0, len(axes) - columns) : len(axes)]:
            panel.tick_params(labelbottom=True)
            panel.set_xlabel("time [s]")
        handles, labels = panels[0].get_legend_handles_labels()
        if table["lost"].any():
            handles.append(Line2D([], [], color="#777777", marker="x", linestyle="", markeredgewidth=2))
            labels.append("off scale: error beyond the measured range")
        beside = -(-len(labels) // -(-len(labels) // LABELS))
        figure.legend(handles, labels, loc="outside upper center", ncols=beside, frameon=False)
    return figure


def _draw_panel(panel: Axes, rows: pl.DataFrame, variants: list[str]) -> None:
    """Draw one axis: the measured motion as a wide grey band, variants as thin lines over it."""
    axis = rows["axis"][0]
    measured = rows.filter(pl.col("variant") == MEASURED)
    panel.plot(
        measured["t"], measured["value"], color="#B9B9B9", linewidth=5, label=MEASURED, solid_capstyle="round"
    )
    for name, colour in zip(variants, COLOURS * len(variants), strict=False):
        curve = rows.filter(pl.col("variant") == name)
        dashes = (0, (3, 1.6)) if name == variants[-1] and len(variants) > 1 else "-"
        panel.plot(curve["t"], curve["value"], color=colour, linewidth=1.4, linestyle=dashes, label=name)
        end = curve.filter("lost")
        height = end["value"].clip(rows["bottom"][0], rows["top"][0])
        (cross,) = panel.plot(end["t"], height, "x", color=colour, markersize=8, markeredgewidth=2)
        cross.set(clip_on=False, in_layout=False)
    panel.set_ylim(rows["bottom"][0], rows["top"][0])
    panel.margins(x=0.01)
    panel.set_title(f"{TITLES[axis]} {axis}")
    panel.set_ylabel(UNITS[axis])


def draw_errors(table: pl.DataFrame, title: str = "Open-loop replay, RMSE (lower is better)") -> Figure:
    """Return a figure with the errors of replays as heat maps, translation left and rotation right.

    Args:
        table: Result of `tables.replay_errors`.
        title: Title of the figure.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    groups = [
        ([axis for axis in "uvw" if axis in table.columns], "m/s"),
        ([axis for axis in "pqr" if axis in table.columns], "rad/s"),
    ]
    groups = [group for group in groups if group[0]]
    with mpl.rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(1.6 + 1.15 * sum(len(a) for a, _ in groups), 1.3 + 0.46 * table.height))
        figure.set_layout_engine("constrained")
        panels = figure.subplots(
            1, len(groups), sharey=True, squeeze=False, width_ratios=[len(a) for a, _ in groups]
        ).ravel()
        for panel, (axes, unit) in zip(panels, groups, strict=True):
            _draw_heat(panel, table, axes, unit)
        panels[0].set_yticks(range(table.height), table["variant"].to_list())
        figure.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
    return figure


def _draw_heat(panel: Axes, table: pl.DataFrame, axes: list[str], unit: str) -> None:
    """Draw one block of cells on a logarithmic scale, each with its number in a contrasting colour."""
    import numpy as np
    from matplotlib.colors import LogNorm

    values = table.select(axes).to_numpy().astype(float)
    positive = values[np.isfinite(values) & (values > 0)]
    low, high = (positive.min(), positive.max()) if positive.size else (1e-3, 1.0)
    norm = LogNorm(low / 1.2, high * 1.2)
    panel.imshow(np.clip(values, low, high), norm=norm, cmap="cividis_r", aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        dark = np.isfinite(value) and norm(max(value, low)) > 0.55
        text = "–" if not np.isfinite(value) else f"{value:#.3g}" if value < 1000 else f"{value:.1e}"
        panel.text(column, row, text, ha="center", va="center", color="white" if dark else _INK)
    panel.set_xticks(range(len(axes)), [f"{axis}\n{TITLES[axis]}" for axis in axes])
    panel.set_title(unit, fontweight="normal")
    panel.tick_params(length=0)
    for spine in panel.spines.values():
        spine.set_visible(False)


def error_bars(rows: pl.DataFrame, of: str, prefix: str = "") -> tuple[pl.Series, pl.Series]:
    """Return the lengths of error bars from a value down to `low` and up to `high`; 0 without an interval.

    Args:
        rows: Table with the value and the ends of its interval.
        of: Column of the value.
        prefix: Prefix of the columns `low` and `high`.

    Returns:
        The lengths downwards and upwards, a number for each row.
    """
    middle = pl.col(of)
    down = (middle - pl.col(f"{prefix}low").fill_null(middle)).clip(0.0)
    up = (pl.col(f"{prefix}high").fill_null(middle) - middle).clip(0.0)
    below, above = rows.select(down=down, up=up)
    return below, above


def save(figure: Figure, path: Path) -> None:
    """Write a Matplotlib figure as a PNG file, atomically; the same figure gives the same bytes.

    Args:
        figure: The figure.
        path: The file.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    with whole_file(path) as stream:
        figure.savefig(stream, format="png", metadata={"Software": None})
