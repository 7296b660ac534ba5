"""Score of one study: whether its findings are true, their values are right, and adding them helps.

The first finding that names an effect counts as the answer.  Findings name by `missing`, `suspect`, `retune`
or, as a tie, `cannot_tell_apart`.  A finding with a confidence of at least SURE is a statement.  A name in
`alias`, or a `retune` of a value that the file has wrong by design, is neither right nor wrong.  The
independent simulator also hides faults of the log; there a fault is named by `log_fault`, and is right if it
names exactly the columns at fault.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from benchmarks.judge.rows import KEY

SURE = 0.9
"""Minimum confidence of a statement."""
NAMING = ("missing", "suspect", "retune", "cannot_tell_apart")
FAULT = "log_fault"
UNEXPLAINED = frozenset({"none_of_the_known", "far_from_noise"})
"""Verdicts that state an error which no effect explains."""
WITHIN = 2.0
"""Maximum error of a right value, in standard errors: 95 % of values if these are calibrated."""
HALVED = 0.5
"""Minimum share of the error above the noise floor that a helpful addition removes."""
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Named:
    """Finding that names effects.

    Attributes:
        members: Named effects; several in a tie.
        confidence: Stated confidence; 0 if none was stated.
        right: Whether the finding names the hidden effect; None if it counts as neither right nor wrong.
        tie: Whether the finding names several effects.
        effect: The best of the effects, to which the confidence refers.
        unsure: Whether no confidence was stated.
        support: Number that the confidence was computed from, see `core.diagnosis.findings.Finding`.
    """

    members: frozenset[str]
    confidence: float
    right: bool | None
    tie: bool
    effect: str
    unsure: bool = False
    support: float | None = None

    @property
    def stated(self) -> bool:
        """Return whether the finding is a statement: one effect with a confidence of at least SURE."""
        return not self.tie and self.confidence >= SURE


@dataclass(frozen=True)
class Score:
    """Score of one study.

    Attributes:
        row: The columns of the study.
        named: Named effects, in the order of the diagnosis.
        off: Differences of right names' values from the truth in standard errors, for values that the hidden
            effect changes.
        unaffected: The same differences for values that the hidden effect does not change.
        verdicts: Verdicts of all findings.
    """

    row: Row
    named: tuple[Named, ...]
    off: tuple[float, ...] = ()
    unaffected: tuple[float, ...] = ()
    verdicts: frozenset[str] = frozenset()

    @property
    def key(self) -> tuple[Any, ...]:
        """Return the keys that identify a study."""
        return self.row["list"], self.row["seed"], self.row["seconds"]

    @property
    def failed(self) -> bool:
        """Return whether the study failed."""
        return bool(self.row["failure"])

    @property
    def changed(self) -> bool:
        """Return whether a hidden effect is in the catalogue."""
        return bool(self.row["called"])

    @property
    def outside(self) -> bool:
        """Return whether a hidden effect is not in the catalogue."""
        return not self.changed and bool(hidden(self.row).get("foreign"))

    @property
    def unexplained(self) -> bool:
        """Return whether a verdict states an unexplained error."""
        return not UNEXPLAINED.isdisjoint(self.verdicts)

    @property
    def first(self) -> bool:
        """Return whether the first name is right and not a tie."""
        answer = self.answer
        return answer is not None and answer.right is True and not answer.tie

    @property
    def stated(self) -> bool:
        """Return whether the first name is right and a statement."""
        return self.first and self.named[0].stated

    @property
    def exact(self) -> bool:
        """Return whether exactly the hidden effects are named."""
        told = [one for one in self.named if one.right is not None]
        names = {name for one in told for name in one.members}
        return not any(one.tie for one in told) and names == set(self.row["called"])

    @property
    def wrong(self) -> bool:
        """Return whether any statement is wrong."""
        return any(one.stated and one.right is False for one in self.named)

    @property
    def statements(self) -> int:
        """Return the number of statements that are right or wrong."""
        return sum(one.stated and one.right is not None for one in self.named)

    @property
    def alarm(self) -> bool:
        """Return whether there is a statement although nothing is hidden."""
        return not self.changed and not self.outside and self.wrong

    @property
    def answer(self) -> Named | None:
        """Return the first name; None if nothing is named."""
        return self.named[0] if self.named else None

    @property
    def brier(self) -> float | None:
        """Return the Brier score of the first name's confidence; None without a confidence."""
        answer = self.answer
        if answer is None or answer.right is None or answer.unsure:
            return None
        return float((answer.confidence - answer.right) ** 2)

    @property
    def helped(self) -> bool | None:
        """Return whether adding the findings at least halves the error above the noise floor.

        The added findings are the first one, or all statements if several effects are hidden.  None where the
        true effects would not halve the error, or where that is not known.
        """
        added = "after" if len(self.row["called"] or ()) > 1 else "after_top"
        before, floor, truth, after = (self.row[k] for k in ("before", "floor", "with_truth", added))
        if None in (before, floor, truth) or not before > floor:
            return None
        if truth - floor > HALVED * (before - floor):
            return None
        return after is not None and bool(after - floor <= HALVED * (before - floor))

    @property
    def ratio(self) -> float | None:
        """Return the held-out error with the statements added, divided by that without; None if unknown."""
        before, after = self.row["before"], self.row["after"]
        return None if before is None or after is None else float(after / before)


def score(rows: Sequence[Row]) -> Score:
    """Return the score of the rows of one study."""
    row = rows[0]
    if row["failure"]:
        return Score(row, ())
    told = [one for one in rows if one["role"] == "finding"]
    named = tuple(found for found in (_named(one, row) for one in told) if found is not None)
    right = [one for one in told if one["effect"] in row["called"] and one["off"]]
    pairs = [pair for one in right for pair in zip(one["off"], one["affected"], strict=True)]
    return Score(
        row,
        named,
        tuple(float(off) for off, affected in pairs if affected),
        tuple(float(off) for off, affected in pairs if not affected),
        frozenset(one["verdict"] for one in told),
    )


def scored(table: pl.DataFrame) -> list[Score]:
    """Return the score of each study in a results table, in its order."""
    return [score(part.to_dicts()) for _, part in table.group_by(KEY, maintain_order=True)]


def hidden(row: Row) -> dict[str, Any]:
    """Return the hidden effects (`hidden`) and values (`foreign`) of a study; empty if its rows lack them."""
    found: dict[str, Any] = json.loads(row["hidden"]) if row["hidden"] else {}
    return found


def _named(one: Row, row: Row) -> Named | None:
    """Return the named effects of a finding; None for no names, aliases, or values wrong by design."""
    truth, verdict = set(row["called"]), one["verdict"]
    members = {part.split(":")[0] for part in (one["members"] or [])}
    if verdict == FAULT and row["list"].startswith("apart"):
        right = FAULT in truth and members == (_at_fault(row) or members)
        effect, members = FAULT, {FAULT}
    elif verdict in NAMING:
        effect = one["effect"].split(":")[0]
        members |= {effect}
        right = bool(members & truth)
    else:
        return None
    if not right and (members & set(row["alias"] or ()) or (verdict == "retune" and _excused(members, row))):
        return None
    tie = verdict == "cannot_tell_apart" or len(members) > 1
    stated = 1.0 if verdict == FAULT and one["confidence"] is None else one["confidence"]
    return Named(frozenset(members), float(stated or 0.0), right, tie, effect, stated is None, one["support"])


def _at_fault(row: Row) -> set[str]:
    """Return the columns of the log that are exchanged or reversed; empty if the rows do not say."""
    return {f"cmd_{number}" for number in hidden(row).get("foreign", {}).get("columns", ())}


def _excused(members: set[str], row: Row) -> bool:
    """Return whether all effects that a `retune` names are wrong in the file by design."""
    return bool(members) and members <= set(row["misjudged"] or ())


def finite(values: Sequence[float | None]) -> np.ndarray:
    """Return the numbers among some values, as an array."""
    return np.array([value for value in values if value is not None], float)
