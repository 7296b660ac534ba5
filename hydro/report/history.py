"""Page of a history of dives: the changes in sentences, a time line of each parameter, and all numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hydro.core.history.history import History
from hydro.core.history.parameters import SHARE
from hydro.core.history.sentences import limits
from hydro.core.interval import NORMAL_95
from hydro.io.table import Artefact
from hydro.report.charts import Charts
from hydro.report.rendering import rendered
from hydro.report.words import figure

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ESTIMATE, LEVEL, BASELINE = "#2F87D0", "#D9662B", "#8C8F94"
"""Colours of estimates, fitted levels and baseline dives."""
HEIGHT = 240
"""Height of a time line [px]: eight fit on two screens."""


def render(history: History, table: Artefact, title: str, failed: Sequence[str] = ()) -> str:
    """Return the page of a history of dives as HTML text that loads no other file.

    Args:
        history: The history.
        table: History table, whose hash the page states.
        title: Name of the vehicle.
        failed: Reason for each dive without an estimate; () if all dives have one.
    """
    charts, levels = Charts(), history.levels
    for i, one in enumerate(history.parameters):
        charts.add(one.name, time_line(history, i, levels[i].tolist()))
    return rendered(
        "history.html",
        charts,
        title=title,
        headline=history.headline,
        limits=limits(),
        lines=_lines(history),
        undetermined=", ".join(one.label for one in history.undetermined),
        failed=list(failed),
        rows=_rows(history),
        version=table.provenance.package,
        content=table.provenance.content,
    )


def time_line(history: History, row: int, level: Sequence[float]) -> Figure:
    """Return a figure with the estimates of one parameter over the dives, 95 % intervals and fitted level.

    Args:
        history: The history.
        row: Index of the parameter.
        level: Fitted level at each dive.
    """
    import plotly.graph_objects as go

    parameter = history.parameters[row]
    numbers = list(range(1, len(history.dives) + 1))
    colours = [BASELINE if number <= history.baseline else ESTIMATE for number in numbers]
    trend = any(one.parameter == row and one.kind == "trend" for one in history.found)
    drawn = go.Figure()
    drawn.add_scatter(
        x=numbers,
        y=list(level),
        mode="lines",
        line={"color": LEVEL, "width": 2, "shape": "linear" if trend else "hvh"},
        hoverinfo="skip",
    )
    drawn.add_scatter(
        x=numbers,
        y=history.values[row].tolist(),
        error_y={
            "type": "data",
            "array": (NORMAL_95 * history.errors[row]).tolist(),
            "thickness": 1.5,
            "width": 2,
            "color": ESTIMATE,
        },
        mode="markers",
        marker={"color": colours, "size": 8},
        customdata=list(history.dives),
        hovertemplate="dive %{x}, %{customdata}<br><b>%{y:.3g}</b> " + parameter.unit + "<extra></extra>",
    )
    drawn.update_xaxes(title="dive", fixedrange=True, showgrid=False, zeroline=False, tickformat="d")
    drawn.update_yaxes(title=axis_title(parameter.unit), fixedrange=True, zeroline=False)
    drawn.update_layout(template={}, height=HEIGHT, showlegend=False)
    return drawn


def axis_title(unit: str) -> str:
    """Return the title of the vertical axis of a time line whose values have the unit `unit`."""
    return "relative to the baseline" if unit == SHARE else f"change [{unit}]"


def _lines(history: History) -> list[dict[str, Any]]:
    """Return heading, unit and sentences on changes for each parameter's time line."""
    told = list(zip(history.found, history.sentences, strict=True))
    return [
        {
            "name": one.name,
            "label": one.label,
            "unit": "" if one.unit == SHARE else f" [{one.unit}]",
            "sentences": [words for change, words in told if change.parameter == i],
            "changed": any(change.parameter == i for change in history.found),
        }
        for i, one in enumerate(history.parameters)
    ]


def _rows(history: History) -> list[dict[str, Any]]:
    """Return the rows of the table of numbers, one for each dive."""
    flags = [history.flags[i] for i in range(len(history.parameters))]
    return [
        {
            "number": j + 1,
            "dive": dive,
            "cells": [
                {
                    "words": f"{figure(history.values[i, j])} ± {figure(history.errors[i, j], 2)}",
                    "changed": flags[i][j] in ("changed", "found"),
                }
                for i in range(len(history.parameters))
            ],
        }
        for j, dive in enumerate(history.dives)
    ]
