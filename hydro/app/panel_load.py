"""Panel of step 1: choose a recording and a vehicle, correct the map, and read a summary of the import."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

from nicegui import ui

from hydro.app import opening
from hydro.app.bench import Bench
from hydro.app.places import LOGS
from hydro.core.guessing.map_lines import KINDS

SIZE = 65536
"""Bytes of a TOML file that are searched for the mark of a vehicle."""
PROPOSE = "propose one; none for a raw table"
IN_RECORDING = "the one in the recording, or a preset that fits"


def show(bench: Bench) -> None:
    """Make the panel."""
    choice = bench.tab.choice
    ui.html("<h2>Load a recording and a vehicle</h2>", sanitize=False)
    with ui.element("div").classes("row"):
        ui.button("Sample: hidden effects", on_click=bench.open_sample).props("outline dense no-caps").mark(
            "sample"
        )
        ui.button("Upload …", on_click=lambda: bench.client.run_javascript(PICK)).props(
            "outline dense no-caps"
        )
    ui.html("<p>Or drop a log, a map or a vehicle file anywhere.</p>", sanitize=False)
    logs = {str(one): _named(bench, one) for one in bench.desk.places.listed(LOGS)}
    logs |= {one: f"{Path(one).name} (uploaded)" for one in bench.desk.uploaded if not one.endswith(".toml")}
    chosen_already = (*choice.logs, choice.holdout, choice.before)
    logs |= {one: Path(one).name for one in chosen_already if one and one not in logs}

    def chosen(event: Any) -> None:
        picked = event.value or []
        choice.logs, choice.map, bench.tab.proposed = tuple(picked), "", None

    ui.html("<h3>Recording</h3>", sanitize=False)
    ui.select(logs, value=list(choice.logs), multiple=True, on_change=chosen, with_input=True).props(
        "dense outlined options-dense"
    ).mark("recording")
    _further(bench, logs)
    craft = {"": IN_RECORDING, **{path: name for name, path in opening.presets().items()}}
    tomls = bench.desk.places.listed((".toml",))
    craft |= {str(one): _named(bench, one) for one in tomls if is_vehicle(one)}
    craft |= {one: f"{Path(one).name} (uploaded)" for one in bench.desk.uploaded if is_vehicle(one)}
    craft |= (
        {choice.vehicle: Path(choice.vehicle).name} if choice.vehicle and choice.vehicle not in craft else {}
    )

    def flown(event: Any) -> None:
        choice.vehicle = event.value or ""

    ui.html("<h3>Vehicle</h3>", sanitize=False)
    ui.select(craft, value=choice.vehicle, on_change=flown).props("dense outlined options-dense").mark(
        "vehicle"
    )
    maps = {"": PROPOSE, **{str(one): _named(bench, one) for one in tomls if is_map(one)}}
    maps |= {one: f"{Path(one).name} (uploaded)" for one in bench.desk.uploaded if is_map(one)}
    maps |= {choice.map: Path(choice.map).name} if choice.map and choice.map not in maps else {}

    def mapped(event: Any) -> None:
        choice.map = event.value or ""

    ui.html("<h3>Map of the log</h3>", sanitize=False)
    ui.select(maps, value=choice.map, on_change=mapped).props("dense outlined options-dense").mark("map")
    ui.button("Open", on_click=bench.open).props("unelevated dense no-caps color=primary").mark("open")
    if bench.problem:
        ui.html(f"<div class='said warning'>{escape(bench.problem)}</div>", sanitize=False).mark("problem")
    _map(bench)
    _understood(bench)


def _further(bench: Bench, logs: dict[str, str]) -> None:
    """Make the menus for a held-out recording and one from before a change."""
    choice = bench.tab.choice

    def held_out(event: Any) -> None:
        choice.holdout = event.value or ""

    def earlier(event: Any) -> None:
        choice.before = event.value or ""

    for title, value, chosen, mark in (
        ("Held-out recording (optional)", choice.holdout, held_out, "holdout"),
        ("Recording before a change (optional)", choice.before, earlier, "before"),
    ):
        ui.html(f"<h3>{title}</h3>", sanitize=False)
        ui.select({"": "none", **logs}, value=value, on_change=chosen).props(
            "dense outlined options-dense"
        ).mark(mark)


def _map(bench: Bench) -> None:
    """Make the editor of the proposed map: a line for each block, and menus for units and frames."""
    found = bench.tab.proposed
    if found is None:
        return
    ui.html("<h3>Map of the log</h3>", sanitize=False)
    ui.html(
        "<p>Columns and words such as ENU or deg; “none” leaves a sensor out. Then press Open.</p>",
        sanitize=False,
    )
    for name in KINDS:
        with ui.element("div").classes("map"):
            ui.label(name)
            with ui.element("div"):
                line = (
                    ui.input(value=found.lines[name])
                    .props("dense outlined")
                    .classes("w-full")
                    .mark(f"map-{name}")
                )
                line.on("change", lambda _, n=name, one=line: bench.change_map(n, str(one.value)))
                if name in found.blocks:
                    with ui.element("div").classes("row"):
                        _menus(bench, name, found.blocks[name])
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
        ui.html(f"<div class='said warning'>{escape(opened.audit)}</div>", sanitize=False)

        async def accept() -> None:
            bench.tab.choice.correct = True
            await bench.open()

        ui.button("Continue with the directions of the audit", on_click=accept).props("outline dense no-caps")
    for line in opened.lines:
        kind = "warning" if line.startswith("warning") else ""
        ui.html(f"<div class='said {kind}'>{escape(line)}</div>", sanitize=False)


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
