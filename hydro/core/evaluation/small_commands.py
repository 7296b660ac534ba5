"""Small commands that are frequent in a held-out recording and rare in the training recording.

The dead band of a thruster acts on small commands only.  A recording of large pulses does not show the dead
band, and a controller that holds a heading or a position gives few other commands.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import VELOCITY, Array
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import (
    DELAY,
    MAX_REVERSE,
    MAX_THRUST,
    TIME_CONSTANT,
    UNIT_WRENCH,
    thrusts,
)

SMALL = (0.005, 0.05)
"""Range of small wrenches, as shares of the largest wrench along their axis.

The lower bound excludes rest.  The upper bound is about the dead band of a usual speed controller, 25 of 400
microseconds.
"""
LEAST_SHARE = 0.3
"""Minimum share of the held-out time with small commands that is reported."""
RARE = 0.2
"""Maximum share of small commands in the training recording, relative to that of the held-out recording."""


@dataclass(frozen=True)
class Unseen:
    """Axis on which the held-out recording has frequent small commands, and the training recording has not.

    Attributes:
        axis: Name of the velocity along the axis, one of u to r.
        low: Lower bound of the small wrenches [N, N m].
        high: Upper bound of the small wrenches [N, N m].
        held_out: Fraction of the held-out time with small wrenches.
        training: Fraction of the training time with small wrenches.
    """

    axis: str
    low: float
    high: float
    held_out: float
    training: float


def unseen_small_commands(vehicle: Vehicle, training: Recording, held_out: Recording) -> Iterator[Unseen]:
    """Yield the axes with small commands that are frequent in held-out data and rare in training data.

    Args:
        vehicle: Vehicle file, whose thrusters turn commands into wrenches.
        training: Recording to which a model was fitted.
        held_out: Recording that the model predicts.
    """
    table = candidate(vehicle).thrusters.copy()
    table[:, [TIME_CONSTANT, DELAY]] = 0.0  # a dead band acts on the command
    most = np.maximum(table[:, MAX_THRUST], table[:, MAX_REVERSE])
    reach = np.abs(table[:, UNIT_WRENCH]).T @ most
    here, there = (_wrench(table, record) for record in (training, held_out))
    for i, axis in enumerate(VELOCITY):
        if not reach[i] > 0.0:
            continue
        low, high = (share * reach[i] for share in SMALL)
        seen, used = (float(np.mean((size >= low) & (size <= high))) for size in (here[:, i], there[:, i]))
        if used >= LEAST_SHARE and seen < RARE * used:
            yield Unseen(axis, low, high, used, seen)


def _wrench(table: Array, record: Recording) -> Array:
    """Return the size of the thrusters' wrench along each axis in the rows of all segments, (N, 6)."""
    force = thrusts(table, record.commands, record.t, record.segments, after_gap=record.after_gap)
    rows = np.concatenate([np.arange(start, stop) for start, stop in record.segments])
    size: Array = np.abs(force[rows] @ table[:, UNIT_WRENCH])
    return size
