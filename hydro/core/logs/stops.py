"""Stop commands: NaN in an autopilot's outputs, and pulses of width 0 while it is disarmed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hydro.core.columns import Array, Mask
from hydro.core.logs.logmap import Command, Commands
from hydro.core.logs.resample import USUAL_STEPS


def rest(source: Command, block: Commands) -> float:
    """Return the number that a command column of a log contains for zero thrust.

    Args:
        source: Column of the map, with its scale and offset.
        block: Commands of the map, with their unit.
    """
    neutral = block.pwm.neutral if block.unit == "pwm" else 0.0
    return (neutral - source.offset) / source.scale


def stops(t: Array, values: Array, unset: Mask | None, source: Command, block: Commands) -> Mask:
    """Return a mask of the n rows in which a command column stops its thruster, (n,).

    A pulse of width 0 is a missing pulse, and an electronic speed controller without pulses stops.  NaN is a
    stop if it lasts longer than a gap of the column.  A shorter run of NaN is an empty cell of a table that
    joins several sensors.

    Args:
        t: Times of the rows [s], (n,), not falling.
        values: The column as logged, (n,), NaN where a cell has no number.
        unset: Mask of the rows in which the log contains NaN, (n,); None without NaN.
        source: Column of the map.
        block: Commands of the map.
    """
    if block.off == "hold":
        return np.zeros(len(t), bool)
    none = (values == 0.0) if block.unit == "pwm" and source.offset == 0.0 else np.zeros(len(t), bool)
    if unset is None or not unset.any():
        return np.asarray(none)
    told = np.flatnonzero(np.isfinite(values))
    if not len(told):
        return np.asarray(none | unset)
    times = t[told]
    steps = np.diff(times)
    longest = USUAL_STEPS * float(np.median(steps)) if len(steps) else 0.0
    after = np.searchsorted(told, np.arange(len(t)))
    before = np.r_[t[0], times][after]
    until = np.r_[times, t[-1]][after]
    return np.asarray(none | (unset & (until - before > longest)))


def never(columns: Mapping[str, tuple[Array, Mask]]) -> list[str]:
    """Return the names of command columns that never drive their thruster, because they hold only stops.

    The result is empty if no column at all drives a thruster.

    Args:
        columns: Values as logged and mask of the rows that are stops, both (n,), by column.
    """
    idle = [
        name
        for name, (values, stopped) in columns.items()
        if stopped.any() and not (np.isfinite(values) & ~stopped).any()
    ]
    return idle if len(idle) < len(columns) else []
