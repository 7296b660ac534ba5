"""Sentences on the thrust of thrusters: weak, dead and reversed ones, and a common factor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from hydro.core.effects.case import CLEAR, Case
from hydro.core.effects.phrases import LONGEST, undetermined
from hydro.core.effects.wording import capital, group, listed, number, quantity

LARGEST_SHARE = 10.0
"""Share of thrust above which a gain is not determined: no thruster delivers ten times its thrust."""
LARGEST_ERROR = 0.25
"""Standard error of a gain above which it is not determined: an eighth of the range from reversed to full."""
NEAREST, CLOSE = 0.01, 0.15
"""Distances in shares of thrust within which a thruster is called dead or reversed: whatever its error, and
with twice its error added."""
ALIKE = 0.03
"""Share of thrust within which thrusters count as equal: about the repeatability of bollard tests."""
MOST = 3
"""Maximum number of weak or strong thrusters in a sentence."""
SHARED = 2.0 / 3.0
"""Share of the thrusters with one factor above which it is called common."""


class Thrust(NamedTuple):
    """Thrust of one thruster relative to its thrust in the vehicle file.

    Attributes:
        number: Number of the thruster, from 1.
        share: Thrust as a fraction of the thrust in the vehicle file: 1 as modelled, negative if reversed.
        error: Standard error of `share`.
    """

    number: int
    share: float
    error: float

    @property
    def percent(self) -> str:
        """Text of the thrust in whole percent of the file's thrust, with its standard error if known."""
        error = max(100.0 * self.error, 1.0) if self.error > 0.0 else self.error
        return quantity(100.0 * self.share, error, "%")

    def differs(self, share: float) -> bool:
        """Return whether the thrust differs significantly from a given fraction of the file's thrust.

        The difference must exceed both CLEAR (2) standard errors and ALIKE (3 % of the file's thrust).

        Args:
            share: The fraction, 1 for the thrust in the vehicle file.
        """
        return abs(self.share - share) > max(ALIKE, CLEAR * self.error)

    def at(self, share: float) -> bool:
        """Return whether the thrust is close enough to a given fraction to be stated as that fraction.

        That is within NEAREST, or within CLOSE with CLEAR (2) standard errors added.

        Args:
            share: The fraction of the thrust in the vehicle file; 0 if dead, -1 if reversed.
        """
        off = abs(self.share - share)
        return off <= NEAREST or off + CLEAR * self.error <= CLOSE


def gains_sentence(case: Case) -> str:
    """Return text on the fitted thrust of all thrusters, stated together or one by one."""
    if "common" in case.values:
        return common_sentence(case)
    found, unknown = thrusts(case)
    if not found:
        if not unknown:
            return "No thruster's gain differs from the file."
        return not_determined(unknown)
    last = f" {not_determined(unknown)}" if unknown else ""
    for most in range(MOST, 0, -1):
        clauses = statements(found, most, bool(unknown))
        if len(joined(clauses) + last) <= LONGEST:
            break
    while len(joined(clauses) + last) > LONGEST and len(clauses) > 1:
        clauses.pop()
    return joined(clauses) + last


def joined(clauses: Sequence[str]) -> str:
    """Return clauses joined by semicolons to one sentence, with a capital and a full stop."""
    return f"{capital('; '.join(clauses))}."


def not_determined(numbers: Sequence[int]) -> str:
    """Return a sentence that names thrusters whose gains a log does not determine.

    Args:
        numbers: Numbers of the thrusters, from 1.
    """
    return f"{capital(group(numbers))} {'are' if len(numbers) > 1 else 'is'} not determined by this log."


def common_sentence(case: Case) -> str:
    """Return a sentence on the fitted gain that is common to all thrusters."""
    gain = case.one("common")
    before = mean([was for _, was in file_gains(case)])
    one = against(1, gain.value, gain.error, before)
    if abs(one.share) > LARGEST_SHARE:
        return "The common gain of the thrusters is not determined by this log."
    if not one.error <= LARGEST_ERROR or abs(one.share - 1.0) <= CLEAR * one.error:
        return undetermined(case, "the thrust of all thrusters", f"{one.percent} of the modelled one")
    return f"All thrusters deliver {one.percent} of their modelled thrust."


def mean(numbers: Sequence[float]) -> float:
    """Return the mean of numbers; 0 without numbers."""
    return sum(numbers) / len(numbers) if numbers else 0.0


def against(number_: int, gain: float, error: float, before: float) -> Thrust:
    """Return the fitted thrust of one thruster as a fraction of the file's thrust.

    Args:
        number_: Number of the thruster, from 1.
        gain: Fitted gain g; the thrust is 1 + g of the nominal thrust.
        error: Standard error of `gain`.
        before: Gain in the vehicle file.  If the file's thrust is near zero, the result is relative to the
            nominal thrust.
    """
    modelled = 1.0 + before if 1.0 + before > NEAREST else 1.0
    return Thrust(number_, (1.0 + gain) / modelled, error / modelled)


def file_gains(case: Case) -> list[tuple[int, float]]:
    """Return pairs of each thruster's index (from 0) and gain in the vehicle file, without servos."""
    count = len(case.vehicle.thruster)
    key = "common" if "common" in (case.before or {}) else "g"
    gains = case.of_file(key, (count,)).tolist()
    return [(i, gains[i]) for i, thruster in enumerate(case.vehicle.thruster) if thruster.pushes]


def thrusts(case: Case) -> tuple[list[Thrust], list[int]]:
    """Return the thrusts that a log determines, and the numbers (from 1) of all other thrusters.

    A gain with a standard error of 0 was held fixed, and counts as determined.

    Args:
        case: Fitted values of `thruster_gain` with the vehicle file.
    """
    gains = case.many("g", (len(case.vehicle.thruster),))
    errors = case.error_of("g", (len(gains),))
    found, unknown = [], []
    for i, before in file_gains(case):
        one = against(i + 1, gains[i].value, errors[i], before)
        determined = 0.0 <= errors[i] <= LARGEST_ERROR and not math.isinf(gains[i].error)
        if determined and abs(one.share) <= LARGEST_SHARE:
            found.append(one)
        else:
            unknown.append(i + 1)
    return found, unknown


def statements(found: Sequence[Thrust], most: int, some_unknown: bool) -> list[str]:
    """Return clauses on the thrust of thrusters: first on dead and reversed thrusters, then on all others.

    Args:
        found: Thrusts that the log determines.
        most: Maximum number of thrusters that are described one by one.
        some_unknown: Whether the log leaves the thrust of further thrusters undetermined.
    """
    dead = [one for one in found if one.at(0.0)]
    backward = [one for one in found if one.share < 0.0 and one not in dead]
    whole = [one for one in backward if one.at(-1.0)]
    forward = [one for one in found if one not in dead and one not in backward]
    clauses = []
    if dead:
        clauses.append(f"{named(dead)} {verb(dead, 'delivers', 'deliver')} nothing")
    if whole:
        columns = "its column is" if len(whole) == 1 else "their columns are"
        clauses.append(f"{named(whole)} {verb(whole, 'is', 'are')} reversed, or {columns} swapped")
    partly = [one for one in backward if one not in whole]
    if partly:
        reverse = partly[0]._replace(share=-partly[0].share)
        clauses.append(f"thruster {reverse.number} is reversed at {reverse.percent} of its modelled thrust")
    if partly[1:]:
        clauses.append(f"{named(partly[1:])} {verb(partly[1:], 'is', 'are')} reversed as well")
    if forward:
        clauses += of_forward(forward, most, bool(clauses), some_unknown)
    return clauses


def named(some: Sequence[Thrust]) -> str:
    """Return words that name thrusters by their numbers, such as `thrusters 1 and 2`."""
    return group(one.number for one in some)


def verb(some: Sequence[Thrust], one: str, several: str) -> str:
    """Return the verb form `one` for a single thruster, `several` for more."""
    return one if len(some) == 1 else several


def of_forward(forward: Sequence[Thrust], most: int, after: bool, some_unknown: bool) -> list[str]:
    """Return clauses on thrusters that push forward: each deviating one, and the common thrust of the rest.

    Args:
        forward: Thrusts, all positive.
        most: Maximum number of thrusters that are described one by one.
        after: Whether the sentence has clauses on other thrusters before these clauses.
        some_unknown: Whether the log leaves the thrust of further thrusters undetermined.
    """
    middle, error = median(one.share for one in forward), median(one.error for one in forward)
    alike = [one for one in forward if not one.differs(middle)]
    nominal = abs(middle - 1.0) <= max(ALIKE, CLEAR * error)
    shared = len(alike) >= max(2, SHARED * len(forward))
    if nominal or not shared:
        odd = [one for one in forward if one.differs(1.0)]
        others = [one for one in forward if one not in odd]
        return one_by_one(odd, others, most, after, some_unknown)
    odd = by_distance([one for one in forward if one not in alike], middle)
    who = "all thrusters deliver" if not after and not some_unknown else f"{named(alike)} deliver"
    factor = Thrust(0, middle, error).percent
    if not odd:
        return [f"{who} {factor} of their modelled thrust"]
    rest = [f"{len(odd) - most} more differ"] if len(odd) > most else []
    return [f"{who} {factor}", *[besides(one, middle) for one in odd[:most]], *rest]


def besides(one: Thrust, middle: float) -> str:
    """Return a clause that compares one thruster with all others, such as "thruster 3 another 35 % less".

    Args:
        one: The thruster.
        middle: Common thrust of all others, a fraction of the thrust in the vehicle file.
    """
    percent = round(100.0 * (one.share / middle - 1.0))
    return f"thruster {one.number} another {abs(percent)} % {'less' if percent < 0 else 'more'}"


def by_distance(some: Sequence[Thrust], share: float) -> list[Thrust]:
    """Return a new list of thrusters, sorted by the distance of their thrust from a value, farthest first.

    The distance is in standard errors.

    Args:
        some: The thrusters.
        share: The value, a fraction of the thrust in the vehicle file.
    """
    return sorted(some, key=lambda one: abs(one.share - share) / max(one.error, NEAREST), reverse=True)


def one_by_one(
    odd: Sequence[Thrust], others: Sequence[Thrust], most: int, after: bool, some_unknown: bool
) -> list[str]:
    """Return clauses on each of several deviating thrusters, and one clause with the range of all others.

    Args:
        odd: Thrusters whose thrust differs significantly from the file's.
        others: Thrusters whose thrust does not.
        most: Maximum number of thrusters that are described one by one.
        after: Whether the sentence has clauses on other thrusters before these clauses.
        some_unknown: Whether the log leaves the thrust of further thrusters undetermined.
    """
    first, rest = by_distance(odd, 1.0)[:most], by_distance(odd, 1.0)[most:]
    clauses = []
    if first:
        ends = [f"thruster {first[0].number} delivers {first[0].percent} of its modelled thrust"]
        ends += [f"thruster {one.number} {one.percent}" for one in first[1:]]
        clauses.append(listed(ends))
    if rest:
        clauses.append(f"{len(rest)} more {verb(rest, 'delivers', 'deliver')} {span(rest)} %")
    if len(others) == 1 and first:
        clauses.append(f"thruster {others[0].number} {span(others)} %")
    elif others and (first or after):
        clauses.append(f"{'the' if some_unknown or rest else 'all'} others {span(others)} %")
    elif others:
        who = "thruster" if len(others) == 1 else "thrusters"
        who = named(others) if some_unknown else f"all {who}"
        end = verb(others, "delivers", "deliver")
        clauses.append(f"{who} {end} {span(others)} % of {verb(others, 'its', 'their')} modelled thrust")
    return clauses


def span(some: Sequence[Thrust]) -> str:
    """Return the range of several thrusts in percent of the file's thrust as text, such as `98 to 102`."""
    low, high = (number(round(100.0 * end(one.share for one in some))) for end in (min, max))
    return low if low == high else f"{low} to {high}"
