"""Unexplained force against velocity: a panel for each axis, and sentences on significant velocities."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import plotly.graph_objects as go
import polars as pl

from hydro.core.evaluation.leftover import stands_out
from hydro.io.study import NO_FORCES
from hydro.report import words
from hydro.report.charts import Charts
from hydro.report.figures import TITLES, error_bars
from hydro.report.plots import FOUND, GIVEN, NOISE
from hydro.report.sources import Sources

TOLD = 4
"""Maximum number of bins with a sentence, one for each panel."""
HEADROOM = 1.25
"""Half height of a panel relative to the largest value in it."""
MARKS = ("circle", "diamond")
"""Marks of the first and the last step."""
COLOURS = (GIVEN, FOUND)
"""Colours of the first and the last step."""

Row = dict[str, Any]


def section(sources: Sources, charts: Charts) -> dict[str, Any] | None:
    """Return the section of the page on unexplained forces, as values for the page's template.

    Args:
        sources: Artefacts of the report.
        charts: Collection to which the panels are added.

    Returns:
        A dict with `why`, the reason why forces could not be computed; or, if that is empty, `panels`,
        sentences `told`, tables `most` and `bins`, and `steps`. None if the report has neither a leftover
        table (unexplained force against velocity) nor a reason.
    """
    if sources.leftover is None:
        record = None if sources.sessions is None else sources.sessions.artefact.provenance
        why = "" if record is None else record.parameters.get(NO_FORCES, "")
        return {"why": words.prose(str(why))} if why else None
    frame = sources.leftover.frame
    steps = frame["step"].unique().sort().to_list()
    pairs = frame.select("axis", "against").unique(maintain_order=True).rows()
    panels = []
    for axis, against in pairs:
        rows = frame.filter(axis=axis, against=against)
        name = f"leftover-{axis}-{against}"
        charts.add(name, panel(rows, curve=True), panel(rows, curve=False))
        panels.append((name, f"force {axis} over {TITLES[against]} {against}"))
    bins = frame.filter(pl.col("force").is_not_null())
    given = bins.filter(step=steps[0])
    given = given.with_columns(plain=stands_out(given))
    most = [_plainest(given.filter(axis=axis, against=against)) for axis, against in pairs]
    plain = [_plainest(given.filter("plain", axis=axis, against=against)) for axis, against in pairs]
    return {
        "why": "",
        "panels": panels,
        "told": list(_told([row for row in plain if row is not None])),
        "most": [_line(row, bins) for row in most if row is not None],
        "bins": [_line(row, None) for row in bins.iter_rows(named=True)],
        "steps": steps,
    }


def panel(rows: pl.DataFrame, *, curve: bool) -> go.Figure:
    """Return a figure with the mean unexplained force in each bin of velocity, before and after the study.

    Args:
        rows: Rows of a leftover table of one axis and velocity.
        curve: Whether to draw the force of the vehicle file as a line.
    """
    drawn, first = go.Figure(), rows.row(0, named=True)
    unit, speed = first["unit"], first["velocity_unit"]
    axis, against = first["axis"], first["against"]
    drawn.add_hline(y=0.0, line={"color": NOISE, "width": 1})
    steps = rows["step"].unique().sort().to_list()
    for step, colour, mark in zip(steps, COLOURS, MARKS, strict=False):
        one = rows.filter(step=step)
        label = "as given" if step == steps[0] else f"after step {step}"
        line = one.filter(pl.col("force").is_null())
        if curve:
            drawn.add_scatter(
                x=line["velocity"].to_list(),
                y=line["model"].to_list(),
                mode="lines",
                line={"color": colour, "width": 1.8, "dash": "solid" if step == steps[0] else "dot"},
                hovertemplate=f"%{{y:.3g}} {unit}, force of the file, {label}<extra></extra>",
            )
        bins = one.filter(pl.col("force").is_not_null())
        below, above = error_bars(bins, "force")
        drawn.add_scatter(
            x=bins["velocity"].to_list(),
            y=bins["force"].to_list(),
            customdata=[_interval(row) for row in bins.iter_rows(named=True)],
            error_y={
                "type": "data",
                "symmetric": False,
                "array": above.to_list(),
                "arrayminus": below.to_list(),
                "thickness": 1.5,
                "width": 3,
                "color": colour,
            },
            mode="markers",
            marker={"color": colour, "size": 8, "symbol": mark},
            hovertemplate=f"%{{x:.2f}} {speed}<br><b>%{{y:.3g}} {unit}</b> left over, {label}"
            "<br>95 %: %{customdata}<extra></extra>",
        )
    reach = _reach(rows, curve=curve)
    drawn.update_yaxes(range=[-reach, reach], title=f"{axis} [{unit}]", fixedrange=True, zeroline=False)
    drawn.update_xaxes(title=f"{TITLES[against]} {against} [{speed}]", fixedrange=True, zeroline=False)
    drawn.update_layout(
        template={},
        height=250,
        showlegend=False,
        title={"text": f"{axis} over {TITLES[against]} {against}"},
    )
    return drawn


def _reach(rows: pl.DataFrame, *, curve: bool) -> float:
    """Return half the height of a panel, which shows all means, most intervals, and the curve if drawn."""
    bins = rows.filter(pl.col("force").is_not_null())
    sizes = [bins["force"].abs().max(), (bins["high"] - bins["force"]).median()]
    if curve:
        sizes.append(rows["model"].abs().max())
    return HEADROOM * max(1e-9, *(float(size) for size in sizes if isinstance(size, float)))


def _plainest(bins: pl.DataFrame) -> Row | None:
    """Return the bin of velocity with the most significant force; None if no bin has an interval.

    Args:
        bins: Bins of one panel, rows of a leftover table.
    """
    half = pl.col("high") - pl.col("force")
    sure = bins.filter(half > 0.0).sort(pl.col("force").abs() / half, descending=True)
    return None if sure.is_empty() else sure.row(0, named=True)


def _told(most: list[Row]) -> Iterator[str]:
    """Yield a sentence on each of the first bins, the most significant ones."""
    for row in most[:TOLD]:
        unit, at = row["unit"], f"{TITLES[row['against']]} {words.figure(row['velocity'], 2)}"
        told = f"{row['axis']} at {at} {row['velocity_unit']}: the force of the file is "
        told += f"{words.figure(row['model'])} {unit}, and {words.figure(row['force'])} {unit} "
        told += f"({_interval(row)}) is unexplained"
        share = abs(row["force"]) / max(abs(row["model"]), 1e-300)
        if share < 1.0:
            what = "more" if row["force"] * row["model"] > 0.0 else "less"
            told += f": this log needs {words.percent(share)} {what}"
        yield f"{told}."


def _line(row: Row, bins: pl.DataFrame | None) -> Row:
    """Return a bin as a row of a table, with the unexplained force at its velocity after the last step.

    Args:
        row: The bin.
        bins: All bins, with the number of their step; None if there is only one step.
    """
    after = None if bins is None else _after(row, bins)
    return {
        "axis": row["axis"],
        "step": row["step"],
        "at": f"{row['against']} = {words.figure(row['velocity'], 2)} {row['velocity_unit']}",
        "model": words.figure(row["model"]),
        "force": words.figure(row["force"]),
        "interval": _interval(row),
        "after": "–" if after is None else words.figure(after["force"]),
        "after_interval": "" if after is None else _interval(after),
        "unit": row["unit"],
        "blocks": words.figure(row["blocks"], 2),
    }


def _after(row: Row, bins: pl.DataFrame) -> Row | None:
    """Return the bin of the last step with the nearest velocity; None if there is only one step.

    Args:
        row: Bin of an earlier step.
        bins: All bins.
    """
    later = bins.filter(
        pl.col("step") == bins["step"].max(),
        pl.col("step") != row["step"],
        axis=row["axis"],
        against=row["against"],
    )
    if later.is_empty():
        return None
    return later.sort((pl.col("velocity") - row["velocity"]).abs()).row(0, named=True)


def _interval(row: Row) -> str:
    """Return an interval in words, `−39.6 to −13.3`, or `no interval`."""
    if row["low"] is None:
        return "no interval"
    return f"{words.figure(row['low'])} to {words.figure(row['high'])}"
