"""Alignment of several clocks: stamps of each topic's messages, relative to their times of receipt.

A header stamp is the time of measurement; the time of receipt is when the logger had it.  The stamp is more
accurate if both have the same epoch.  Autopilots and simulators stamp in seconds since their own start.  Such
stamps keep their steps and are shifted as a whole to the logger's clock.  If such a clock restarts with the
autopilot or simulator, a new session starts; the order of receipt shows where.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array, Rows

FOREIGN_CLOCK = 10.0
"""Minimum difference of stamps and receipt [s] from which they are different clocks."""
RESTART_FALL = 1.0
"""Minimum fall of a clock [s] that is a restart; messages out of order differ by less."""
SET_JUMP = 60.0
"""Minimum jump of a clock relative to receipt [s] that means it was set; links delay messages by less."""
SESSION_GAP = 1e-3
"""Minimum distance of a session from the one before [s], so that their rows do not mix."""
MEDIAN_MESSAGES = 5
"""Number of messages on both sides of a jump whose medians must show it; a single wrong stamp does not."""
MAX_JUMPS = 50
"""Maximum number of jumps of a topic; with more, its stamps are of several senders."""


@dataclass(frozen=True)
class Stamps:
    """Times of the n messages of one topic.

    Attributes:
        topic: Name of the topic.
        received: Times of receipt by the logger, in the order of the log, (n,) [s].
        stamped: Times of measurement in the messages, (n,) [s]; NaN for a message without a stamp.
        wraps: Period after which the stamp wraps to 0 [s]; 0 if the stamp does not wrap.
        again: Indices of the messages at which the logger's clock restarts.
    """

    topic: str
    received: Array
    stamped: Array
    wraps: float = 0.0
    again: tuple[int, ...] = ()


class OneClock(NamedTuple):
    """Time stamps of several topics, converted to one clock.

    Attributes:
        times: Times of each topic's messages [s].
        notes: Corrections of stamps, a line each.
        begins: Times at which a clock restarts [s], increasing: a session begins at each.
    """

    times: list[Array]
    notes: list[str]
    begins: Array


def one_clock(topics: Sequence[Stamps]) -> OneClock:
    """Return the times of the messages of all topics on the logger's clock, with notes on corrections.

    Args:
        topics: Stamps and times of receipt of each topic.
    """
    topics = [replace(each, stamped=_unwrapped(each)) for each in topics]
    times = [np.empty(len(each.received)) for each in topics]
    notes: list[str] = []
    begins: list[float] = []
    begun, latest = 0.0, -np.inf
    for rows, whose in _between_restarts(topics):
        parts = [
            replace(each, received=each.received[own], stamped=each.stamped[own])
            for each, own in zip(topics, rows, strict=True)
        ]
        if not any(len(each.received) for each in parts):
            continue
        moved, lines = _shifted(parts)
        first = min(float(t.min()) for t in moved if len(t))
        late = max(latest + SESSION_GAP - first, 0.0)
        if np.isfinite(latest):
            begins.append(first + late)
            notes.append(
                f"the clock of {whose} begins again {first + late - begun:.2f} s after the log's start: "
                "a session begins there"
            )
        else:
            begun = first
            notes += lines
        for t, own, part in zip(times, rows, moved, strict=True):
            t[own] = part + late
        latest = max(float(t.max()) for t in moved if len(t)) + late
    return OneClock(times, notes, np.array(begins))


def _shifted(topics: Sequence[Stamps]) -> tuple[list[Array], list[str]]:
    """Return the times of topics whose clocks do not restart, on the logger's clock.

    Returns:
        Times of each topic [s], and a line for each clock whose stamps were shifted.
    """
    delays = []
    for each in topics:
        there = np.isfinite(each.stamped)
        delays.append(float(np.median((each.received - each.stamped)[there])) if there.any() else 0.0)
    shifts, notes = _shifts(topics, delays)
    times = [
        np.where(np.isfinite(each.stamped), each.stamped + shift, each.received)
        for each, shift in zip(topics, shifts, strict=True)
    ]
    return times, notes


def _unwrapped(each: Stamps) -> Array:
    """Return stamps [s] that increase where the counter of the stamp wraps to 0."""
    if not each.wraps:
        return each.stamped
    there = np.flatnonzero(np.isfinite(each.stamped))
    out = each.stamped.copy()
    step, passed = np.diff(out[there]), np.diff(each.received[there])
    falls = (step < -0.5 * each.wraps) & (np.abs(step + each.wraps - passed) < SET_JUMP)
    out[there[1:]] += each.wraps * np.cumsum(falls)
    return out


def _between_restarts(topics: Sequence[Stamps]) -> Iterator[tuple[list[Rows], str]]:
    """Yield, for each stretch between restarts of clocks, the rows of each topic and the restarted clock."""
    count = max((len(each.again) for each in topics), default=0)
    edges = [[0, *each.again, len(each.received)] for each in topics]
    for number in range(count + 1):
        whole = [np.arange(own[number], own[number + 1]) for own in edges]
        parts = [
            replace(each, received=each.received[rows], stamped=each.stamped[rows])
            for each, rows in zip(topics, whole, strict=True)
        ]
        whose = "receipt"
        for inner, names in _between_jumps(parts):
            yield [rows[own] for rows, own in zip(whole, inner, strict=True)], names or whose


def _between_jumps(topics: Sequence[Stamps]) -> Iterator[tuple[list[Rows], str]]:
    """Yield, for each stretch between jumps of stamps, the rows of each topic and the jumped topics.

    A jump lies between the receipt of two messages.  Jumps of several topics whose intervals overlap are one
    restart.  It is placed at the first receipt after it, and it also splits topics without a jump there.
    """
    jumps = [_jumps(each) for each in topics]
    intervals = [
        (float(each.received[before]), float(each.received[after]), number, after)
        for number, (each, own) in enumerate(zip(topics, jumps, strict=True))
        for before, after in own
    ]
    edges = [[0] for _ in topics]
    names = [""]
    left = sorted(intervals, key=lambda interval: interval[1])
    while left:
        at = left[0][1]
        # The first jump is in its own group even if the receipt of its messages does not rise.
        group = [left[0], *(each for each in left[1:] if each[0] < at)]
        left = [each for each in left[1:] if each[0] >= at]
        own = {number: after for _, _, number, after in reversed(group)}
        for number, each in enumerate(topics):
            there = np.searchsorted(np.maximum.accumulate(each.received), at) if len(each.received) else 0
            edges[number].append(max(own.get(number, int(there)), edges[number][-1]))
        listed = [topics[number].topic for number in sorted(own)]
        more = f" and {len(listed) - 4} more" if len(listed) > 4 else ""
        names.append(", ".join(listed[:4]) + more)
    for own_edges, each in zip(edges, topics, strict=True):
        own_edges.append(len(each.received))
    for number, name in enumerate(names):
        yield [np.arange(own[number], own[number + 1]) for own in edges], name


def _jumps(each: Stamps) -> list[tuple[int, int]]:
    """Return the rows before and after every lasting jump of a topic's stamps relative to receipt."""
    there = np.flatnonzero(np.isfinite(each.stamped))
    if len(there) < 2:
        return []
    late = each.received[there] - each.stamped[there]
    step = np.diff(late)
    places = np.flatnonzero((np.diff(each.stamped[there]) < -RESTART_FALL) | (np.abs(step) > SET_JUMP))
    found = []
    for place in places.tolist():
        before = np.median(late[max(place + 1 - MEDIAN_MESSAGES, 0) : place + 1])
        after = np.median(late[place + 1 : place + 1 + MEDIAN_MESSAGES])
        if abs(after - before) > 0.5 * abs(step[place]):
            found.append((int(there[place]), int(there[place + 1])))
    return found if len(found) <= MAX_JUMPS else []


def _shifts(topics: Sequence[Stamps], delays: Sequence[float]) -> tuple[list[float], list[str]]:
    """Return the shift of each topic's stamps [s], and a line for each clock that is shifted.

    Topics whose delays are similar share one foreign clock and get the same shift.  The smallest delay of
    these topics is used, because receipt is never before the measurement.

    Args:
        topics: Stamps of each topic.
        delays: Median time from stamp to receipt of each topic [s].
    """
    shifts, notes = [0.0] * len(delays), []
    left = sorted(
        (place for place, delay in enumerate(delays) if abs(delay) > FOREIGN_CLOCK), key=delays.__getitem__
    )
    while left:
        shift = delays[left[0]]
        group = [place for place in left if delays[place] - shift <= FOREIGN_CLOCK]
        for place in group:
            shifts[place] = shift
        names = ", ".join(sorted(topics[place].topic for place in group)[:4])
        more = f" and {len(group) - 4} more" if len(group) > 4 else ""
        notes.append(
            f"stamps of {names}{more} are of another clock: moved by {shift:.3f} s to the logger's "
            "(exact among these; relative to other messages, to within the shortest delay of receipt)"
        )
        left = left[len(group) :]
    return shifts, notes
