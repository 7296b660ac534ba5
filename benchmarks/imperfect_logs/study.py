"""One study under one condition: the log of a vehicle with something hidden, spoilt or flown under feedback.

Cases, vehicles and clean flights are those of `hidden_effects` in its own simulator; a study of a seed hides
the same under every condition, and a spoilt log is that of the very flight that is clean under `CLEAN`.
"""

from __future__ import annotations

import json
import time
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.hidden_effects import cases, flights, vehicles
from benchmarks.hidden_effects.cases import Case, weaker
from benchmarks.hidden_effects.study import SCHEMA as ANSWERS
from benchmarks.hidden_effects.study import SESSIONS, WEAKER, Ahead, Flown, answer, flyable, shares, telling
from benchmarks.imperfect_logs import closed_loop
from benchmarks.imperfect_logs.sensors import SPOILT
from hydro.core.diagnosis.diagnose import diagnose
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

KINDS = ("one", "none")
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
"""What a condition itself hides, as the catalogue calls it: true as well, and no alarm."""
OF_LOG = ("sensor_delay",)
"""Those of them that only the log has; a held-out flight is clean."""
SHARE = 0.1
"""Share of the given file's squared 5 s error that what is hidden is to make in the clean flight."""

SCHEMA: dict[str, Any] = {
    **{k: ANSWERS[k] for k in ("kind", "seed")},
    "condition": pl.String,
    **{k: ANSWERS[k] for k in ("preset", "noise", "seconds", "title")},
    "hidden": pl.List(pl.String),
    **{k: ANSWERS[k] for k in ("called", "truth", "misjudged", "share")},
    **{k: ANSWERS[k] for k in ("verdicts", "effects", "members", "found_shares")},
    **{k: ANSWERS[k] for k in ("confidences", "supports", "p_values")},
    **{k: ANSWERS[k] for k in ("chi2_given", "chi2_own", "chi2_end", "before", "after", "floor")},
    **{k: ANSWERS[k] for k in ("wall", "cpu")},
    "study_cpu": pl.Float64,
    "failure": pl.String,
}
"""Columns of a results file, those of `hidden_effects.study` with others besides.

`hidden` are the effects that the file lacks and `called` these with what the condition itself hides.  Errors
are those of 5 s replays of a held-out session, clean, or flown under the same feedback.
"""


def clean(case: Case, seconds: float, folder: Path) -> tuple[Case, Flown]:
    """The case as it is flown without feedback, strong enough to be told.

    Raises:
        DataError: The vehicle cannot be flown with any of it.
    """
    return telling(*flyable(case, seconds, folder), seconds, folder, SHARE)


def under_feedback(case: Case, flown: Flown, condition: str, seconds: float) -> tuple[Case, Flown]:
    """The same vehicle under a controller, in the current that the condition has.

    What is hidden becomes weaker where the controller cannot hold the vehicle.

    Raises:
        DataError: It cannot hold it with any of it.
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


def logged(case: Case, condition: str, seconds: float, folder: Path) -> tuple[Case, Flown]:
    """The case and its recordings under a condition; a held-out session is never spoilt.

    Raises:
        DataError: The vehicle cannot be flown with any of what is hidden.
    """
    case, flown = clean(case, seconds, folder)
    if condition in CLOSED:
        return under_feedback(case, flown, condition, seconds)
    if condition in SPOILT:
        rng = np.random.default_rng([case.seed, zlib.crc32(condition.encode())])
        return case, replace(flown, measured=SPOILT[condition](flown.measured, rng))
    return case, flown


def unspoilt(vehicle: Vehicle, case: Case, condition: str) -> Vehicle:
    """A diagnosed vehicle without the sensor effect that the condition's log has and a clean one has not."""
    also = ALSO.get(condition, "")
    if not also.startswith("sensor_") or also in case.called:
        return vehicle
    return vehicle.without(also)


def run(kind: str, seed: int, condition: str, seconds: float, folder: Path) -> dict[str, Any]:
    """The row of one study; what went wrong stands under `failure`."""
    case = cases.draw(kind, seed, "independent")
    row: dict[str, Any] = dict.fromkeys(SCHEMA) | {
        "kind": kind,
        "seed": seed,
        "condition": condition,
        "preset": case.preset,
        "noise": case.noise,
        "seconds": seconds,
        "title": case.title,
        "hidden": list(case.called),
        "called": sorted({*case.called, *([ALSO[condition]] if condition in ALSO else [])}),
        "failure": "",
    }
    begun = time.process_time()
    try:
        case, flown = logged(case, condition, seconds, folder)
        row["truth"] = json.dumps(case.hidden)
        row["misjudged"] = vehicles.damping_of(flown.given)
        errors = Ahead(flown.held_out, flown.exact)
        row["before"], row["floor"] = errors.of(flown.given), errors.floor
        row["share"] = shares(case, flown, errors, row["before"])[0]
        wall, cpu = time.perf_counter(), time.process_time()
        found = diagnose(flown.given, flown.measured)
        row |= {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
        row |= answer(found)
        row["after"] = errors.of(unspoilt(found.vehicle, case, condition))
    except Exception as error:  # a study that fails is a result, and must not end the others
        row["failure"] = f"{type(error).__name__}: {error}"
    row["study_cpu"] = time.process_time() - begun
    return row
