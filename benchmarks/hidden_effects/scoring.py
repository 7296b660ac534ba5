"""What an answer is worth: a row of results held against its own truth.

A diagnosis names an effect by `missing`, `suspect`, `cannot_tell_apart` or `retune`; a `retune` of what
the file has wrong by design is neither right nor wrong, and does not count.  `far_from_noise` says as much as
`none_of_the_known`: that something is left which no effect explains.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from scipy.stats import beta

NAMING = ("missing", "suspect", "cannot_tell_apart", "retune")
LEFT = frozenset({"none_of_the_known", "far_from_noise"})
NOTHING, UNKNOWN = "nothing", "none of the known"
STRATA = ((0.02, "below 2 %"), (0.1, "2 to 10 %"), (0.5, "10 to 50 %"), (1.01, "above 50 %"))
SLACK = 1.1
"""Factor on the oracle's error that an error after adding may have, besides the noise floor."""
COUNTED_FROM = frozenset({"current_shear", "current_trend"})
"""Beside them an `ocean_current` says no more than from which depth or time they count: a fit puts that where
the recording is, and what is hidden counts from elsewhere."""
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)


@dataclass(frozen=True)
class Named:
    """One effect that a diagnosis names.

    Attributes:
        effect: The best one.
        members: All that it may be, the best one among them.
        confidence: As stated; None where none was.
        support: What that was made from; None where none was stated or the table does not say.
    """

    effect: str
    members: frozenset[str]
    confidence: float | None
    support: float | None = None


@dataclass(frozen=True)
class Score:
    """One study, scored.

    Attributes:
        row: The row of results.
        truth: What should be named.
        named: What is named, in the order of the diagnosis.
        unknown: Whether structured error is said to remain that no effect explains.
    """

    row: Mapping[str, Any]
    truth: frozenset[str]
    named: tuple[Named, ...]
    unknown: bool

    @property
    def answer(self) -> str:
        """The first effect named, or that it is none of the known, or nothing."""
        return self.named[0].effect if self.named else UNKNOWN if self.unknown else NOTHING

    @property
    def alarm(self) -> bool:
        """Whether anything is said to be missing."""
        return bool(self.named) or self.unknown

    @property
    def top(self) -> bool:
        """Whether the first effect named is hidden."""
        return bool(self.named) and self.named[0].effect in self.truth

    @property
    def covered(self) -> bool:
        """Whether the first tie set holds an effect that is hidden."""
        return bool(self.named) and bool(self.named[0].members & self.truth)

    @property
    def exact(self) -> bool:
        """Whether exactly what is hidden is named."""
        return not self.unknown and {one.effect for one in self.named} == self.truth

    @property
    def tied(self) -> bool:
        """Whether as many tie sets are named as effects are hidden, and each can be one of them."""
        sets = [one.members for one in self.named]
        return not self.unknown and len(sets) == len(self.truth) and _matched(sorted(self.truth), sets)

    @property
    def within(self) -> bool | None:
        """Whether the error after adding is within the oracle's, some slack and the noise floor."""
        after, best, floor = (self.row[name] for name in ("after", "oracle", "floor"))
        return None if after is None or best is None else bool(after <= SLACK * best + floor)

    @property
    def strength(self) -> float:
        """Share of the file's error that what is hidden makes; of several effects, the weakest one's."""
        each = self.row["shares"] or []
        return float(min(each) if len(each) > 1 else self.row["share"])

    @property
    def stratum(self) -> str:
        """The stratum of that strength."""
        return next(words for below, words in STRATA if self.strength < below)


def _matched(truth: Sequence[str], sets: Sequence[frozenset[str]]) -> bool:
    """Whether each effect can be given a set of its own that holds it."""
    if not truth:
        return True
    first, rest = truth[0], truth[1:]
    return any(first in s and _matched(rest, [*sets[:i], *sets[i + 1 :]]) for i, s in enumerate(sets))


def score(row: Mapping[str, Any]) -> Score:
    """Score a row that holds an answer."""
    truth = frozenset(row["called"])
    excused = set(row.get("misjudged") or ()) - truth
    same = {"ocean_current"} - truth if truth & COUNTED_FROM else set[str]()
    supports = row.get("supports") or [None] * len(row["verdicts"])
    told = zip(row["verdicts"], row["effects"], row["members"], row["confidences"], supports, strict=True)
    named = tuple(
        Named(effect, frozenset(members) | {effect}, confidence, support)
        for verdict, effect, members, confidence, support in told
        if verdict in NAMING and not (verdict == "retune" and effect in excused) and effect not in same
    )
    return Score(row, truth, named, not LEFT.isdisjoint(row["verdicts"]))


def interval(hits: int, count: int) -> tuple[float, float]:
    """95 % interval of a share (Clopper and Pearson 1934)."""
    low = float(beta.ppf(0.025, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.975, hits + 1, count - hits)) if hits < count else 1.0
    return low, high


def rate(values: Iterable[bool]) -> str:
    """A share in words: `95.0 % [83.1, 99.4] (38 of 40)`."""
    told = list(values)
    if not told:
        return "-"
    hits, count = sum(told), len(told)
    low, high = interval(hits, count)
    return f"{100 * hits / count:.1f} % [{100 * low:.1f}, {100 * high:.1f}] ({hits} of {count})"
