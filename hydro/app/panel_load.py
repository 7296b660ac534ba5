"""Panel of step 1: choose a recording and a vehicle, correct the map, and read a summary of the import."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

from nicegui import ui

from hydro.app import opening, panel_vehicle
from hydro.app.bench import Bench
from hydro.app.buttons import button
from hydro.app.panel import onward
from hydro.app.places import LOGS
from hydro.core.guessing.interview import MEANINGS
from hydro.core.guessing.map_lines import EXAMPLES, KINDS
from hydro.io import covariance

SIZE = 65536
"""Bytes of a TOML file that are searched for the mark of a vehicle."""
PROPOSE = "propose one; none for a raw table"
IN_RECORDING = "the one in the recording, or a preset that fits"
PURPOSE = (
    "Compare a vehicle model with a recording, find the effects that it lacks, add them, and save the file."
)
SAMPLE_IS_OPEN = (
    f"{PURPOSE} The bundled sample is open: choose your own recording, or continue with the sample."
)
WARNING = "warning: "
"""Beginning of a line of the import that needs attention."""
MOST_COLUMNS = 2000
"""Maximum number of columns that are listed, so that a large log does not slow the page."""


def show(bench: Bench) -> None:
    """Put the panel of step 1 on the page: choose recording and vehicle, correct the map of the log.

    The panel also shows a summary of the import.

    Args:
        bench: State and actions of the tab.
    """
    ui.html("<h2>Load a recording and a vehicle</h2>", sanitize=False)
    ui.html(f"<p>{SAMPLE_IS_OPEN if bench.shows_sample else PURPOSE}</p>", sanitize=False)
    with ui.element("div").classes("row"):

        def pick() -> None:
            bench.client.run_javascript(PICK)

        button(bench, "Upload …", pick)
        button(bench, "Sample: hidden effects", bench.open_sample)
    ui.html("<p>Or drop a log, a map or a vehicle file anywhere.</p>", sanitize=False)
    logs = _recordings(bench)
    ui.html("<h3>Recording: a raw table, or the logs of one dive</h3>", sanitize=False)
    _menu_of_recordings(bench, logs)
    ui.html("<h3>Vehicle</h3>", sanitize=False)
    _menu_of_vehicles(bench)
    with _fold(bench, "own", "My vehicle has no file: describe it"):
        panel_vehicle.show(bench)
    with _fold(bench, "more", "Optional: held-out or earlier recording, map"):
        _further(bench, logs)
        ui.html("<h3>Map of the log</h3>", sanitize=False)
        _menu_of_maps(bench)
    button(bench, "Open", bench.open, look="first")
    bench.menus = menus(bench)

    @ui.refreshable
    def below() -> None:
        _below(bench)

    below()
    bench.refresh_below = below.refresh


def menus(bench: Bench) -> tuple[Any, ...]:
    """Return the state of the menus of step 1 as a tuple to compare: the menus are drawn only if it changed.

    A menu that is drawn again closes, also while a person chooses from it.

    Args:
        bench: State of the tab.
    """
    choice = bench.tab.choice
    chosen = (choice.logs, choice.vehicle, choice.guess, choice.map, choice.holdout, choice.before)
    return (*chosen, tuple(bench.desk.uploaded), bench.commands, bench.folds.get("own"))


def _below(bench: Bench) -> None:
    """Make the part below the menus: the last problem, the result of opening, and the map."""
    if bench.problem:
        ui.html(f"<div class='said warning'>{escape(bench.problem)}</div>", sanitize=False)
    if bench.opens_choice:
        _understood(bench)
        onward(bench, 2)
        if bench.tab.proposed is not None:
            with _fold(bench, "map", "Map of the log: correct it"):
                _map(bench)
    else:
        _map(bench)


def _recordings(bench: Bench) -> dict[str, str]:
    """Return the recordings to choose from with their names: those listed, uploaded and chosen."""
    choice = bench.tab.choice
    found = [
        one for one in bench.desk.places.listed(LOGS) if not one.name.endswith(f".{covariance.KIND}.parquet")
    ]
    logs = {str(one): _named(bench, one) for one in found}
    logs |= {one: f"{Path(one).name} (uploaded)" for one in bench.desk.uploaded if not one.endswith(".toml")}
    if opening.sample()[1] in choice.logs:
        logs[opening.sample()[1]] = f"the sample: {opening.SAMPLE}"
    chosen_already = (*choice.logs, choice.holdout, choice.before)
    return logs | {one: Path(one).name for one in chosen_already if one and one not in logs}


def _menu_of_recordings(bench: Bench, logs: dict[str, str]) -> None:
    """Make the menu of recordings."""

    def chosen(event: Any) -> None:
        if bench.choose(tuple(event.value or ())):
            bench.refresh()

    ui.select(
        logs, value=list(bench.tab.choice.logs), multiple=True, on_change=chosen, with_input=True
    ).props("dense outlined options-dense")


def _menu_of_vehicles(bench: Bench) -> None:
    """Make the menu of vehicle files."""
    choice = bench.tab.choice
    craft = {"": IN_RECORDING, **{path: name for name, path in opening.presets().items()}}
    craft |= {str(one): _named(bench, one) for one in _tomls(bench) if is_vehicle(one)}
    craft |= {one: f"{Path(one).name} (uploaded)" for one in bench.desk.uploaded if is_vehicle(one)}
    if choice.vehicle and choice.vehicle not in craft:
        craft[choice.vehicle] = Path(choice.vehicle).name
    ui.select(
        craft, value=choice.vehicle, on_change=lambda event: bench.choose_vehicle(event.value or "")
    ).props("dense outlined options-dense")
    if choice.guess:
        ui.html(f"<p>{escape(choice.guess)}</p>", sanitize=False)


def _menu_of_maps(bench: Bench) -> None:
    """Make the menu of map files."""
    choice = bench.tab.choice
    maps = {"": PROPOSE, **{str(one): _named(bench, one) for one in _tomls(bench) if is_map(one)}}
    maps |= {one: f"{Path(one).name} (uploaded)" for one in bench.desk.uploaded if is_map(one)}
    if choice.map and choice.map not in maps:
        maps[choice.map] = Path(choice.map).name

    def mapped(event: Any) -> None:
        choice.map = event.value or ""

    ui.select(maps, value=choice.map, on_change=mapped).props("dense outlined options-dense")


def _tomls(bench: Bench) -> list[Path]:
    """Return the listed vehicle and map files."""
    return bench.desk.places.listed((".toml",))


def _fold(bench: Bench, key: str, title: str) -> ui.expansion:
    """Return a part of the panel that unfolds; it stays as it is when the panel is drawn again."""

    def turned(event: Any) -> None:
        bench.folds[key] = bool(event.value)

    part = ui.expansion(title, value=bench.folds.get(key, False), on_value_change=turned)
    return part.props("dense dense-toggle")


def _further(bench: Bench, logs: dict[str, str]) -> None:
    """Make the menus for a held-out recording and one from before a change."""
    choice = bench.tab.choice

    def held_out(event: Any) -> None:
        choice.holdout = event.value or ""

    def earlier(event: Any) -> None:
        choice.before = event.value or ""

    for title, value, chosen in (
        ("Held-out recording", choice.holdout, held_out),
        ("Recording before a change", choice.before, earlier),
    ):
        ui.html(f"<h3>{title}</h3>", sanitize=False)
        ui.select({"": "none", **logs}, value=value, on_change=chosen).props("dense outlined options-dense")


def _map(bench: Bench) -> None:
    """Make the editor of the proposed map: a line for each block, and menus for units and frames."""
    found = bench.tab.proposed
    if found is None:
        return
    ui.html("<h3>Map of the log</h3>", sanitize=False)
    ui.html(
        "<p>Each line names the columns of a sensor, then its axes and unit; “none” leaves a sensor out. "
        "A click on a column adds it to the line. The motion corrects axes and units. Then press Open.</p>",
        sanitize=False,
    )
    ui.html(f"<h3>{len(found.columns):,} columns of the log</h3>", sanitize=False)
    names = "".join(f"<span>{escape(one)}</span> " for one in found.columns[:MOST_COLUMNS])
    ui.html(f"<div class='columns'>{names}</div>", sanitize=False)
    for name in KINDS:
        with ui.element("div").classes("map"):
            ui.label(name).tooltip(MEANINGS[name])
            with ui.element("div"):
                line = ui.input(value=found.lines[name]).props("dense outlined").classes("w-full")
                line.on("change", lambda _, n=name, one=line: bench.change_map(n, str(one.value)))
                if name in found.blocks:
                    with ui.element("div").classes("row"):
                        _menus(bench, name, found.blocks[name])
                else:
                    ui.html(f"<p>such as {escape(EXAMPLES[name])}</p>", sanitize=False)
    for note in found.notes:
        ui.html(f"<div class='said'>{escape(note)}</div>", sanitize=False)


def _menus(bench: Bench, name: str, block: Any) -> None:
    """Make the menus for the settings of a block."""
    for key, words in opening.settings(name, block).items():
        value = block.get(key, words[0])
        ui.select(
            list(words),
            value=value,
            label=key,
            on_change=lambda e, k=key: bench.change_setting(name, k, e.value),
        ).props("dense options-dense").style("min-width: 84px")


def _understood(bench: Bench) -> None:
    """List the results of the import: rows, gaps, clock, frames, cleaning, thrusters."""
    opened = bench.session.opened
    if opened is None:
        return
    ui.html(f"<h3>Understood: {escape(opened.name)}</h3>", sanitize=False)
    if opened.audit:
        _contradiction(bench, opened.audit)
    for line in opened.lines:
        if opened.audit and _claim(line) == _claim(opened.audit):
            continue
        kind = "warning" if line.startswith(WARNING) else ""
        ui.html(f"<div class='said {kind}'>{escape(line)}</div>", sanitize=False)


def _contradiction(bench: Bench, audit: str) -> None:
    """Show that the thrusters contradict the vehicle file, with the ways on."""
    advice = (
        f"{_claim(audit)}. If this is the right vehicle, continue with these directions; else choose another"
    )
    ui.html(f"<div class='said warning'>{escape(advice)} vehicle.</div>", sanitize=False)

    async def accept() -> None:
        bench.tab.choice.correct = True
        await bench.open()

    button(bench, "Continue with the directions of the audit", accept)


def _claim(line: str) -> str:
    """Return a line of the audit without its advice."""
    return line.removeprefix(WARNING).partition(": ")[0]


def is_vehicle(path: str | Path) -> bool:
    """Return whether a TOML file is a vehicle file."""
    return b"[rigid_body]" in _head(path)


def is_map(path: str | Path) -> bool:
    """Return whether a TOML file is a map of a log."""
    return b"hydro-map" in _head(path)


def _head(path: str | Path) -> bytes:
    """Return the first bytes of a TOML file; empty for an unreadable file or another format."""
    if Path(path).suffix.lower() != ".toml":
        return b""
    try:
        with Path(path).open("rb") as file:
            return file.read(SIZE)
    except OSError:
        return b""


def _named(bench: Bench, path: Path) -> str:
    """Return a path relative to the folder of the workbench that holds it."""
    folder = next((one for one in bench.desk.places.folders if path.is_relative_to(one)), path.parent)
    return str(path.relative_to(folder))


PICK = (
    "const pick = document.createElement('input'); pick.type = 'file'; pick.multiple = true;"
    "pick.onchange = () => workbench.upload([...pick.files]); pick.click();"
)
"""Script that lets a user pick files, and uploads them."""
