"""Panel of step 2: errors by axis at a horizon, and the places where the vehicle fails."""

from __future__ import annotations

import math
from functools import partial
from html import escape

from nicegui import ui

from hydro.app.bench import Bench
from hydro.app.buttons import button
from hydro.app.panel import begun, onward
from hydro.core.columns import DOF, UNITS, VELOCITY
from hydro.report import words


def show(bench: Bench) -> None:
    """Put the panel of step 2 on the page: errors by axis at a horizon, and where the vehicle fails.

    Args:
        bench: State and actions of the tab.
    """
    session, live = bench.session, begun(bench, "Compare measured and predicted motion")
    if live is None:
        return
    horizons: dict[float | None, str] = {one: f"{one:g} s" for one in live.horizons}
    horizons[None] = "whole run"
    ui.html("<h3>Prediction horizon</h3>", sanitize=False)
    with ui.element("div").classes("row"):
        for horizon, told in horizons.items():
            chosen = horizon == session.horizon
            button(bench, told, partial(bench.set_horizon, horizon), look="first" if chosen else "other")
    bench.table = ui.html(errors(bench), sanitize=False)
    ui.html("<h3>Where the vehicle as given fails</h3>", sanitize=False)
    if session.compared is None:
        ui.html("<p>The comparison runs or was cancelled.</p>", sanitize=False)
        button(bench, "Compare", bench.compare)
        return
    ui.html("<p>A click shows the longest moment; another click the next one.</p>", sanitize=False)
    rows = [
        f"<button class='place' data-do='place' data-with='{escape(one['place'], quote=True)}'>"
        f"<b>{words.percent(one['share'])}</b>"
        f"<span>{escape(_axis(one['axis']))}: {escape(one['place'])}</span></button>"
        for one in session.worst()
    ]
    ui.html("".join(rows) or "<p>Nothing stands out from the noise.</p>", sanitize=False)
    onward(bench, 3)


def errors(bench: Bench) -> str:
    """Return an HTML table of errors and noise floor by axis; empty before the first prediction.

    Args:
        bench: State of the tab, with the errors of the vehicle on the page.
    """
    session = bench.session
    found = bench.shown
    if found is None:
        return ""
    floors = session.floors()
    rows = [f"<h3>Error over {found.predictions} predictions</h3><table class='table'><tr><th>axis</th>"]
    rows.append("<th>error</th><th>noise floor</th><th>ratio</th></tr>")
    for name, error in zip((*VELOCITY, "all"), (*found.axes, found.all), strict=True):
        floor = floors.get(name)
        ratio = f"{error / floor:.1f}" if floor and math.isfinite(error) else ""
        unit = UNITS.get(name, "m/s")
        told = words.figure(error) if math.isfinite(error) else "–"
        cells = (f"{name} [{unit}]", told, words.figure(floor, 2), ratio)
        rows.append("<tr>" + "".join(f"<td>{one}</td>" for one in cells) + "</tr>")
    return "".join(rows) + "</table>"


def _axis(name: str) -> str:
    """Return the name of the axis on which a force acts."""
    forces = dict(zip("XYZKMN", DOF, strict=True))
    return forces.get(name, name)
