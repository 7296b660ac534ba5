"""One tab of the page: carries out the actions of the user, and sends the page its drawings."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from nicegui import background_tasks, ui

from hydro.app import drawing, jobs, opening
from hydro.app.desk import Choice, Desk, Tab
from hydro.app.live import Errors
from hydro.app.opening import Craft
from hydro.app.parameters import Slider
from hydro.app.session import Session
from hydro.app.worker import Cancelled
from hydro.core.diagnosis.provisional import Provisional
from hydro.core.diagnosis.status import in_words
from hydro.core.errors import DataError, HydroError, listed
from hydro.core.explanation.explain import BEST
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as vehicles
from hydro.io.files import write_bytes
from hydro.report import words

POINTS = 1200
"""Points of a curve: twice the pixels of a panel on a usual screen."""
MODIFIED = "vehicle-new.toml"
"""Name under which the page offers to save the vehicle."""
LOADING = ("opening", "comparing")
"""Work that the page begins by itself, so that opening another recording may cancel it."""
POLL = 0.05
"""Interval at which the end of cancelled work is awaited [s]."""


class Bench:
    """State and actions of one tab of the workbench.

    Attributes:
        desk: The server.
        tab: The tab.
        busy: Words on the running work; empty if nothing runs.
        share: Share of the running work that is done, 0 to 1.
        began: Time at which the running work began, by the monotonic clock [s].
        provisional: Best candidate of a diagnosis that is still running, in words.
        problem: Last problem in one line, for the user.
        remark: Last remark, for the user.
        window: Range of time that the curves show [s].
        unfolded: Effects whose numbers are shown; None before they are first shown.
        saved: Descriptions of the saved files, the last one first.
        so_far: Label of the provisional answer.
        table: Table of errors of step 2.
        folds: Whether each part of the panel that can be folded is unfolded.
        menus: State of the menus of step 1 when they were last drawn; empty before.
        refresh_below: Function that draws the part below the menus of step 1 again.
        actions: Function of each button by its key, as `buttons.button` fills it.
    """

    def __init__(self, desk: Desk, tab: Tab) -> None:
        """Show nothing yet; `page` sets the functions that refresh its parts."""
        self.desk, self.tab = desk, tab
        self.client = ui.context.client
        self.busy, self.share, self.began, self.provisional = "", 0.0, 0.0, ""
        self.problem = self.remark = ""
        self.folds = dict[str, bool]()
        self.menus: tuple[Any, ...] = ()
        self.refresh_below: Callable[[], Any] = lambda: None
        self.actions = dict[str, Callable[[], Any]]()
        self.window = (0.0, drawing.FIRST_WINDOW)
        self.refresh: Callable[[], None] = lambda: None
        self.refresh_error: Callable[[], None] = lambda: None
        self.shown: Errors | None = None
        self.unfolded: list[str] | None = None
        self.saved: list[str] = []
        self.so_far: ui.label | None = None
        self.table: ui.html | None = None
        self._sliders = dict[str, Slider]()
        self._evaluating = self._again = False
        self._openings = 0
        self._jumped = -1.0  # start of the stretch that `jump` showed last [s]
        self._toast: ui.notification | None = None
        tab.owner = self.client.id

    @property
    def session(self) -> Session:
        """Session of the tab: its open recording, vehicle and history."""
        return self.tab.session

    @property
    def owned(self) -> bool:
        """Whether this page may change the tab; False, with a message, if another page shows the same tab."""
        if self.tab.owner == self.client.id:
            return True
        self.say("this session is open in another tab: reload to take it back")
        return False

    @property
    def shows_sample(self) -> bool:
        """Whether the chosen recording is the sample that the package includes."""
        return self.tab.choice.logs == (opening.sample()[1],)

    @property
    def opens_choice(self) -> bool:
        """Whether the recording that is open is the one chosen in step 1."""
        opened = self.session.opened
        chosen = tuple(str(Path(one).resolve()) for one in self.tab.choice.logs)
        return opened is not None and tuple(str(Path(one).resolve()) for one in opened.paths) == chosen

    @property
    def commands(self) -> int:
        """Number of thruster commands in the map that was proposed for the chosen logs; 0 without a map."""
        found = self.tab.proposed
        return 0 if found is None else len(found.blocks.get("commands", {}).get("columns", ()))

    def show_step(self, number: int) -> None:
        """Show the panel of one of the workbench's five steps on the page.

        Args:
            number: Number of the step, 1 to 5.
        """
        self.tab.step = number
        self.forget_problem()
        self.refresh()

    def forget_problem(self) -> None:
        """Remove the last error message from the page."""
        self.problem = ""
        if self._toast is not None and not self._toast.is_deleted:
            self._toast.dismiss()

    def say(self, line: str) -> None:
        """Show an error message of one line on the page."""
        self.forget_problem()
        self.problem = line
        with self.client:
            self._toast = ui.notification(
                line,
                type="warning",
                position="bottom-right",
                timeout=8.0,
                close_button="close",
                multi_line=True,
            )

    # Work in the other process

    async def work(self, label: str, task: Callable[..., Any], *arguments: Any) -> Any:
        """Run a function of `app.jobs` in the worker process, show its progress, and return its result.

        Args:
            label: Name of the work for the user.
            task: The function.
            arguments: Its arguments, without the last one, which reports progress.

        Returns:
            Result of the function; None after a failure, a cancel, or if other work is running.
        """
        if self.busy:
            self.say(f"still busy: {self.busy}; wait or cancel it")
            return None
        self.busy, self.share, self.provisional = label, 0.0, ""
        self.began = time.monotonic()
        self.forget_problem()
        self.refresh()

        def told(kind: str, content: Any) -> None:
            if kind == "progress":
                said, share = content
                self.share = max(self.share, share)
                self.busy = f"{label}: {said}"
            elif kind == "notice":
                self.busy = f"{label}: {content}"
            elif isinstance(content, Provisional):
                self.provisional = (
                    f"so far: {words.effect_name(content.effect)} ({in_words(content.confidence)}), "
                    f"removes {words.percent(content.share)} of the squared error above the noise"
                )

        try:
            return await asyncio.to_thread(self.tab.worker.run, task, *arguments, report=told)
        except Cancelled:
            self.remark = f"{label}: cancelled"
        except HydroError as error:
            self.say(str(error))
        finally:
            self.busy, self.provisional = "", ""
            self.refresh()
        return None

    def cancel(self) -> None:
        """End the work that the tab's worker process is doing."""
        self.tab.worker.cancel()

    # 1, Load

    def choose(self, logs: tuple[str, ...]) -> bool:
        """Choose the recording to open.

        Return whether the menus must be drawn again, because more has changed.

        Args:
            logs: A raw table, or the logs of one dive, in the order in which they were chosen.
        """
        choice = self.tab.choice
        vehicle = choice.vehicle
        choice.choose(logs, opening.sample()[0])
        self.tab.proposed = None
        return choice.logs != logs or choice.vehicle != vehicle

    def choose_vehicle(self, path: str) -> None:
        """Choose the vehicle file to open.

        Args:
            path: Path of the file; empty for the vehicle in the recording, or a preset that fits.
        """
        choice = self.tab.choice
        if path != choice.vehicle:
            choice.vehicle, choice.guess, choice.correct = path, "", False

    async def start(self) -> None:
        """Show the open recording after a reload, otherwise open the command line's files or the sample."""
        if self.session.live is not None:
            await self.draw_all()
        elif self.tab.choice.logs:
            await self.open()
        else:
            await self.open_sample()

    async def open_sample(self) -> None:
        """Open the recording that the package includes as a sample, with its vehicle."""
        vehicle, raw = opening.sample()
        self.tab.choice = Choice(vehicle, (raw,))
        self.tab.proposed = None
        await self.open()

    async def open(self) -> None:
        """Open the chosen files; if the logs need a map and none is given, propose one first."""
        choice = self.tab.choice
        if not choice.logs:
            self.say("choose a recording first")
            return
        await self._end_loading()
        wanted, self._openings = choice.logs, self._openings + 1
        number = self._openings
        try:
            logs = [str(self._readable(one)) for one in choice.logs]
            beside = [str(self._readable(one)) if one else "" for one in (choice.holdout, choice.before)]
            table = await asyncio.to_thread(opening.is_table, logs)
            map_ = "" if table else await self._map(logs)
            if not table and not map_:
                return
            craft, guess = await asyncio.to_thread(self._craft, logs[0], map_)
        except (HydroError, OSError) as error:
            self.say(str(error))
            self.refresh()
            return
        found = await self.work("opening", jobs.open_recording, logs, map_, craft, choice.correct, *beside)
        if found is None:
            return
        self.busy = "opening: first prediction"
        self.refresh()
        try:
            await asyncio.to_thread(self.session.open, craft, found)
        except HydroError as error:
            self.say(str(error))
            return
        finally:
            self.busy = ""
            self.refresh()
        if choice.logs == wanted:  # no other recording was chosen meanwhile
            choice.vehicle, choice.guess = craft.path, guess
        if number != self._openings:
            return
        self.remark = "the thrusters contradict the vehicle file: see step 1" if found.audit else ""
        self.window = (0.0, drawing.FIRST_WINDOW)
        self.refresh()
        await self.draw_all()
        await self.compare()

    async def _end_loading(self) -> None:
        """Cancel the opening of another recording, and wait until it has ended."""
        if self.busy.startswith(LOADING):
            self.cancel()
        while self.busy.startswith(LOADING):
            await asyncio.sleep(POLL)
        self.remark = ""

    async def compare(self) -> None:
        """Compare the present vehicle with the recording: errors, noise floor, and the worst places."""
        opened = self.session.opened
        if opened is None:
            return
        found = await self.work("comparing", jobs.compare, opened.to_send, self.session.present)
        if found is not None and self.session.opened is opened:
            self.session.compared = found
            self.refresh()
            await self.draw_window(*self.window)

    async def _map(self, logs: list[str]) -> str:
        """Return the path of the chosen map, or of a proposed one; empty if the proposal is incomplete."""
        if self.tab.choice.map:
            return str(self._readable(self.tab.choice.map))
        if self.tab.proposed is None:
            vehicle = self.tab.choice.vehicle
            thrusters = len(Craft.read(self._readable(vehicle)).vehicle.thruster) if vehicle else None
            self.tab.proposed = found = await self.work("reading", jobs.propose, logs, {}, thrusters)
            if found is not None and (left := opening.unrecognised(found)) and not found.missing:
                self.say(
                    f"no columns are recognised as {listed(left)}: name them in the map below, "
                    "or press Open again to go without"
                )
                self.refresh()
                return ""
        if (found := self.tab.proposed) is None:
            return ""
        if found.missing:
            self.say(f"no columns are recognised as {listed(found.missing)}: name them in the map below")
            self.refresh()
            return ""
        return opening.write_map(found, logs, self.desk.places.uploads / f"map-{self.tab.name}.toml")

    async def change_map(self, name: str, text: str) -> None:
        """Replace a block of the proposed map by a text of the user, and test the map by the motion.

        Args:
            name: Name of the block.
            text: New text of the block; `none` removes it.
        """
        found = self.tab.proposed
        if found is None:
            return
        try:
            await self._corrected(opening.edited(found, name, text))
        except HydroError as error:
            self.say(str(error))

    async def change_setting(self, name: str, key: str, value: str) -> None:
        """Replace a setting of a block of the proposed map, such as its unit, and test the map by the motion.

        Args:
            name: Name of the block.
            key: Name of the setting.
            value: New value.
        """
        found = self.tab.proposed
        if found is not None and name in found.blocks:
            await self._corrected({**found.blocks, name: {**found.blocks[name], key: value}})

    async def _corrected(self, blocks: dict[str, Any]) -> None:
        logs = [str(self._readable(one)) for one in self.tab.choice.logs]
        made = await self.work("testing the map", jobs.correct, logs, self.tab.proposed, blocks)
        if made is not None:
            self.tab.proposed = made
            self.refresh()

    def _craft(self, log: str, map_: str) -> tuple[Craft, str]:
        """Return the chosen vehicle file; else the one in the recording, or a preset that fits it.

        Returns:
            The file, and the reason for it in words; empty if the user chose it.
        """
        choice = self.tab.choice
        if choice.vehicle:
            return Craft.read(self._readable(choice.vehicle)), choice.guess
        commands, text = (0, "") if map_ else opening.commands_of(log)
        if text:
            path = self.desk.places.uploads / f"vehicle-{self.tab.name}.toml"
            write_bytes(text.encode(), path)
            return Craft.read(path), "the vehicle file in the recording"
        if map_ and self.tab.proposed is not None:
            commands = self.commands
        fleet = [Craft.read(path) for path in opening.presets().values()]
        fitting = [
            one
            for one in fleet
            if len(one.vehicle.thruster) == commands and all(each.pushes for each in one.vehicle.thruster)
        ]
        if not fitting:
            self.folds["own"] = True
            raise DataError(
                f"no bundled vehicle has {commands} thrusters: choose or drop a file, or describe yours"
            )
        lightest = min(fitting, key=lambda one: one.vehicle.rigid_body.mass)
        return (
            lightest,
            f"guessed from {commands} commands; if it is wrong, choose the vehicle and open again",
        )

    def _readable(self, path: str) -> Path:
        """Return `path` if it may be read: bundled, in the folders, uploaded, or named on the command line.

        Raises:
            DataError: The path may not be read.
        """
        bundled = {*opening.sample(), *opening.presets().values()}
        return Path(path) if path in bundled else self.desk.places.readable(path)

    # 2, Compare: curves

    async def draw_all(self) -> None:
        """Draw track and curves of the open recording from the start."""
        if self.session.live is None:
            return
        first = drawing.begin(self.session)
        self.window = (first["window"][0], first["window"][1])
        self.send("begin", first)
        await self.draw_window(*self.window)

    async def draw_window(self, low: float, high: float) -> None:
        """Draw all curves between the times `low` and `high` [s] of the page's axis, and the error."""
        session = self.session
        if session.live is None or not (np.isfinite([low, high]).all() and high > low):
            return
        self.window = (low, high)
        vehicle = session.present

        def computed() -> tuple[dict[str, Any], Errors | None]:
            return drawing.window(session, vehicle, low, high, POINTS), session.errors()

        try:
            sent, self.shown = await asyncio.to_thread(computed)
        except HydroError as error:
            self.say(str(error))
            return
        self.send("curves", sent)
        self.refresh_error()

    async def jump(self, place: str) -> None:
        """Show the longest stretch at which the vehicle fails in one of the worst places of the comparison.

        Further calls show the next stretches in turn.

        Args:
            place: Name of the place, a key of `jobs.Compared.places`.
        """
        session = self.session
        if session.compared is None or session.live is None:
            return
        rows = session.compared.places.get(place)
        if rows is None or not len(rows):
            self.say(f"{place}: the whole recording")
            return
        starts = session.live.clock[rows[:, 0]]
        later = np.flatnonzero(np.isclose(starts, self._jumped))
        number = (int(later[0]) + 1) % len(rows) if later.size else 0
        self._jumped = float(starts[number])
        end = float(session.live.clock[rows[number, 1] - 1])
        margin = max(0.5 * (end - self._jumped), 4.0)
        await self.draw_window(max(self._jumped - margin, 0.0), end + margin)
        self.send("seek", self._jumped)

    async def set_horizon(self, horizon: float | None) -> None:
        """Set the prediction horizon [s] and redraw; None predicts whole sessions."""
        self.session.horizon = horizon
        self.refresh()
        await self.draw_window(*self.window)

    # 3, Learn

    async def diagnose(self) -> None:
        """Compare and diagnose the present vehicle, step 0 of a study as in `hydro explain`."""
        await self.add(BEST, "diagnosing")

    async def show_force(self, effect: str, vehicle: Vehicle, place: str) -> None:
        """Draw the force of one effect of a vehicle in the card of its finding.

        Args:
            effect: Name of the effect.
            vehicle: Vehicle with the effect.
            place: Name of the card on the page.
        """
        session = self.session
        if session.opened is None or session.live is None:
            return
        found = await self.work("force", jobs.force, session.opened.to_send, vehicle, vehicle.without(effect))
        if found is not None:
            self.send("forces", place, drawing.force(session.live, found))

    # 4, Add and tune

    async def add(self, effect: str, label: str = "adding") -> None:
        """Take the next step of the study: diagnose the vehicle, or add a finding to it.

        Args:
            effect: Effect of the finding; `BEST` for the best one.
            label: Name of the work for the user.
        """
        session = self.session
        if session.opened is None or not self.owned:
            return
        rung = session.rung
        wanted = effect if effect == BEST or not session.diagnosed else session.wanted(effect)
        found = await self.work(label, jobs.add_step, session.opened.to_send, rung.base, rung.steps, wanted)
        if found is None:
            return
        if session.rung is not rung:
            self.say("the vehicle was changed meanwhile: start this again")
            return
        self.remark = await asyncio.to_thread(session.accept_step, found.step, wanted)
        self.refresh()
        await self.draw_window(*self.window)

    async def fit(self) -> None:
        """Fit the ticked parameters, and make the result a state of the history."""
        session = self.session
        if session.opened is None or not self.owned:
            return
        try:
            names, held = session.to_fit()
        except HydroError as error:
            self.say(str(error))
            return
        rung = session.rung
        found = await self.work("fitting", jobs.fit, session.opened.to_send, session.present, names, held)
        if found is None or session.rung is not rung:
            return
        await asyncio.to_thread(session.accept_fit, found, held)
        self.remark = " ".join(found.warnings)
        self.refresh()
        await self.draw_window(*self.window)

    def offered(self, effect: str) -> list[Slider]:
        """Return the sliders of an effect, and register them, so that `slide` accepts their moves.

        Args:
            effect: Name of an effect of the vehicle on the page.
        """
        found = self.session.sliders(effect)
        self._sliders |= {one.key: one for one in found}
        return found

    def slide(self, key: str, value: float) -> None:
        """Set a number of the vehicle on the page, while its slider is being moved.

        Args:
            key: `Slider.key` of the slider.
            value: Present value.
        """
        slider = self._sliders.get(key)
        if slider is None or not self.owned:
            return
        try:
            self.session.move(slider, float(value))
        except (HydroError, ValueError) as error:
            self.say(str(error))
            return
        self.evaluate()

    async def settle(self, key: str, value: float) -> None:
        """Make the value of a released slider, or a typed value, a state of the history.

        Args:
            key: `Slider.key` of the slider.
            value: Final value.
        """
        self.slide(key, value)
        if (slider := self._sliders.get(key)) is not None:
            number = f"{words.effect_name(slider.effect)} {slider.label}"
            await asyncio.to_thread(self.session.settle, number)
            self.refresh()

    async def switch(self, effect: str, on: bool) -> None:
        """Add an effect to the vehicle, or remove it, as a new state of the history."""
        if not self.owned:
            return
        try:
            await asyncio.to_thread(self.session.switch, effect, on)
        except HydroError as error:
            self.say(str(error))
        self.refresh()
        await self.draw_window(*self.window)

    def tick(self, key: str, on: bool) -> None:
        """Choose whether the next fit changes one parameter.

        Args:
            key: The parameter, `effect.parameter`.
            on: Whether the fit changes it.
        """
        (self.session.ticked.add if on else self.session.ticked.discard)(key)

    async def go(self, number: int) -> None:
        """Show the state with a number in the history, 0 for the vehicle as given."""
        if not self.owned:
            return
        self.session.go(number)
        self.remark = ""
        self.refresh()
        await self.draw_window(*self.window)

    def evaluate(self) -> None:
        """Compute the predictions and the error of the page's vehicle in the background, and draw them.

        Changes during this work lead to one further computation.
        """
        if self._evaluating:
            self._again = True
        else:
            self._evaluating = True
            background_tasks.create(self._evaluate())

    async def _evaluate(self) -> None:
        session = self.session
        try:
            while True:
                self._again = False
                vehicle, live = session.present, session.live
                if live is None:
                    return
                begin, end = live.rows(*self.window)

                self.shown, curves = await asyncio.to_thread(
                    drawing.redrawn, live, vehicle, session.horizon, (begin, end), POINTS
                )
                self.send("curves", {"predicted": curves})
                self.refresh_error()
                if not self._again:
                    return
        except HydroError as error:
            self.say(str(error))
        finally:
            self._evaluating = False

    # 5, Keep

    def save_vehicle(self, name: str) -> str:
        """Write the present vehicle file, its covariance and the map of the log; return the file's path.

        Args:
            name: Name or path of the vehicle file.

        Raises:
            DataError: The place is not one of the folders, or cannot be written.
        """
        from hydro.io import covariance

        session = self.session
        session.settle("value")
        path, rung = self.destination(name, ".toml"), session.rung
        vehicles.write(rung.text, path)
        beside = covariance.beside(path)
        beside.unlink(missing_ok=True)
        if rung.estimates is not None and session.opened is not None:
            stage = "explain" if rung.kind == "added" else "fit"
            covariance.write(
                rung.estimates, path, stage=stage, inputs=[session.opened.source], vehicle_text=rung.text
            )
        if session.opened is not None and session.opened.map:
            self._keep_map(path.parent)
        return str(path)

    async def save_study(self, name: str, report: bool) -> str:
        """Write the study folder, and with `report` also an HTML page about it.

        Args:
            name: Name of the folder, in the first folder of the workbench.
            report: Whether to write the page.

        Returns:
            Paths of the folder and the page, separated by a comma; empty if the work was cancelled.

        Raises:
            DataError: Nothing was diagnosed, or the place is not one of the folders.
        """
        session = self.session
        rung = session.rung
        if session.opened is None or not rung.steps:
            raise DataError("diagnose the vehicle first: a study begins with that")
        folder = self.desk.places.writable(self.desk.places.folders[0] / name)
        wanted = () if session.over and set(rung.wanted) <= {BEST} else rung.wanted
        done = await self.work(
            "saving", jobs.save_study, session.opened.to_send, rung.base, rung.steps, wanted, str(folder)
        )
        if done is None:
            return ""
        if not report:
            return str(folder)
        page = self.desk.places.writable(folder.with_name(f"{folder.name}.html"))
        await self.work("report", jobs.write_report, str(folder), str(page))
        return f"{folder}, {page}"

    def destination(self, name: str, ending: str) -> Path:
        """Return the path of a file to save, in the first folder unless the name has another one.

        Args:
            name: Name or path that the user gave.
            ending: Suffix, which is appended if the name lacks it.

        Raises:
            DataError: The path is outside the folders of the workbench.
        """
        name = name if name.endswith(ending) else f"{name}{ending}"
        return self.desk.places.writable(self.desk.places.folders[0] / name)

    def _keep_map(self, folder: Path) -> None:
        """Copy a map that the workbench proposed to the folder of a saved vehicle."""
        opened = self.session.opened
        if opened is not None and Path(opened.map).is_relative_to(self.desk.places.uploads):
            content, stem = Path(opened.map).read_bytes(), Path(opened.name).stem
            names = chain(("map", f"map-{stem}"), (f"map-{stem}-{number}" for number in count(2)))
            places = (folder / f"{name}.toml" for name in names)
            target = next(one for one in places if not one.exists() or one.read_bytes() == content)
            write_bytes(content, target)
            self.session.opened = replace(opened, map=str(target))
            self.remark = f"the map of the log is in {target}"

    # Drawing

    def send(self, function: str, *arguments: Any) -> None:
        """Call a function of the page's script.

        Args:
            function: Name of the function.
            arguments: Its arguments, which are sent as JSON.
        """
        texts = (
            orjson.dumps(one, option=orjson.OPT_SERIALIZE_NUMPY).decode() for one in map(_plain, arguments)
        )
        self.client.run_javascript(f"workbench.{function}({', '.join(texts)})")


def _plain(value: Any) -> Any:
    """Return a value with its arrays contiguous in memory, as orjson needs them."""
    if isinstance(value, np.ndarray):
        return np.ascontiguousarray(value)
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list) else value
