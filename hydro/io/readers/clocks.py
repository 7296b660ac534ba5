"""Stamps of several clocks on one: what each topic's messages say of their time, beside when they came.

A header stamp is when something was measured, the time of receipt when the logger had it; the stamp is
better where both count from one epoch.  Autopilots and simulators stamp in seconds since their own start:
such stamps keep their steps and are moved to the logger's clock as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array

APART = 10.0
"""Stamps that lie so many seconds from their receipt, and more, are of another clock."""


@dataclass(frozen=True)
class Stamps:
    """Times of a topic's messages [s], shape (n,): of receipt, and as stamped (NaN without a stamp)."""

    topic: str
    received: Array
    stamped: Array
    wraps: float = 0.0


def one_clock(topics: Sequence[Stamps]) -> tuple[list[Array], list[str]]:
    """The times of all topics' messages on one clock, and what was done to whose stamps.

    Args:
        topics: Stamps and times of receipt of each topic.

    Returns:
        Times [s] of each topic, and a line for each clock that was moved.
    """
    stamped = [_unwrapped(each) for each in topics]
    delays = [
        float(np.median((each.received - own)[np.isfinite(own)])) if np.isfinite(own).any() else 0.0
        for each, own in zip(topics, stamped, strict=True)
    ]
    shifts, notes = _shifts(topics, delays)
    times = [
        np.where(np.isfinite(own), own + shift, each.received)
        for each, own, shift in zip(topics, stamped, shifts, strict=True)
    ]
    return times, notes


def _unwrapped(each: Stamps) -> Array:
    """Stamps as they came, without the jump back of a counter that begins again."""
    if not each.wraps:
        return each.stamped
    there = np.flatnonzero(np.isfinite(each.stamped))
    out = each.stamped.copy()
    falls = np.diff(out[there]) < -0.5 * each.wraps
    out[there[1:]] += each.wraps * np.cumsum(falls)
    return out


def _shifts(topics: Sequence[Stamps], delays: Sequence[float]) -> tuple[list[float], list[str]]:
    """By how much each topic's stamps are moved: those of one foreign clock all by the same.

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
