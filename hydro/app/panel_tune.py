"""Panel of step 4: switches for the effects, sliders for their parameters, and the fit."""

from __future__ import annotations

from functools import partial
from html import escape

from nicegui import ui

from hydro.app.bench import Bench
from hydro.app.buttons import button
from hydro.app.panel import begun, onward
from hydro.app.parameters import Slider
from hydro.core.effects import CATALOGUE
from hydro.report import words

MOST_OPEN = 4
"""Maximum number of effects whose numbers are shown at once; the oldest closes."""


def show(bench: Bench) -> None:
    """Put the panel of step 4 on the page: switches of the effects, sliders of their parameters, and the fit.

    Args:
        bench: State and actions of the tab.
    """
    session = bench.session
    if begun(bench, "Add effects and tune their numbers") is None:
        return
    with ui.element("div").classes("row"):
        button(bench, "Fit the ticked", bench.fit, look="first").set_enabled(not bench.busy)
        if session.diagnosed:
            add = button(bench, "Add the best finding", partial(bench.add, "best"))
            add.set_enabled(not session.over and not bench.busy)
    if bench.problem:
        ui.html(f"<div class='said warning'>{escape(bench.problem)}</div>", sanitize=False)
    ui.html("<p>A click on a name shows its numbers. Ticked numbers are fitted.</p>", sanitize=False)
    present = [name for name, on in session.switches() if on]
    absent = [name for name, on in session.switches() if not on]
    ui.html("<h3>Effects of the vehicle</h3>", sanitize=False)
    ui.html("".join(_effect(bench, name, on=True) for name in present), sanitize=False)
    ui.html("<h3>Other effects of the catalogue</h3>", sanitize=False)
    ui.html("".join(_effect(bench, name, on=False) for name in absent), sanitize=False)
    onward(bench, 5)


def toggle(bench: Bench, effect: str) -> None:
    """Show the sliders of an effect on the page if they are hidden; hide them otherwise.

    Args:
        bench: State and actions of the tab.
        effect: Name of the effect.
    """
    shown = opened(bench)
    if effect in shown:
        shown.remove(effect)
    else:
        shown.append(effect)
    del shown[:-MOST_OPEN]


def opened(bench: Bench) -> list[str]:
    """Return the names of the effects whose sliders are shown.

    At first only the sliders of the vehicle's first effect other than inertia are shown.

    Args:
        bench: State of the tab.
    """
    if bench.unfolded is None:
        own = [str(one["name"]) for one in bench.session.present.effect]
        bench.unfolded = [one for one in own if CATALOGUE[one].kind != "inertia"][:1]
    return bench.unfolded


def _effect(bench: Bench, name: str, *, on: bool) -> str:
    """Return the HTML of an effect: its switch, and its sliders if they are shown."""
    record = CATALOGUE[name]
    remark = " (random: not in predictions)" if record.is_random else ""
    head = (
        f"<div class='head'><input type='checkbox' data-switch='{escape(name)}' {'checked' if on else ''} "
        f"aria-label='switch {escape(name)}'>"
        f"<span class='name {'on' if on else ''}' data-do='open_effect' data-with='{escape(name)}' "
        f"title='{escape(record.definition, quote=True)}'>"
        f"{escape(words.effect_name(name))}{remark}</span></div>"
    )
    if not on or name not in opened(bench):
        return f"<div class='effect'>{head}</div>"
    rows, seen = [], set[str]()
    for one in bench.offered(name):
        rows.append(_number(bench, one, first=one.parameter not in seen))
        seen.add(one.parameter)
    return f"<div class='effect'>{head}{''.join(rows)}</div>"


def _number(bench: Bench, one: Slider, *, first: bool) -> str:
    """Return the HTML of one slider: tick of its parameter, slider, field and unit.

    Args:
        bench: The workbench.
        one: The slider.
        first: Whether it is the first slider of its parameter, which carries the tick.
    """
    key, parameter = escape(one.key, quote=True), escape(f"{one.effect}.{one.parameter}", quote=True)
    ticked = "checked" if f"{one.effect}.{one.parameter}" in bench.session.ticked else ""
    tick = (
        f"<input type='checkbox' data-tick='{parameter}' {ticked} title='fit {parameter}'>" if first else ""
    )
    if one.known:
        tick = "<span title='known: no fit changes it'>=</span>"
    ends = f"{one.low:.4g} to {one.high:.4g} {escape(one.unit)}"
    return (
        f"<div class='number'><span>{tick}</span><span class='label' title='{key}'>{escape(one.label)}</span>"
        f"<input type='range' data-slide='{key}' min='{one.low:.9g}' max='{one.high:.9g}' step='any' "
        f"value='{one.value:.9g}' title='{ends}' aria-label='{key}'>"
        f"<input type='number' data-number='{key}' step='{one.step:.9g}' value='{one.value:.5g}' "
        f"aria-label='{key}'>"
        f"<span class='unit'>{escape(one.unit)}</span></div>"
    )
