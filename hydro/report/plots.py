"""Interactive figures of a report, each from the rows that it shows; the page sets light or dark colours.

Colours mean the same on the whole page: grey for measurements and noise floors, orange for the given model,
blue for the model with the findings, green for held-out data.  All contrast with white and with black.
"""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go
import polars as pl
from markupsafe import escape

from hydro.core.columns import UNITS, command_column
from hydro.report import words
from hydro.report.figures import HEADROOM, MEASURED, TITLES, error_bars
from hydro.report.ladder import by_dataset
from hydro.report.words import Value, figure

GIVEN, FOUND, HELD_OUT, NOISE = "#D9662B", "#2F87D0", "#149E78", "#8C8F94"
BAND = "rgba(47, 135, 208, 0.25)"
"""Colour of the band due to uncertain parameters of the model with the findings."""
MANY = (
    *("#D9662B", "#2F87D0", "#149E78", "#B55FA3", "#B08A00", "#5C6BC0"),
    *("#C0504D", "#4FA3B8", "#8A6A4F", "#7FA33A", "#D977A8", "#4A6B8A"),
)
"""Colours for more than two models."""
POINTS_ON_SCREEN = 1000
"""Maximum number of samples drawn per curve and session: about the pixels across a screen."""
SPAN = 10.0
"""Minimum ratio of the largest to the smallest error for a logarithmic axis."""
CROWDED = 150.0
"""Ratio above which a logarithmic axis has numbers only at powers of ten, not at 2 and 5."""
DATASET_STYLES = {"fit": (FOUND, "circle", "dot"), "holdout": (HELD_OUT, "diamond", "dash")}
"""Colour and mark of each data set of a ladder, and the dashes of its noise floor."""


def ladder(rows: pl.DataFrame, *, logarithmic: bool) -> go.Figure:
    """Return a figure of a study's prediction error at each step, its 95 % interval and the noise floor.

    Args:
        rows: Rows of the ladder table of one axis and horizon.
        logarithmic: Whether the vertical axis is logarithmic.
    """
    drawn = go.Figure()
    for name, label, one in by_dataset(rows):
        colour, symbol, dash = DATASET_STYLES[name]
        drawn.add_scatter(
            x=one["step"].to_list(),
            y=one["noise_floor"].to_list(),
            name=f"noise floor, {label}",
            mode="lines",
            line={"color": NOISE, "width": 1.5, "dash": dash},
            hovertemplate=f"%{{y:.2g}} {one['unit'][0]}, noise floor, {label}<extra></extra>",
        )
        drawn.add_scatter(
            x=one["step"].to_list(),
            y=one["rmse"].to_list(),
            customdata=[words.effects_named(effect) or "the file as given" for effect in one["effect"]],
            error_y=_interval(one, "rmse"),
            name=label,
            mode="lines+markers",
            line={"color": colour, "width": 2.5},
            marker={"size": 9, "symbol": symbol},
            hovertemplate=f"%{{customdata}}<br><b>%{{y:.3g}}</b> {one['unit'][0]}, {label}<extra></extra>",
        )
    steps = rows["step"].unique().sort().to_list()
    drawn.update_xaxes(tickvals=steps, range=[min(steps) - 0.25, max(steps) + 0.25], fixedrange=True)
    drawn.update_xaxes(title="step", showgrid=False, zeroline=False)
    drawn.update_yaxes(title=f"error [{rows['unit'][0]}]", fixedrange=True, exponentformat="none")
    if logarithmic:
        shown = pl.concat([rows["rmse"], rows["noise_floor"].filter(rows["noise_floor"] > 0.0)])
        near = _number(shown.max()) < CROWDED * _number(shown.min())
        drawn.update_yaxes(type="log", dtick="D2" if near else 1, tickformat="~g")
    else:
        drawn.update_yaxes(rangemode="tozero", nticks=6)
    return _plain(drawn)


def wide(errors: pl.Series) -> bool:
    """Return whether the positive errors differ by so large a factor that they need a logarithmic axis."""
    positive = errors.filter(errors > 0.0)
    return len(positive) > 0 and _number(positive.max()) > SPAN * _number(positive.min())


def parameters(values: Sequence[Value]) -> go.Figure:
    """Return a figure with values of one unit as dots with 95 % intervals, and a line at zero."""
    bounds = [one.interval or (one.value, one.value) for one in values]
    drawn = go.Figure()
    drawn.add_scatter(
        x=[one.value for one in values],
        y=[one.name for one in values],
        error_x={
            "type": "data",
            "array": [high - one.value for one, (_, high) in zip(values, bounds, strict=True)],
            "thickness": 2,
            "width": 0,
            "color": FOUND,
        },
        mode="markers",
        marker={"color": FOUND, "size": 10},
        customdata=[f"{figure(low)} to {figure(high)}" for low, high in bounds],
        hovertemplate="%{y} <b>%{x:.3g}</b> " + values[0].unit + "<br>95 %: %{customdata}<extra></extra>",
    )
    drawn.add_vline(x=0.0, line={"color": NOISE, "width": 1, "dash": "dot"})
    drawn.update_yaxes(
        autorange="reversed", showgrid=False, automargin=True, fixedrange=True, type="category"
    )
    drawn.update_xaxes(title=values[0].unit or None, fixedrange=True, zeroline=False)
    return _plain(drawn, height=62 + 26 * len(values))


def conditions(rows: pl.DataFrame) -> go.Figure:
    """Return a figure with the error in each condition of one kind, such as bands of speed.

    If the comparison has the errors of an earlier file, they are drawn too.

    Args:
        rows: Rows of a comparison of one level, axis and kind of condition.
    """
    words, unit = rows["place"].to_list(), rows["unit"][0]
    drawn = go.Figure()
    now = "as given"
    if "before" in rows.columns and rows["before"].is_not_null().any():
        drawn.add_bar(
            x=rows["before"].to_list(),
            y=words,
            name=now,
            orientation="h",
            marker={"color": GIVEN},
            error_x=_interval(rows, "before", "before_"),
            hovertemplate="%{y}<br><b>%{x:.3g}</b> " + unit + ", as given<extra></extra>",
        )
        now = "with the findings"
    drawn.add_bar(
        x=rows["rmse"].to_list(),
        y=words,
        name=now,
        orientation="h",
        marker={"color": GIVEN if now == "as given" else FOUND},
        error_x=_interval(rows, "rmse"),
        hovertemplate="%{y}<br><b>%{x:.3g}</b> " + unit + f", {now}<extra></extra>",
    )
    drawn.update_layout(barmode="group", bargap=0.35, bargroupgap=0.05)
    drawn.update_yaxes(
        autorange="reversed", automargin=True, fixedrange=True, showgrid=False, type="category"
    )
    drawn.update_xaxes(title=f"force left out [{unit}]", fixedrange=True, rangemode="tozero")
    return _plain(drawn, height=80 + len(words) * (44 if len(drawn.data) > 1 else 30))


def overlay(replay: pl.DataFrame, session: str, axis: str, bands: pl.DataFrame | None = None) -> go.Figure:
    """Return a figure with the measured and simulated velocity of one session and axis.

    A simulated curve is interrupted where its error exceeds the whole range of the measured motion.  A curve
    whose error exceeds the standard deviation of the motion is omitted, unless all curves do.  Such curves
    have no information and would hide others.

    Args:
        replay: Replay table.
        session: Name of the session.
        axis: One of u v w p q r.
        bands: Bands table: 95 % intervals of the last model's predictions; None without one.
    """
    one = replay.filter(pl.col("session") == session).select(
        "variant", pl.col("t") - pl.col("t").min(), value=pl.col(axis).cast(pl.Float64)
    )
    variants = one["variant"].unique(maintain_order=True).to_list()
    against = one.filter(variant=MEASURED if MEASURED in variants else variants[0])
    low, high = _number(against["value"].min()), _number(against["value"].max())
    reach = max(high - low, 1e-3)
    step = max(1, -(-against.height // POINTS_ON_SCREEN))
    drawn = go.Figure()
    if bands is not None:
        _band(drawn, bands.filter(session=session), axis)
    beside = one.join(against.select("t", measured="value"), on="t", how="left", maintain_order="left")
    useless = _useless(beside.filter(pl.col("variant") != MEASURED), _number(against["value"].std()))
    for name, (label, colour) in curves(variants).items():
        if name in useless:
            continue
        curve = beside.filter(variant=name)
        near = (pl.col("value") - pl.col("measured")).abs() <= reach
        shown = curve.gather_every(step).with_columns(pl.when(near.fill_null(True)).then("value"))
        measured = name == MEASURED
        drawn.add_scatter(
            x=shown["t"].cast(pl.Float32).to_numpy(),
            y=shown["value"].cast(pl.Float32).to_numpy(),
            name=label,
            mode="lines",
            line={"color": colour, "width": 5 if measured else 1.6},
            opacity=0.5 if measured else 1.0,
            hovertemplate=f"%{{y:.3f}} {UNITS[axis]}<extra>{escape(label)}</extra>",
        )
    margin = HEADROOM * reach
    drawn.update_yaxes(range=[low - margin, high + margin], title=UNITS[axis], fixedrange=True)
    drawn.update_xaxes(title="time [s]", showgrid=False, zeroline=False)
    drawn.update_layout(hovermode="x unified", title={"text": f"{TITLES[axis]} {axis}"})
    return _plain(drawn, height=230)


def path(replay: pl.DataFrame, session: str, restart: float | None = None) -> go.Figure:
    """Return a figure with the path of one session from above, east right and north up, with equal scales.

    Args:
        replay: Replay table.
        session: Name of the session.
        restart: Period after which the simulation restarts from the measured state [s]; lines are interrupted
            there.
    """
    drawn = _tracks(replay, session, ("y", "x"), restart)
    drawn.update_xaxes(title="east y [m]", zeroline=False)
    drawn.update_yaxes(title="north x [m]", scaleanchor="x", zeroline=False)
    drawn.update_layout(title={"text": "path from above"})
    return _plain(drawn, height=320)


def depth(
    replay: pl.DataFrame, session: str, restart: float | None = None, bands: pl.DataFrame | None = None
) -> go.Figure:
    """Return a figure with the depth of one session over time, downward.

    Args:
        replay: Replay table.
        session: Name of the session.
        restart: Period after which the simulation restarts from the measured state [s]; lines are interrupted
            there.
        bands: Bands table: 95 % intervals of the last model's predictions; None without one.
    """
    drawn = _tracks(replay, session, ("t", "z"), restart)
    if bands is not None:
        _band(drawn, bands.filter(session=session), "z")
    drawn.update_xaxes(title="time [s]", zeroline=False)
    drawn.update_yaxes(title="depth z [m]", autorange="reversed", zeroline=False)
    drawn.update_layout(title={"text": "depth"})
    return _plain(drawn, height=320)


def commands(replay: pl.DataFrame, session: str, names: Sequence[str]) -> go.Figure:
    """Return a figure with the commands of one session, from -100 to 100 % for each thruster.

    Args:
        replay: Replay table with commands.
        session: Name of the session.
        names: Names of the thrusters, in the order of their columns.
    """
    one = replay.filter(session=session, variant=MEASURED).with_columns(pl.col("t") - pl.col("t").min())
    shown = one.gather_every(max(1, -(-one.height // POINTS_ON_SCREEN)))
    lane, drawn = 1.0 / max(len(names), 1), go.Figure()
    for number, name in enumerate(names):
        which = "" if number == 0 else str(number + 1)
        drawn.add_scatter(
            x=shown["t"].cast(pl.Float32).to_numpy(),
            y=(100.0 * shown[command_column(number)]).round().cast(pl.Int8).to_numpy(),
            yaxis=f"y{which}",
            mode="lines",
            line={"color": NOISE, "width": 1.2, "shape": "hv"},
            fill="tozeroy",
            hovertemplate=f"%{{x:.1f}} s, {escape(name)} <b>%{{y}} %</b><extra></extra>",
        )
        drawn.layout[f"yaxis{which}"] = {
            "domain": [1.0 - (number + 0.95) * lane, 1.0 - (number + 0.05) * lane],
            "range": [-105, 105],
            "tickvals": [0],
            "ticktext": [str(escape(name))],
            "fixedrange": True,
            "zeroline": True,
        }
    bottom = "y" if len(names) < 2 else f"y{len(names)}"
    drawn.update_xaxes(title="time [s]", zeroline=False, showgrid=False, anchor=bottom)
    drawn.update_layout(title={"text": "commands, −100 to 100 %"})
    return _plain(drawn, height=90 + 34 * len(names))


def _band(drawn: go.Figure, rows: pl.DataFrame, name: str) -> None:
    """Draw the 95 % band of one column of one session, behind the curves.

    Args:
        drawn: Figure.
        rows: Rows of the bands table of one session.
        name: Name of the column.
    """
    shown = rows.gather_every(max(1, -(-rows.height // POINTS_ON_SCREEN)))
    since = (shown["t"] - shown["t"].min()).cast(pl.Float32)
    for side, fill in (("low", None), ("high", "tonexty")):
        drawn.add_scatter(
            x=since.to_numpy(),
            y=shown[f"{name}_{side}"].cast(pl.Float32).to_numpy(),
            mode="lines",
            line={"width": 0},
            fill=fill,
            fillcolor=BAND,
            hoverinfo="skip",
        )


def _tracks(replay: pl.DataFrame, session: str, columns: tuple[str, str], restart: float | None) -> go.Figure:
    """Draw one column over another, with a line of at most POINTS_ON_SCREEN samples for each variant.

    Args:
        replay: Replay table.
        session: Name of the session.
        columns: Column of the horizontal and of the vertical axis.
        restart: Period after which the simulation restarts from the measured state [s].
    """
    across, up = columns
    one = replay.filter(pl.col("session") == session).with_columns(pl.col("t") - pl.col("t").min())
    variants = one["variant"].unique(maintain_order=True).to_list()
    drawn = go.Figure()
    for name, (label, colour) in curves(variants).items():
        curve = one.filter(variant=name)
        shown = curve.gather_every(max(1, -(-curve.height // POINTS_ON_SCREEN)))
        measured = name == MEASURED
        if restart is not None and not measured:
            again = (pl.col("t") // restart).diff().fill_null(0.0) != 0.0
            shown = shown.with_columns(pl.when(~again).then(up))
        drawn.add_scatter(
            x=shown[across].cast(pl.Float32).to_numpy(),
            y=shown[up].cast(pl.Float32).to_numpy(),
            name=label,
            mode="lines",
            line={"color": colour, "width": 5 if measured else 1.6},
            opacity=0.5 if measured else 1.0,
            hovertemplate=f"%{{x:.2f}}, %{{y:.2f}}<extra>{escape(label)}</extra>",
        )
    return drawn


def _useless(simulated: pl.DataFrame, spread: float) -> list[str]:
    """Return the variants whose error exceeds `spread`; none if all variants do."""
    error = (pl.col("value") - pl.col("measured")).pow(2).mean().sqrt()
    errors = simulated.group_by("variant", maintain_order=True).agg(error=error)
    far = errors.filter(pl.col("error") > spread)["variant"].to_list()
    return far if len(far) < errors.height else []


def curves(variants: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return the legend label and the colour (such as `#2F87D0`) of each curve, by variant, `measured` first.

    Args:
        variants: Variants of a replay, or the models `step-K` of a study's steps; `measured` may be one.
    """
    others = [name for name in variants if name != MEASURED]
    found = {MEASURED: ("measured", NOISE)} if MEASURED in variants else {}
    if others and all(name.startswith("step-") for name in others):
        steps = sorted(others, key=lambda name: int(name.removeprefix("step-") or 0))
        found |= {steps[0]: ("model as given", GIVEN)}
        found |= {name: (f"after step {name.removeprefix('step-')}", FOUND) for name in steps[1:]}
        return found
    return found | {name: (name, MANY[i % len(MANY)]) for i, name in enumerate(others)}


def bars(metrics: pl.DataFrame, group: str) -> go.Figure:
    """Return a figure with errors per axis, one bar for each model or variant.

    Args:
        metrics: Rows of one metric and unit.
        group: Column whose values get a bar each: `model` or `variant`.
    """
    drawn = go.Figure()
    unit = metrics["unit"][0]
    for i, (name,) in enumerate(metrics.select(group).unique(maintain_order=True).rows()):
        one = metrics.filter(pl.col(group) == name)
        drawn.add_bar(
            x=one["axis"].to_list(),
            y=one["value"].to_list(),
            name=name,
            error_y=_interval(one, "value"),
            marker={"color": MANY[i % len(MANY)]},
            hovertemplate="%{x} <b>%{y:.3g}</b> " + unit + "<extra>%{fullData.name}</extra>",
        )
    drawn.update_layout(barmode="group", bargap=0.3)
    scale = "log" if wide(metrics["value"]) else "linear"
    drawn.update_yaxes(type=scale, title=unit, fixedrange=True)
    drawn.update_xaxes(fixedrange=True, type="category", showgrid=False)
    return _plain(drawn, height=260)


def _interval(rows: pl.DataFrame, of: str, prefix: str = "") -> dict[str, object] | None:
    """Return plotly's error bars from the columns `low` and `high`; None without these columns.

    Args:
        rows: Table with the value and the ends of its interval.
        of: Column of the value.
        prefix: Prefix of the columns `low` and `high`.
    """
    low = f"{prefix}low"
    if low not in rows.columns or rows[low].null_count() == rows.height:
        return None
    down, up = (side.to_list() for side in error_bars(rows, of, prefix))
    return {"type": "data", "symmetric": False, "array": up, "arrayminus": down, "thickness": 1.5, "width": 3}


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def _plain(drawn: go.Figure, height: int = 300) -> go.Figure:
    """Return a figure without a style: the page has a template for light and one for dark colours."""
    drawn.update_layout(template={}, height=height, showlegend=False)
    return drawn
