"""Clocks of a log: plausibility of units, and receive times of periodic messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.logs.logmap import Time

SLOWEST, FASTEST = 0.5, 5000.0
"""Plausible range of the sample rate of a log's fastest sensor [Hz]."""
USUAL = (1.0, 1000.0)
"""Usual sample rates, required of a proposed other unit [Hz]."""
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
LEAST = 50
"""Minimum number of stamps for the fit of an even clock."""
CLOSE, BURSTS = 0.2, 0.25
"""Ratio to the mean step below which a step is part of a burst; share of such steps in a clock of bursts."""
PAUSE = 20.0
"""Ratio to the mean step above which a step is a pause and the even clock restarts."""
LATEST, STRETCHES = 3.0, 20
"""Maximum delay of a message in longest silences; maximum delay in periods of the soonest message of most of
STRETCHES parts."""


@dataclass(frozen=True)
class Evened:
    """Send times of periodic messages, estimated from their receive times.

    Attributes:
        t: Send times [s], (n,); all are late by the shortest delay of a message, which receive times cannot
            show.
        period: Time between two messages of the sender [s].
        latest: Largest delay of a message relative to the message with the shortest delay [s].
    """

    t: Array
    period: float
    latest: float


def require_plausible(step: float, time: Time) -> None:
    """Raise an error if a clock makes the fastest sensor implausibly slow or fast.

    Args:
        step: Median step of the log's fastest channel [s], as the map reads the clock.
        time: The clock of the map.

    Raises:
        DataError: The declared unit of time is implausible; the message names plausible units.
    """
    if not np.isfinite(step) or step <= 0.0 or SLOWEST <= 1.0 / step <= FASTEST:
        return
    own = PER_SECOND.get(time.unit)
    rates = {} if own is None else {unit: each / own / step for unit, each in PER_SECOND.items()}
    fitting = {unit: rate for unit, rate in rates.items() if USUAL[0] <= rate <= USUAL[1]}
    remedy = " or ".join(
        f'set time.unit = "{unit}", which makes it {rate:.3g} Hz' for unit, rate in fitting.items()
    )
    raise DataError(
        f"column {time.column} read in {time.unit} gives the log's fastest column {1.0 / step:.3g} samples "
        f"per second, which no vehicle's log has: {remedy or 'name the column of the clock, and its unit'}"
    )


def bunched(t: Array) -> bool:
    """Return whether time stamps come in bursts, as receive times do: many steps are far below the mean.

    Args:
        t: Stamps of every message of one topic [s], (n,), not falling.
    """
    steps = np.diff(t)
    if len(t) < LEAST or not t[-1] > t[0]:
        return False
    usual = steps[steps < PAUSE * steps.mean()]
    return bool(np.mean(steps < CLOSE * usual.mean()) > BURSTS)


def evened(t: Array) -> Evened | None:
    """Return the send times of a periodic topic, estimated from its receive times.

    A message is received no earlier than it was sent.  So the sender's clock is the closest straight line
    below the receive times, plotted over the message number: the edge, at the mean number, of their lower
    convex hull.  The order is kept.  A pause starts a new line.

    Args:
        t: Receive times of every message [s], (n,), not falling.

    Returns:
        Send times; None if messages were lost, or were not sent at even steps.
    """
    if len(t) < LEAST or not t[-1] > t[0]:
        return None
    steps = np.diff(t)
    pauses = np.flatnonzero(steps > PAUSE * steps.mean()) + 1
    whole = _fitted(t, [0, len(t)])
    return whole if whole is not None or not len(pauses) else _fitted(t, [0, *pauses.tolist(), len(t)])


def _fitted(t: Array, edges: Sequence[int]) -> Evened | None:
    """Fit a line to the receive times of each part that is long enough; None if the lines fit badly.

    Args:
        t: Receive times of every message [s], (n,), not falling.
        edges: Indices at which the parts begin, and n.
    """
    out, slopes, longest = t.copy(), [], 0.0
    for start, stop in pairwise(edges):
        if stop - start >= LEAST:
            out[start:stop], slope = _line(t[start:stop])
            slopes.append(slope)
            longest = max(longest, float(np.diff(t[start:stop]).max()))
    if not slopes:
        return None
    late, period = t - out, float(np.median(slopes))
    if period <= 0.0 or late.max() > LATEST * (longest + period) or (np.diff(out) <= 0.0).any():
        return None
    soonest = [part.min() for part in np.array_split(late, STRETCHES)]
    if np.median(soonest) > LATEST * period:  # lost messages make the receive times deviate from any line
        return None
    return Evened(out, period, float(late.max()))


def _line(t: Array) -> tuple[Array, float]:
    """Return the closest line below all receive times, as its values [s], (n,), and its slope [s].

    Args:
        t: Receive times [s], (n,), over their index.
    """
    number = np.arange(len(t), dtype=float)
    line = number / max(len(t) - 1, 1) * (t[-1] - t[0]) + t[0]
    try:
        hull = scipy.spatial.ConvexHull(np.column_stack([number, t - line]))
    except scipy.spatial.QhullError:  # all on one line
        return line, float((t[-1] - t[0]) / (len(t) - 1))
    below = hull.equations[hull.equations[:, 1] < 0.0]
    heights = -(below[:, :1] * number.mean() + below[:, 2:]) / below[:, 1:2]
    a, b, c = below[int(np.argmax(heights))]
    found: Array = line - (a * number + c) / b
    return found, float(found[1] - found[0])
