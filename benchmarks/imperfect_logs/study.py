"""Recordings of one study under one condition: a log with faults of sensors, or flown under feedback control.

Cases, vehicles and clean flights are those of `hidden_effects` in its own simulator.  A seed hides the same
effects under every condition, and a corrupted log is that of the clean flight of `CLEAN`.
"""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np
import polars as pl

from benchmarks.hidden_effects import flights
from benchmarks.hidden_effects.cases import Case, weaker
from benchmarks.hidden_effects.study import SESSIONS, WEAKER, Flown, flyable, telling
from benchmarks.imperfect_logs import closed_loop
from benchmarks.imperfect_logs.sensors import SPOILT
from hydro.core.errors import DataError

CLEAN = "clean"
IN_CURRENT = " in a current"
CLOSED = tuple(
    task + where for task in (closed_loop.STATION, closed_loop.WAY_POINTS) for where in ("", IN_CURRENT)
)
CONDITIONS = (CLEAN, *SPOILT, *CLOSED)
ALSO = {
    "held at 5 Hz, late": "sensor_delay",
    "interpolated from 5 Hz, late": "sensor_delay",
    "filtered": "sensor_delay",
    **{name: "ocean_current" for name in CLOSED if name.endswith(IN_CURRENT)},
}
"""Hidden effects of a condition itself, in the catalogue's names: they are true, not false alarms."""
OF_LOG = ("sensor_delay",)
"""Those of them that only the log has; a held-out flight is clean."""
SHARE = 0.1
"""Share of the given file's squared 5 s error that the hidden effect must cause in the clean flight."""


def clean(case: Case, seconds: float) -> tuple[Case, Flown]:
    """Record a case without feedback control, with a hidden effect that makes SHARE of the error.

    Raises:
        DataError: The motion diverges even with the weakest hidden effect.
    """
    return telling(*flyable(case, seconds), seconds, SHARE)


def under_feedback(case: Case, flown: Flown, condition: str, seconds: float) -> tuple[Case, Flown]:
    """Record the same vehicle under a controller, in the current of the condition.

    The hidden effect becomes weaker if the controller cannot hold the vehicle.

    Raises:
        DataError: The controller cannot hold the vehicle even with the weakest effect.
    """
    task = condition.removesuffix(IN_CURRENT)
    stream = (closed_loop.current(flown.given, case.seed),) if condition.endswith(IN_CURRENT) else ()
    rows = [round(seconds / SESSIONS / flights.DT)] * (SESSIONS + 1)
    for left in range(WEAKER, -1, -1):
        try:
            *measured, held_out = closed_loop.sessions(
                flown.given,
                flown.exact,
                (*case.hidden, *stream),
                task,
                rows=rows,
                depth=case.depth,
                noise=case.noise,
                seed=case.seed,
            )
        except DataError:
            if not left:
                raise
            case = weaker(case)
        else:
            break
    case = replace(case, hidden=(*case.hidden, *stream))
    return case, Flown(flown.given, flown.exact, pl.concat(measured), held_out)


def logged(case: Case, condition: str, seconds: float) -> tuple[Case, Flown]:
    """Record a case under a condition; the held-out session has no faults of sensors.

    Raises:
        DataError: The motion diverges even with the weakest hidden effect.
    """
    case, flown = clean(case, seconds)
    if condition in CLOSED:
        return under_feedback(case, flown, condition, seconds)
    if condition in SPOILT:
        rng = np.random.default_rng([case.seed, zlib.crc32(condition.encode())])
        return case, replace(flown, measured=SPOILT[condition](flown.measured, rng))
    return case, flown
