"""Session of the workbench: the open recording, the vehicle, its history, and the possible next actions.

A session knows neither page nor process.  Every change makes a new `Rung` of the history; earlier states are
never changed, so undo and redo move along the history, and a copy for another tab is cheap.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec

from hydro.app.jobs import Compared, Fitted
from hydro.app.live import Errors, Live
from hydro.app.opening import Craft, Opened
from hydro.app.parameters import Slider, neutral, sliders, switchable, with_effect, with_value
from hydro.core import effects
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError, listed
from hydro.core.explanation.explain import BEST, over
from hydro.core.explanation.ladder import Step, best
from hydro.core.explanation.options import is_open, options
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle
from hydro.io import rewrite
from hydro.io import vehicle as vehicles
from hydro.report.words import effect_name

AS_GIVEN = "as given"
STUDY_STAGE = "explain"
"""Stage in the footers of a study, which `hydro explain` writes."""


@dataclass(frozen=True)
class Rung:
    """One state of the vehicle in the history of a session.

    Attributes:
        label: Description of the change that led to the state.
        kind: `given`, `added`, `tuned` or `fitted`.
        vehicle: The vehicle.
        text: Text of its vehicle file.
        error: Error of at most 60 predictions [m/s]; NaN if it is not known.
        estimates: Fitted values with their covariance; None without a fit.
        base: Vehicle file of step 0 of the study that led to the state.
        steps: Steps of this study; empty before a diagnosis.
        wanted: Effects that the user asked these steps to add.
        fitted: Effects that a fit estimated, and those of their parameters that it did not change, each
            `effect.parameter`.
    """

    label: str
    kind: str
    vehicle: Vehicle
    text: str
    error: float
    estimates: Estimates | None
    base: Craft
    steps: tuple[Step, ...] = ()
    wanted: tuple[str, ...] = ()
    fitted: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())


@dataclass
class Session:
    """State of one tab of the workbench: recording, vehicle and history of changes.

    Attributes:
        opened: The recording; None before one is open.
        live: The recording prepared for fast predictions; None before one is open.
        history: All states, the vehicle as given first.
        at: Index of the present state in the history.
        vehicle: The vehicle on the page; while a slider moves, it differs from the present state.
        compared: Comparison of the vehicle as given, with the noise floor that the page draws.
        horizon: Prediction horizon of the page [s]; None for whole sessions.
        ticked: Parameters that the next fit changes, each `effect.parameter`.
        aside: Tables of effects that the user switched off, by name, for switching them on again.
    """

    opened: Opened | None = None
    live: Live | None = None
    history: list[Rung] = field(default_factory=list)
    at: int = 0
    vehicle: Vehicle | None = None
    compared: Compared | None = None
    horizon: float | None = 5.0
    ticked: set[str] = field(default_factory=set)
    aside: dict[str, dict[str, Any]] = field(default_factory=dict)

    # Opening

    def open(self, craft: Craft, opened: Opened) -> None:
        """Set the vehicle file and the recording, and start a new history with the vehicle as given."""
        craft = craft.for_recording(opened.source)
        live = Live(opened)
        horizons = live.horizons
        self.horizon = 5.0 if 5.0 in horizons else max(horizons, default=None)
        self.opened, self.live, self.compared = opened, live, None
        self.vehicle, self.aside, self.at = craft.vehicle, {}, 0
        self.history = [
            Rung(
                AS_GIVEN,
                "given",
                craft.vehicle,
                craft.text,
                self._error(craft.vehicle),
                craft.estimates,
                craft,
            )
        ]
        self.ticked = {
            f"{name}.{one.parameter}"
            for name in effects.catalogue.own_effects(craft.vehicle)
            for one in sliders(craft.vehicle, name)
            if not one.known
        }

    @property
    def rung(self) -> Rung:
        """The present state of the history.

        Raises:
            DataError: Nothing is open.
        """
        if not self.history:
            raise DataError("open a recording and a vehicle first")
        return self.history[self.at]

    @property
    def present(self) -> Vehicle:
        """The vehicle on the page.

        Raises:
            DataError: Nothing is open.
        """
        if self.vehicle is None:
            raise DataError("open a recording and a vehicle first")
        return self.vehicle

    # History

    @property
    def can_undo(self) -> bool:
        """Whether the history has a state before the present one."""
        return self.at > 0

    @property
    def can_redo(self) -> bool:
        """Whether the history has a state after the present one."""
        return self.at + 1 < len(self.history)

    def undo(self) -> None:
        """Go back to the state before the present one."""
        self.go(self.at - 1)

    def redo(self) -> None:
        """Go forward to the state after the present one."""
        self.go(self.at + 1)

    def go(self, number: int) -> None:
        """Make the state with an index in the history the present one.

        An index without a state changes nothing.
        """
        if 0 <= number < len(self.history):
            self.at, self.vehicle = number, self.history[number].vehicle

    def _append(self, rung: Rung) -> None:
        """Add a state after the present one, and drop all states that were undone."""
        self.history = [*self.history[: self.at + 1], rung]
        self.at, self.vehicle = len(self.history) - 1, rung.vehicle

    # Tuning

    def switches(self) -> list[tuple[str, bool]]:
        """Return pairs of each catalogue effect's name and whether the vehicle has the effect."""
        return [(name, bool(self.present.effects(name))) for name in switchable(self.present)]

    def sliders(self, effect: str) -> list[Slider]:
        """Return the sliders of an effect of the vehicle on the page."""
        return sliders(self.present, effect)

    def move(self, slider: Slider, value: float) -> Vehicle:
        """Set the number of a slider on the page's vehicle, without a new state; return the changed vehicle.

        Raises:
            DataError: The value breaks a rule of vehicle files; the vehicle on the page stays.
        """
        moved = with_value(self.present, slider, value)
        effects.validate(moved)
        self.vehicle = moved
        return moved

    def settle(self, number: str) -> None:
        """Make the vehicle on the page a state of the history.

        Consecutive changes of one slider are one state.

        Args:
            number: Name of the slider that was moved, for the label of the state.
        """
        if self.present == self.rung.vehicle:
            return
        label = f"{number} set"
        rung = self._tuned(label)
        if self.rung.kind == "tuned" and self.rung.label == label and not self.can_redo:
            self.history, self.at = self.history[:-1], self.at - 1
        self._append(rung)

    def switch(self, effect: str, on: bool) -> None:
        """Switch an effect of the vehicle on or off, as a new state of the history.

        An effect that is switched on gets its earlier values, or neutral ones.

        Args:
            effect: Name of the effect.
            on: Whether to add the effect.

        Raises:
            DataError: The vehicle would break a rule of vehicle files.
        """
        vehicle = self.present
        if bool(vehicle.effects(effect)) == on:
            return
        if on:
            changed = with_effect(vehicle, self.aside.get(effect) or neutral(effect, vehicle))
        else:
            changed = vehicle.without(effect)
        effects.validate(changed)
        if on:
            self.ticked |= {f"{effect}.{one.parameter}" for one in sliders(changed, effect)}
        else:
            self.aside[effect] = dict(vehicle.effects(effect)[0])
            self.ticked = {one for one in self.ticked if one.partition(".")[0] != effect}
        self.vehicle = changed
        self._append(self._tuned(f"{effect_name(effect)} {'on' if on else 'off'}"))

    def _tuned(self, label: str) -> Rung:
        """Return a state of kind `tuned` with the vehicle on the page, from which a new study can start."""
        vehicle, present = _without_stale_errors(self.present, self.rung.vehicle), self.rung
        text = rewrite.rewritten(vehicle, present.text)
        craft = Craft(present.base.path, text, vehicles.parse(text))
        return Rung(label, "tuned", vehicle, text, self._error(vehicle), None, craft)

    # Fitting

    def to_fit(self) -> tuple[list[str], list[str]]:
        """Return the effects that have a ticked parameter, and the parameters of these that are not ticked.

        Raises:
            DataError: No parameter is ticked.
        """
        names, held = list[str](), list[str]()
        for table in self.present.effect:
            name = str(table["name"])
            every = list(
                dict.fromkeys(f"{name}.{one.parameter}" for one in self.sliders(name) if not one.known)
            )
            chosen = [one for one in every if one in self.ticked]
            if chosen and not CATALOGUE[name].is_random:
                names.append(name)
                held += [one for one in every if one not in self.ticked]
        if not names:
            raise DataError("tick the parameters to fit")
        return names, held

    def accept_fit(self, fitted: Fitted, held: Sequence[str] = ()) -> None:
        """Add the result of a fit to the history, as the present state.

        Args:
            fitted: The result.
            held: Parameters that the fit did not change, each `effect.parameter`.
        """
        if self.opened is None:
            raise DataError("open a recording and a vehicle first")
        origin = {
            "data": self.opened.source.provenance.content,
            "method": "output",
            "chi2": round(fitted.chi2, 4),
        }
        text = self.rung.text
        if self.present != self.rung.vehicle:
            text = rewrite.rewritten(self.present, text)
        for table in fitted.tables:
            text = vehicles.set_effect(text, table | {"fit": origin})
        vehicle = vehicles.parse(text)
        estimates = fitted.estimates.after(self.rung.estimates)
        names = tuple(str(table["name"]) for table in fitted.tables)
        craft = Craft(self.rung.base.path, text, vehicle)
        self._append(
            Rung(
                f"fit of {listed([effect_name(one) for one in names])}",
                "fitted",
                vehicle,
                text,
                self._error(vehicle),
                estimates,
                craft,
                fitted=(names, tuple(held)),
            )
        )

    # Adding findings

    @property
    def diagnosed(self) -> bool:
        """Whether the present state has a diagnosis."""
        return bool(self.history) and bool(self.rung.steps)

    @property
    def findings(self) -> list[dict[str, Any]]:
        """Rows of the diagnosis of the present state, the best first; empty before a diagnosis."""
        return self.rung.steps[-1].diagnosis.sort("rank").to_dicts() if self.diagnosed else []

    @property
    def over(self) -> str:
        """Reason why the study ends, in words; empty if a step may follow or the study has not begun."""
        return over(self.rung.steps) if self.diagnosed else ""

    def wanted(self, effect: str) -> str:
        """Return the request with which the next step of the study adds a finding.

        Args:
            effect: Effect of the finding.

        Returns:
            `BEST` if `hydro explain` would add the finding next, else the name of the effect.
        """
        step = self.rung.steps[-1]
        every = options(step)
        first = next(iter(every[0]), None) if len(every) == 1 and not is_open(step) else None
        return BEST if effect == first else effect

    def accept_step(self, step: Step | None, wanted: str) -> str:
        """Add a step of the study to the history.

        The first step compares and diagnoses the present state; a later one adds a finding.  A step that
        predicts left-out data worse is kept in the history but is not the present state.

        Args:
            step: The step; None if no candidate effect predicts better.
            wanted: Effect that the user asked the step to add.

        Returns:
            A remark for the user; empty if there is nothing to say.
        """
        rung = self.rung
        if step is None:
            return "no candidate predicts better than the present vehicle"
        if step.number == 0:
            self.history[self.at] = replace(rung, steps=(step,), wanted=())
            return ""
        steps, added = (*rung.steps, step), (*rung.wanted, wanted)
        text = rung.base.text
        origin = {"data": self._content(), "method": STUDY_STAGE}
        for table in step.tables:
            text = vehicles.set_effect(text, table | {"fit": origin})
        label = f"{listed([effect_name(one) for one in step.added])} added"
        self._append(
            Rung(
                label,
                "added",
                step.vehicle,
                text,
                self._error(step.vehicle),
                step.estimates,
                rung.base,
                steps,
                added,
            )
        )
        for table in step.tables:
            self.ticked |= {f"{table['name']}.{one.parameter}" for one in self.sliders(str(table["name"]))}
        if best(steps) is not step:
            self.undo()
            return f"{label}: predicts left-out data worse, so it is undone; redo shows it"
        return ""

    def _content(self) -> str:
        return "" if self.opened is None else self.opened.source.provenance.content

    # Errors

    def errors(self, *, every: bool = False) -> Errors | None:
        """Return the errors of the page's vehicle at the page's horizon; None before a recording is open.

        Args:
            every: Use all predictions of the recording, not only some of them.
        """
        if self.live is None or self.vehicle is None:
            return None
        return self.live.errors(self.vehicle, self.horizon, every=every)

    def floors(self) -> Mapping[str, float]:
        """Return the noise floor of each velocity [m/s, rad/s] at the page's horizon, by name.

        The dict is empty before a comparison.
        """
        if self.compared is None:
            return {}
        rows = self.compared.table.filter(level="replay", by="all")
        at = math.nan if self.horizon is None else self.horizon
        return {
            row["axis"]: row["noise_floor"]
            for row in rows.to_dicts()
            if row["horizon"] == at or (row["horizon"] is None and self.horizon is None)
        }

    def worst(self, most: int = 6) -> list[dict[str, Any]]:
        """Return the places where the vehicle as given fails most: rows of the comparison table, as dicts.

        Args:
            most: Maximum number of places.
        """
        if self.compared is None:
            return []
        table = self.compared.table
        return table.filter(table["rank"].is_not_null()).sort("rank").head(most).to_dicts()

    def copy(self) -> Session:
        """Return a session for another tab, with the same recording and copies of history and vehicle."""
        return replace(self, history=list(self.history), ticked=set(self.ticked), aside=dict(self.aside))

    def _error(self, vehicle: Vehicle) -> float:
        """Return the error of a vehicle 5 s ahead, or at the longest horizon of the recording [m/s]."""
        if self.live is None:
            return math.nan
        horizons = self.live.horizons
        return self.live.errors(vehicle, 5.0 if 5.0 in horizons else max(horizons, default=None)).all


def _without_stale_errors(vehicle: Vehicle, before: Vehicle) -> Vehicle:
    """Return a vehicle without standard errors and fit notes in the tables whose values the user changed.

    Args:
        vehicle: The vehicle.
        before: The vehicle before the change.
    """
    known = {str(table["name"]): table for table in before.effect}
    tables = [
        table
        if known.get(str(table["name"])) == table
        else {key: value for key, value in table.items() if key not in ("standard_error", "fit")}
        for table in vehicle.effect
    ]
    return msgspec.structs.replace(vehicle, effect=tuple(tables))
