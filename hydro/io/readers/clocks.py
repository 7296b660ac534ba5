"""Stamps of several clocks on one: what each topic's messages say of their time, beside when they came.

A header stamp is when something was measured, the time of receipt when the logger had it; the stamp is
better where both count from one epoch.  Autopilots and simulators stamp in seconds since their own start:
such stamps keep their steps and are moved to the logger's clock as a whole.  Where such a clock begins again,
because the autopilot or the simulator was restarted, so does a session; the order of receipt says where.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array, Rows

APART = 10.0
"""Stamps that lie so many seconds from their receipt, and more, are of another clock."""
BACK = 1.0
"""A clock that falls by more begins again [s]; messages overtake each other by less."""
LEAP = 60.0
"""A clock that gains or loses more against receipt at once was set [s]; links delay messages by less."""
NEXT = 1e-3
"""What a session begins after the one before at least [s], so that their rows do not mix."""
LASTING = 5
"""Messages on both sides of a jump whose medians must show it: a single wrong stamp is none."""
MOST = 50
"""Jumps of a topic; stamps with more are of several senders, not of a clock that was set."""


@dataclass(frozen=True)
class Stamps:
    """Times of a topic's messages [s], shape (n,): of receipt, and as stamped (NaN without a stamp).

    Attributes:
        topic: Its name.
        received: Times of receipt, in the order of the log.
        stamped: Times that the messages state.
        wraps: The stamp begins again at 0 after so many seconds; 0 where it never does.
        again: Rows from which on the clock of receipt begins again.
    """

    topic: str
    received: Array
    stamped: Array
    wraps: float = 0.0
    again: tuple[int, ...] = ()


class OneClock(NamedTuple):
    """Topics on one clock.

    Attributes:
        times: Times of each topic's messages [s].
        notes: What was done to whose stamps, a line each.
        begins: Times at which a clock begins again [s], rising: a session begins at each.
    """

    times: list[Array]
    notes: list[str]
    begins: Array


def one_clock(topics: Sequence[Stamps]) -> OneClock:
    """Put the messages of all topics on the logger's clock.

    Args:
        topics: Stamps and times of receipt of each topic.
    """
    topics = [replace(each, stamped=_unwrapped(each)) for each in topics]
    times = [np.empty(len(each.received)) for each in topics]
    notes: list[str] = []
    begins: list[float] = []
    begun, latest = 0.0, -np.inf
    for rows, whose in _stretches(topics):
        parts = [
            replace(each, received=each.received[own], stamped=each.stamped[own])
            for each, own in zip(topics, rows, strict=True)
        ]
        if not any(len(each.received) for each in parts):
            continue
        moved, lines = _moved(parts)
        first = min(float(t.min()) for t in moved if len(t))
        late = max(latest + NEXT - first, 0.0)
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


def _moved(topics: Sequence[Stamps]) -> tuple[list[Array], list[str]]:
    """Return the times of topics whose clocks run on, and a line for each clock that was moved."""
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
    """Return stamps without the jump back of a counter that begins again, while receipt goes on."""
    if not each.wraps:
        return each.stamped
    there = np.flatnonzero(np.isfinite(each.stamped))
    out = each.stamped.copy()
    step, passed = np.diff(out[there]), np.diff(each.received[there])
    falls = (step < -0.5 * each.wraps) & (np.abs(step + each.wraps - passed) < LEAP)
    out[there[1:]] += each.wraps * np.cumsum(falls)
    return out


def _stretches(topics: Sequence[Stamps]) -> Iterator[tuple[list[Rows], str]]:
    """Yield the rows of each topic between restarts of clocks, and whose clock was restarted before."""
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
    """Yield the rows of each topic between jumps of their stamps, and the topics whose stamps jumped before.

    A jump lies between the receipt of two messages.  Jumps of several topics whose intervals share a time are
    one restart; it is placed at the first receipt after it, and parts the topics that show none there.
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
        group = [each for each in left if each[0] < at]
        left = [each for each in left if each[0] >= at]
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
    """Return the rows before and after every lasting jump of a topic's stamps against receipt."""
    there = np.flatnonzero(np.isfinite(each.stamped))
    if len(there) < 2:
        return []
    late = each.received[there] - each.stamped[there]
    step = np.diff(late)
    places = np.flatnonzero((np.diff(each.stamped[there]) < -BACK) | (np.abs(step) > LEAP))
    found = []
    for place in places.tolist():
        before = np.median(late[max(place + 1 - LASTING, 0) : place + 1])
        after = np.median(late[place + 1 : place + 1 + LASTING])
        if abs(after - before) > 0.5 * abs(step[place]):
            found.append((int(there[place]), int(there[place + 1])))
    return found if len(found) <= MOST else []


def _shifts(topics: Sequence[Stamps], delays: Sequence[float]) -> tuple[list[float], list[str]]:
    """Return by how much each topic's stamps are moved: those of one foreign clock all by the same.

    The smallest delay of a clock's topics is taken, for receipt is never before the measurement.
    """
    shifts, notes = [0.0] * len(delays), []
    left = sorted((place for place, delay in enumerate(delays) if abs(delay) > APART), key=delays.__getitem__)
    while left:
        shift = delays[left[0]]
        group = [place for place in left if delays[place] - shift <= APART]
        for place in group:
            shifts[place] = shift
        names = ", ".join(sorted(topics[place].topic for place in group)[:4])
        more = f" and {len(group) - 4} more" if len(group) > 4 else ""
        notes.append(
            f"stamps of {names}{more} are of another clock: moved by {shift:.3f} s to the logger's "
            "(exact among themselves; against the rest as good as the fastest receipt)"
        )
        left = left[len(group) :]
    return shifts, notes
