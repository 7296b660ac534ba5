"""What an answer is worth: which names are right for each kind of change, and which stand for it.

The first finding that names anything counts; an alias does not hide the right name stated behind
it.  Whatever is stated wrongly, at a confidence of 0.9 or as a fault of the log, makes the answer wrong,
wherever it stands.  A tie that holds a right name or an alias counts as an alias.  `not_separable` and what
is said of the rest name nothing.  Without the recording before, a `retune` says what is wrong with the
file, which it is by design: it counts where it is right alone.  Other names for what the hull does beside
its file are wrong there: asked is what has changed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

SURE = 0.9
"""Confidence from which an answer is a statement."""
FAULT, TIE = "log_fault", "cannot_tell_apart"
NAMING = (FAULT, "missing", "suspect", "retune", TIE)


class Outcome(StrEnum):
    """What an answer is worth: of a change, of no change, of a command that failed."""

    RIGHT = "right"
    ALIAS = "right by alias"
    STATED = "wrong, stated at 0.9"
    SUSPECTED = "wrong, only suspected"
    MISSED = "missed"
    QUIET = "nothing named"
    HINT = "only suspected"
    ALARM = "alarm"
    FAILED = "failed"


OF_CHANGES = (Outcome.RIGHT, Outcome.ALIAS, Outcome.STATED, Outcome.SUSPECTED, Outcome.MISSED)
OF_NOTHING = (Outcome.QUIET, Outcome.HINT, Outcome.ALARM)


@dataclass(frozen=True)
class Names:
    """What may be named of a kind of change.

    Attributes:
        right: Names that are right.
        alias: Names that stand for it.
        why: Why these.
    """

    right: tuple[str, ...]
    alias: tuple[str, ...]
    why: str


OF_THRUST = "a share of thrust that is gone has one name, of whichever thruster"
BESIDE = "over the speeds flown, drag of another power of the speed fits nearly as well"
COLUMNS = "the columns at fault, no more and no fewer"
NAMES: Mapping[str, Names] = {
    "current_steady": Names(
        ("ocean_current",),
        ("current_trend", "current_shear"),
        "what grows from far away is steady where the vehicle is",
    ),
    "current_shear": Names(
        ("current_shear",),
        ("ocean_current",),
        "a fit counts depth from where the recording is: the rest of a shear is a steady current",
    ),
    "current_time": Names(
        ("current_trend",),
        ("ocean_current",),
        "a fit counts time from where the recording is: the rest of a trend is a steady current",
    ),
    "payload": Names(
        ("payload",),
        ("net_buoyancy", "buoyancy_offset"),
        "its weight alone and its moment alone are parts of it",
    ),
    "float": Names(
        ("payload",),
        ("net_buoyancy", "buoyancy_offset"),
        "its lift alone and its moment alone are parts of it",
    ),
    "cg_shift": Names(
        ("buoyancy_offset",),
        ("payload",),
        "centres count by their distance; a load moves the centre of gravity, too",
    ),
    "trapped_water": Names(
        ("added_mass", "payload"),
        ("added_mass_coupling",),
        "mass without weight is added mass or a load without weight; off the origin, m x and m z couple axes",
    ),
    "net_buoyancy": Names(
        ("net_buoyancy",), ("payload",), "a load at the centre of buoyancy with little mass is the same"
    ),
    "thr_one": Names(("thruster_gain",), (), OF_THRUST),
    "thr_two": Names(("thruster_gain",), (), OF_THRUST),
    "thr_dead": Names(("thruster_gain",), (), OF_THRUST),
    "lag": Names(("thruster_lag",), (), "thrust that rises slowly is not thrust that comes late"),
    "delay": Names(("command_delay",), (), "thrust that comes late is not thrust that rises slowly"),
    "deadband": Names(("thruster_deadband",), (), "nothing else is cut off at small commands"),
    "curve": Names(("thruster_curve",), (), "nothing else bends thrust over the command"),
    "asymmetry": Names(("thruster_asymmetry",), (), "nothing else is weaker astern alone"),
    "added_mass": Names(
        ("added_mass",), ("payload",), "a load with mass and little weight is harder to accelerate, too"
    ),
    "linear": Names(("linear_damping",), ("quadratic_damping", "power_drag"), BESIDE),
    "quadratic": Names(
        ("quadratic_damping",),
        ("power_drag", "linear_damping", "cross_axis_drag", "crossflow_drag", "offset_drag"),
        f"{BESIDE}; at a point on its axis, or along one, it is the same drag",
    ),
    "appendage": Names(
        ("offset_drag",),
        ("quadratic_damping", "cross_axis_drag", "control_surface"),
        "its drag and its moment are parts of it, of axes or between them; a plate on an arm drags, too",
    ),
    "fin_trim": Names(("control_surface",), (), "a force across that grows with the speed ahead is a fin's"),
    "fin_lost": Names(
        ("control_surface", "body_lift"),
        ("coupled_damping",),
        "a fin of the file that is smaller, or the lift of hull and fins where the file has no fins; linear "
        "in sway and yaw at one speed",
    ),
    "tether": Names(("tether",), (), "nothing else pulls to a point"),
    "memory": Names(("fluid_memory",), ("added_mass",), "at the frequencies flown, most of it is added mass"),
    "inflow": Names(
        ("thruster_inflow",), ("linear_damping",), "at steady thrust the loss is in proportion to the speed"
    ),
    "suction": Names(("surface_suction",), ("net_buoyancy",), "at one depth a pull upwards is buoyancy"),
    "dvl_scale": Names(("sensor_scale",), (), "kinematics tells it from all forces"),
    "dvl_yaw": Names(("sensor_misalignment",), (), "kinematics tells it from all forces"),
    "dvl_late": Names(("sensor_delay",), (), "kinematics tells it from all forces"),
    "heading_bias": Names(
        (FAULT,),
        ("sensor_misalignment",),
        "heading and log are turned against one another; which of them is off shows in a current alone",
    ),
    "exchanged": Names((FAULT,), (), COLUMNS),
    "reversed": Names((FAULT,), (), COLUMNS),
    "unchanged": Names((), (), "there is nothing to name"),
}
"""By kind of change, see `changes.CHANGES`."""


@dataclass(frozen=True)
class Said:
    """One finding that names something.

    Attributes:
        verdict: Its verdict.
        names: Effects that it may be; of a fault of the log, `log_fault`.
        columns: At fault in the log.
        confidence: As stated; None where none was.
    """

    verdict: str
    names: tuple[str, ...]
    columns: frozenset[str]
    confidence: float | None

    @property
    def sure(self) -> bool:
        """Whether it is a statement."""
        if self.verdict == TIE:
            return False
        return self.verdict == FAULT or (self.confidence is not None and self.confidence >= SURE)

    def worth(self, names: Names, columns: frozenset[str]) -> Outcome:
        """What it is worth by itself, of a change that concerns these columns of the log."""
        if self.verdict == TIE:
            held = set(self.names) & {*names.right, *names.alias}
            return Outcome.ALIAS if held else Outcome.SUSPECTED
        name = self.names[0]
        if name in names.right and not (self.verdict == FAULT and columns and self.columns != columns):
            return Outcome.RIGHT
        if name in names.alias:
            return Outcome.ALIAS
        return Outcome.STATED if self.sure else Outcome.SUSPECTED


@dataclass(frozen=True)
class Judged:
    """One answer, judged.

    Attributes:
        row: Of results.
        said: What is named, in the order of the diagnosis.
        outcome: What it is worth.
    """

    row: Mapping[str, Any]
    said: tuple[Said, ...]
    outcome: Outcome


def said(row: Mapping[str, Any]) -> tuple[Said, ...]:
    """What a row names; effects without the labels that tell several of a file apart."""
    names = NAMES[row["kind"]]
    told = []
    for verdict, effect, members, sure in zip(
        row["verdicts"], row["effects"], row["members"], row["confidences"], strict=True
    ):
        if verdict not in NAMING:
            continue
        if verdict == FAULT:
            told.append(Said(verdict, (FAULT,), frozenset(members), sure))
            continue
        those = members if verdict == TIE else [effect]
        one = Said(verdict, tuple(name.split(":")[0] for name in those), frozenset(), sure)
        accepted = {*names.right, *names.alias}
        if verdict == "retune" and not row["with_before"] and one.names[0] not in accepted:
            continue
        told.append(one)
    return tuple(told)


def judge(row: Mapping[str, Any]) -> Judged:
    """What a row of results is worth."""
    if row["failure"]:
        return Judged(row, (), Outcome.FAILED)
    told = said(row)
    return Judged(row, told, outcome(row["kind"], json.loads(row["truth"]), told))


def outcome(kind: str, truth: Mapping[str, Any], told: tuple[Said, ...]) -> Outcome:
    """What everything named is worth, of a kind of change and its truth."""
    names = NAMES[kind]
    if not names.right:
        return Outcome.QUIET if not told else Outcome.ALARM if any(one.sure for one in told) else Outcome.HINT
    if not told:
        return Outcome.MISSED
    columns = frozenset(f"cmd_{number}" for number in truth.get("columns", ()))
    worths = [one.worth(names, columns) for one in told]
    if Outcome.STATED in worths:
        return Outcome.STATED
    stated = [worth for one, worth in zip(told, worths, strict=True) if one.sure]
    if worths[0] == Outcome.ALIAS and Outcome.RIGHT in stated:
        return Outcome.RIGHT
    return worths[0]
