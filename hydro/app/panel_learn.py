"""Panel of step 3: diagnose the vehicle, and read the findings as cards."""

from __future__ import annotations

from functools import partial
from html import escape
from typing import Any

from nicegui import ui

from hydro.app.bench import Bench
from hydro.app.buttons import button
from hydro.app.panel import begun, onward
from hydro.core.diagnosis.findings import WITH_VALUES, extended, tables
from hydro.core.effects import CATALOGUE
from hydro.core.errors import HydroError
from hydro.core.vehicle.description import Vehicle
from hydro.report import diagnosis, words
from hydro.report.cards import ADDED
from hydro.report.diagnosis import Context

UNSEEN = "not_excited"
"""Verdict on an effect that the recording cannot show."""


def show(bench: Bench) -> None:
    """Put the panel of step 3 on the page: diagnose the vehicle, and show the findings and their forces.

    Args:
        bench: State and actions of the tab.
    """
    session = bench.session
    if begun(bench, "Learn which effects are missing") is None:
        return
    with ui.element("div").classes("row"):
        told = "Diagnosed" if session.diagnosed else "Diagnose"
        button(bench, told, bench.diagnose, look="first").set_enabled(
            not session.diagnosed and not bench.busy
        )
        if session.diagnosed:
            add = button(bench, "Add the best", partial(bench.add, "best"))
            add.set_enabled(not session.over and not bench.busy)
    bench.so_far = ui.label(bench.provisional).classes("hint")
    if bench.problem:
        ui.html(f"<div class='said warning'>{escape(bench.problem)}</div>", sanitize=False)
    if not session.diagnosed:
        ui.html(
            "<p>The diagnosis tries every effect of the catalogue against the recording. It takes from ten "
            "seconds to a few minutes, in the background: the curves and sliders stay usable.</p>",
            sanitize=False,
        )
        return
    if session.over:
        ui.html(f"<div class='said'>{escape(session.over.capitalize())}.</div>", sanitize=False)
    else:
        ui.html(
            "<p>“Add” puts a finding into the vehicle, fits its numbers and diagnoses again. The error "
            "ladder shows the new error.</p>",
            sanitize=False,
        )
    if session.at:
        onward(bench, 5)
    unseen = []
    for row in session.findings:
        if row["verdict"] == UNSEEN:
            unseen.append(words.effect_name(row["effect"]))
        else:
            _card(bench, row)
    if unseen:
        ui.html(f"<p>Not visible in this recording: {escape(', '.join(unseen))}.</p>", sanitize=False)


def _card(bench: Bench, row: dict[str, Any]) -> None:
    """Make the card of one finding, a row of the diagnosis."""
    session = bench.session
    live = session.live
    assert live is not None
    about = Context(session.rung.steps[-1].vehicle, live.record.dt)
    told, sentence = words.verdict(row)
    if row["verdict"] in diagnosis.TITLES:
        told, sentence = diagnosis.title(row, about), diagnosis.said(row, about) or sentence
    sure, facts = diagnosis.sureness(row), diagnosis.facts(row)
    lines = [f"<div class='title'>{escape(told)}</div>"]
    lines += [f"<div class='sure'>{escape(sure)}</div>"] if sure else []
    lines += [f"<div>{escape(sentence)}</div>"] if sentence else []
    lines += [f"<div class='facts'>{escape(facts)}</div>"] if facts else []
    if row["advice"] and row["verdict"] not in ADDED:
        lines.append(f"<div class='advice'>{escape(row['advice'])}</div>")
    with ui.element("div").classes(f"card {row['verdict']}"):
        ui.html("".join(lines), sanitize=False)
        if row["verdict"] not in WITH_VALUES or not row["parameters"]:
            return
        effect, place = row["effect"], f"force-{row['rank']}"
        with ui.element("div").classes("row"):
            add = button(bench, "Add", partial(bench.add, effect), key=f"add {effect}")
            add.set_enabled(not bench.busy)
            if CATALOGUE[effect].kind != "sensor":

                async def draw() -> None:
                    try:
                        vehicle = _with(session.rung.vehicle, row)
                    except HydroError as error:
                        bench.say(str(error))
                        return
                    await bench.show_force(effect, vehicle, place)

                button(bench, "Show its force", draw, look="flat", key=f"show {effect}")
        ui.html(f"<div id='{place}'></div>", sanitize=False)


def _with(vehicle: Vehicle, row: dict[str, Any]) -> Vehicle:
    """Return a vehicle with the effect of one finding added, a row of the diagnosis."""
    import polars as pl

    return extended(vehicle, tables(pl.DataFrame([row]), [row["effect"]]))
