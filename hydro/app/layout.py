"""Parts of the page of a tab: steps, progress, undo, panel, error and ladder, in the places of the frame."""

from __future__ import annotations

import math
import time
from functools import partial
from html import escape
from typing import Any

from nicegui import events, ui

from hydro.app import panel_compare, panel_keep, panel_learn, panel_load, panel_tune
from hydro.app.bench import Bench
from hydro.app.buttons import button, press
from hydro.app.frame import STEPS, Frame
from hydro.report import words

PANELS = (panel_load.show, panel_compare.show, panel_learn.show, panel_tune.show, panel_keep.show)
"""Panel of each step."""
REFRESH = 0.4
"""Interval at which the progress of work is shown [s]."""


class Layout:
    """Content of the page of one tab of the workbench, from steps and panel to the error and its ladder.

    The error ladder is a chart of the errors of all states in the history.
    """

    def __init__(self, bench: Bench, frame: Frame) -> None:
        """Connect the page's events with the actions of the tab."""
        self.bench, self.frame, self._drawn = bench, frame, 0
        bench.refresh = self.refresh
        bench.refresh_error = self.refresh_error

    def fill(self) -> None:
        """Put the elements of the page into the frame's places, and connect the events of the page."""
        frame = self.frame
        for place, show in (
            (frame.steps, self._steps),
            (frame.busy, self._busy),
            (frame.history, self._history),
            (frame.panel, self._panel),
        ):
            place.clear()
            with place:
                show()
        for name, handler in (
            ("window", self._window),
            ("slide", self._slide),
            ("settle", self._settle),
            ("tick", self._tick),
            ("switch", self._switch),
            ("do", self._do),
            ("step", self._step),
            ("undo", lambda e: self._undo(e.args)),
            ("uploading", self._uploading),
            ("uploaded", self._uploaded),
        ):
            ui.on(f"workbench_{name}", handler)
        ui.timer(REFRESH, self._progress)
        self._head()

    def refresh(self) -> None:
        """Draw all parts of the page except the curves again, as the session now is."""
        with self.bench.client:
            self._steps.refresh()
            if self.bench.tab.step == self._drawn == 1 and self.bench.menus == panel_load.menus(self.bench):
                self.bench.refresh_below()
            else:
                self._panel.refresh()
            self._busy.refresh()
            self._head()

    def refresh_error(self) -> None:
        """Show the present error of the vehicle on the page."""
        self.frame.error.set_content(_error(self.bench))
        if (table := self.bench.table) is not None and not table.is_deleted:
            table.set_content(panel_compare.errors(self.bench))

    @ui.refreshable_method
    def _steps(self) -> None:
        with ui.element("nav").classes("steps"):
            for number, title in enumerate(STEPS, 1):
                here = "here" if number == self.bench.tab.step else ""
                button(
                    self.bench,
                    f"{number} {title}",
                    partial(self.bench.show_step, number),
                    look="flat",
                    color=None,
                ).classes(here)

    def _history(self) -> None:
        self.undo, self.redo = (
            ui.button(icon=way, on_click=lambda w=way: self._undo(w)).props(
                f"flat dense round size=sm aria-label={way}"
            )
            for way in ("undo", "redo")
        )

    @ui.refreshable_method
    def _panel(self) -> None:
        self._drawn = self.bench.tab.step
        PANELS[self._drawn - 1](self.bench)

    @ui.refreshable_method
    def _busy(self) -> None:
        bench = self.bench
        if not bench.busy:
            return
        with ui.element("div").classes("busy"):
            self.spinner = ui.circular_progress(bench.share, show_value=False, size="20px")
            self.doing = ui.label(bench.busy).classes("doing")
            button(bench, "Cancel", bench.cancel, look="flat").props("size=sm")

    def _progress(self) -> None:
        if self.bench.busy and hasattr(self, "doing") and not self.doing.is_deleted:
            seconds = time.monotonic() - self.bench.began
            said = self.bench.busy.replace("_", " ")
            self.doing.set_text(f"{100 * self.bench.share:.0f} %, {seconds:.0f} s: {said}")
            self.spinner.set_value(self.bench.share)
            if (label := self.bench.so_far) is not None and not label.is_deleted:
                label.set_text(self.bench.provisional)

    def _head(self) -> None:
        session, bench = self.bench.session, self.bench
        if session.opened is not None:
            self.frame.title.set_text(f"{session.present.name} · {session.opened.name}")
        self.undo.set_enabled(session.can_undo)
        self.redo.set_enabled(session.can_redo)
        self.refresh_error()
        bench.client.run_javascript(f"workbench.ladder({_quoted(_ladder(bench))})")

    # Events of the page's script

    async def _window(self, event: events.GenericEventArguments) -> None:
        low, high = event.args
        await self.bench.draw_window(float(low), float(high))

    def _slide(self, event: events.GenericEventArguments) -> None:
        key, value = event.args
        self.bench.slide(str(key), value)

    async def _settle(self, event: events.GenericEventArguments) -> None:
        key, value = event.args
        await self.bench.settle(str(key), value)

    def _tick(self, event: events.GenericEventArguments) -> None:
        key, on = event.args
        self.bench.tick(str(key), bool(on))

    async def _switch(self, event: events.GenericEventArguments) -> None:
        effect, on = event.args
        await self.bench.switch(str(effect), bool(on))

    def _step(self, event: events.GenericEventArguments) -> None:
        self.bench.show_step(min(max(int(event.args), 1), len(STEPS)))

    async def _undo(self, way: Any) -> None:
        session = self.bench.session
        if session.history:
            await self.bench.go(session.at + (1 if way == "redo" else -1))

    def _uploading(self, event: events.GenericEventArguments) -> None:
        ui.notify(f"uploading {event.args}", position="bottom-right")

    def _uploaded(self, event: events.GenericEventArguments) -> None:
        told = event.args
        if not told.get("ok"):
            self.bench.say(str(told.get("text", "")).removeprefix("hydro app: "))
            return
        path, choice = str(told["text"]), self.bench.tab.choice
        if path not in self.bench.desk.uploaded:
            return
        if path.endswith(".toml"):
            if panel_load.is_vehicle(path):
                self.bench.choose_vehicle(path)
            else:
                choice.map = path
        else:
            self.bench.choose((path,))
        self.bench.tab.step = 1
        self.refresh()

    async def _do(self, event: events.GenericEventArguments) -> None:
        what, about = event.args
        bench = self.bench
        if what == "press":
            await press(bench, str(about))
        elif what == "rung":
            await bench.go(int(about))
        elif what == "place":
            await bench.jump(str(about))
        elif what == "open_effect":
            panel_tune.toggle(bench, str(about))
            self._panel.refresh()


def _quoted(text: str) -> str:
    """Return a text as a string literal of JavaScript."""
    import orjson

    return orjson.dumps(text).decode()


def _error(bench: Bench) -> str:
    """Return the error of the vehicle that the page shows, and the noise floor, as HTML."""
    shown, session = bench.shown, bench.session
    if shown is None or not math.isfinite(shown.all):
        return ""
    floor = session.floors().get("all")
    told = f" <span class='floor'>noise floor {words.figure(floor, 2)}</span>" if floor else ""
    ahead = "whole run" if session.horizon is None else f"{session.horizon:g} s ahead"
    count = f"{shown.predictions} predictions, {ahead}"
    return f"<span title='{count}'>error <span id='error'>{words.figure(shown.all)}</span> m/s</span>{told}"


def _figure(error: float) -> str:
    """Return an error as text; a dash if it is NaN."""
    return words.figure(error) if math.isfinite(error) else "–"


def _ladder(bench: Bench) -> str:
    """Return the error ladder as HTML: the states of the history with the error of each."""
    session = bench.session
    if not session.history:
        return "<h3>error ladder</h3><p class='hint'>opening …</p>"
    most = max((one.error for one in session.history if math.isfinite(one.error)), default=1.0) or 1.0
    rows = ["<h3>error ladder: predictions 5 s ahead [m/s]</h3>"]
    for number, one in enumerate(session.history):
        kind = "here" if number == session.at else "undone" if number > session.at else ""
        width = 100.0 * one.error / most if math.isfinite(one.error) else 0.0
        rows.append(
            f"<button class='rung {kind}' data-do='rung' data-with='{number}'><span>{number}</span>"
            f"<span class='name' title='{escape(one.label)}'>{escape(one.label)}</span>"
            f"<span><span class='bar' style='display:block;width:{width:.1f}%'></span></span>"
            f"<span class='number'>{_figure(one.error)}</span></button>"
        )
    if bench.remark:
        rows.append(f"<p class='hint'>{escape(bench.remark)}</p>")
    return "".join(rows)
