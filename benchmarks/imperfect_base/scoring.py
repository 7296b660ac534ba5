"""What an answer is worth where no model is exactly right.

The first finding that names anything counts.  It names by `missing`, `suspect` or `retune`; where it names
several effects that cannot be told apart, it is a tie, right or wrong, and counted apart.  A `retune` of what
the file has wrong by design (`misjudged`) is neither right nor wrong.  `not_separable` names nothing: like
`not_excited` it says what could not be seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

NAMING = ("missing", "suspect", "retune")
TIE = "cannot_tell_apart"
SURE = 0.9
"""Confidence from which an answer is a statement."""
SPENT = 3.0
"""Mean squared residual above which nothing may be called missing no more."""
BIN = 100
"""Namings in a bin of the reliability table, at least."""
Outcome = Literal["first", "tied", "wrong", "wrong tie", "silent"]


@dataclass(frozen=True)
class Named:
    """One finding that names something.

    Attributes:
        verdict: Its verdict.
        members: All effects that it may be; one, unless it is a tie.
        confidence: As stated; None where none was.
        right: Whether what it names is true: of a tie, whether it holds the truth.
    """

    verdict: str
    members: frozenset[str]
    confidence: float | None
    right: bool

    @property
    def tie(self) -> bool:
        """Whether it names several effects of which one is meant."""
        return self.verdict == TIE or len(self.members) > 1

    @property
    def sure(self) -> bool:
        """Whether one effect is named with a confidence that makes it a statement."""
        return not self.tie and self.confidence is not None and self.confidence >= SURE


@dataclass(frozen=True)
class Score:
    """One study, scored.

    Attributes:
        row: The row of results.
        named: What is named, in the order of the diagnosis.
    """

    row: Mapping[str, Any]
    named: tuple[Named, ...]

    @property
    def outcome(self) -> Outcome:
        """What the first naming is worth."""
        if not self.named:
            return "silent"
        one = self.named[0]
        if one.tie:
            return "tied" if one.right else "wrong tie"
        return "first" if one.right else "wrong"

    @property
    def stated(self) -> bool:
        """Whether the first naming is a statement."""
        return bool(self.named) and self.named[0].sure

    @property
    def stated_wrongly(self) -> bool:
        """Whether any statement is wrong."""
        return any(one.sure and not one.right for one in self.named)

    @property
    def alarm(self) -> bool:
        """Whether anything is called missing that is not, or stated wrongly to have other values."""
        return any(
            one.verdict == "missing" or (one.verdict == "retune" and one.sure)
            for one in self.named
            if not one.tie and not one.right
        )

    @property
    def blind(self) -> bool:
        """Whether nothing is called missing where many times the noise are left."""
        return "nothing_missing" in self.row["verdicts"] and self.row["chi2_end"] > SPENT


def score(row: Mapping[str, Any]) -> Score:
    """Score a row that holds an answer."""
    truth = frozenset(row["called"])
    excused = set(row.get("misjudged") or ()) - truth
    told = zip(row["verdicts"], row["effects"], row["members"], row["confidences"], strict=True)
    named = []
    for verdict, effect, members, confidence in told:
        if verdict not in (*NAMING, TIE) or (verdict == "retune" and effect in excused):
            continue
        those = frozenset(members) | ({effect} - {""})
        named.append(Named(verdict, those, confidence, bool(those & truth)))
    return Score(row, tuple(named))


def namings(scored: Sequence[Score]) -> tuple[np.ndarray, np.ndarray]:
    """Stated confidence and truth of every single effect named with one."""
    told = [
        (one.confidence, one.right)
        for each in scored
        for one in each.named
        if not one.tie and one.confidence is not None
    ]
    confidence, right = np.array(told, float).reshape(-1, 2).T
    return confidence, right


def brier(confidence: np.ndarray, right: np.ndarray) -> float:
    """Mean squared difference of stated confidence and truth (Brier 1950)."""
    return float(np.mean((confidence - right) ** 2)) if confidence.size else float("nan")


def bins(confidence: np.ndarray) -> list[np.ndarray]:
    """Indices of namings by rising confidence in at most ten bins of equal count, at least `BIN` each.

    Equal confidences share a bin: which of them is right must not hang on their order.  Those of the
    greatest have one of their own where they fill it, lest they hide what is less sure.
    """
    order = np.argsort(confidence, kind="stable")
    rising = confidence[order]
    below = int(np.searchsorted(rising, rising[-1:].max(initial=0.0), "left"))
    if min(below, order.size - below) >= BIN:
        lower, greatest = np.split(order, [below])
        return [*(lower[part] for part in bins(confidence[lower])), greatest]
    count = int(np.clip(order.size // BIN, 1, 10))
    ends = np.cumsum([part.size for part in np.array_split(order, count)])
    edges = [0]
    for end in np.searchsorted(rising, rising[ends - 1], "right"):
        if end - edges[-1] >= BIN:
            edges.append(int(end))
    if len(edges) > 1 and order.size - edges[-1] < BIN:
        edges.pop()
    return [part for part in np.split(order, edges[1:]) if part.size]
