"""Next steps after a diagnosis: the recommended one, then its alternatives."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import polars as pl

from hydro.core.diagnosis.findings import UNEXPLAINED, Prediction, of_table, suspects
from hydro.core.experiment.advice import advises_adding

ADD, EXPLAIN, CORRECT, RUN, COMPARE = "add", "explain", "correct_thrusters", "next_run", "compare"
FIT = "fit"
"""Actions of next steps: functions of `hydro.api`, an option of `diagnose`, or the design of a next run."""
CONTINUE = "continue with the thrusters as this log shows them"
"""Words for the correction of thrusters by a diagnosis that stopped at them."""
MEND = "correct the thrusters in the vehicle file, or the order of the commands in the map"
"""Words for the correction of thrusters after a diagnosis that has continued."""


@dataclass(frozen=True)
class NextStep:
    """Next step after a diagnosis.

    Attributes:
        action: `add`, `explain`, `correct_thrusters`, `next_run`, `compare` or `fit`.
        words: The step in words, without a capital letter and a full stop.
        effects: Effects to add or to fit, by name; empty if the step adds all confirmed findings or none.
    """

    action: str
    words: str
    effects: tuple[str, ...] = ()


def next_steps(frame: pl.DataFrame, prediction: Prediction | None = None) -> tuple[NextStep, ...]:
    """Return the next steps that a diagnosis supports, the recommended one first.

    Thrusters that contradict the file come first, then confirmed findings, then all others by rank.

    Args:
        frame: Diagnosis table.
        prediction: Errors of predictions before and after; None if they are not known.
    """
    rows = frame.sort("rank").to_dicts()
    stated, unconfirmed = [one for one in of_table(frame) if one.is_confirmed], suspects(frame)
    steps = []
    if any(is_of_thrusters(row) for row in rows):
        stopped = all(row["verdict"] == "log_fault" for row in rows)
        steps.append(NextStep(CORRECT, CONTINUE if stopped else MEND))
    if stated and prediction is not None and prediction.refuted:
        steps.append(NextStep(EXPLAIN, "try single steps, and keep those that lower the error"))
    elif stated:
        few = {1: "this correction", 2: "both corrections"}
        count = few.get(len(stated), f"all {len(stated)} corrections")
        steps.append(NextStep(ADD, f"add {count} to the vehicle file"))
    steps += [step for row in rows for step in _of_finding(row, row["effect"] in unconfirmed, prediction)]
    if not steps:
        steps.append(NextStep(COMPARE, "see the errors at other horizons and by regime"))
    if any(row["verdict"] == "not_excited" for row in rows):
        steps.append(NextStep(RUN, "design a run that shows the effects not visible in this log"))
    first = {(one.action, one.effects): one for one in reversed(steps)}
    return tuple(dict.fromkeys(first[one.action, one.effects] for one in steps))


def is_of_thrusters(row: Mapping[str, Any]) -> bool:
    """Return whether a finding is a fault of the log in the directions or the order of the thrusters.

    Args:
        row: Row of the diagnosis table.
    """
    return row["verdict"] == "log_fault" and row["confidence"] is not None


def in_python(step: NextStep) -> str:
    """Return a step as the text of a Python expression; empty if hydro's Python functions have no such step.

    Names in the expression are `vehicle`, `raw`, the recording `before` a change, and the diagnosis `found`.
    """
    if step.action == ADD:
        names = f", {list(step.effects)}" if step.effects else ""
        return f"hydro.add(vehicle, found{names})"
    if step.action == CORRECT:
        return "hydro.diagnose(vehicle, raw, correct_thrusters=True)" if step.words == CONTINUE else ""
    if step.action == FIT:
        return f"hydro.fit(vehicle, before, {list(step.effects)}).vehicle"
    return f"hydro.{step.action}(vehicle, raw)" if step.action != RUN else ""


def _of_finding(
    row: Mapping[str, Any], unconfirmed: bool, prediction: Prediction | None
) -> Iterator[NextStep]:
    """Yield the step that one finding alone suggests; confirmed findings are added by a common step."""
    if unconfirmed and row["parameters"] and advises_adding(row["advice"]):
        name, error = row["effect"], row["error_added"]
        if prediction is None or _unknown(error) or error < prediction.given:
            told = f"add {name.replace('_', ' ')}, if you can confirm it on the vehicle"
            yield NextStep(ADD, told, (name,))
        else:
            yield NextStep(EXPLAIN, "try single steps, and keep those that lower the error")
    if row["verdict"] == "cannot_tell_apart":
        yield NextStep(RUN, "design a run that separates the effects that fit equally well")
    if row["verdict"] in UNEXPLAINED and row["members"]:  # the earlier recording needs them as well
        told = "fit the vehicle file to the earlier recording, then compare with the fitted file"
        yield NextStep(FIT, told, tuple(row["members"]))
    elif row["verdict"] in UNEXPLAINED:
        yield NextStep(COMPARE, "find the regimes of motion with the largest errors")


def _unknown(error: float | None) -> bool:
    """Return whether an error was not measured."""
    return error is None or math.isnan(error)
