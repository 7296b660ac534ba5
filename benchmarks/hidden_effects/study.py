"""One study: record a vehicle with something hidden, diagnose it, and hold the answer against the truth."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.hidden_effects import flights, vehicles
from benchmarks.hidden_effects.cases import Case, stronger, weaker
from hydro.core.diagnosis.diagnose import diagnose
from hydro.core.diagnosis.findings import Diagnosis
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.identification.levenberg_marquardt import descend
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import LONGEST_SENSOR_DELAY, free
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.vehicle.description import Vehicle

SESSIONS = 4
WEAKER = 4  # times that what is hidden may be halved until the vehicle can be flown
STRONGER = 5  # times that it may be doubled until each effect makes the share that was asked for
ITERATIONS = 8  # of the oracle's fit, which begins at the truth

SCHEMA: dict[str, Any] = {
    "kind": pl.String,
    "seed": pl.Int64,
    "preset": pl.String,
    "source": pl.String,
    "noise": pl.Float64,
    "seconds": pl.Float64,
    "title": pl.String,
    "called": pl.List(pl.String),
    "truth": pl.String,
    "misjudged": pl.List(pl.String),
    "share": pl.Float64,
    "shares": pl.List(pl.Float64),
    "verdicts": pl.List(pl.String),
    "effects": pl.List(pl.String),
    "members": pl.List(pl.List(pl.String)),
    "found_shares": pl.List(pl.Float64),
    "confidences": pl.List(pl.Float64),
    "supports": pl.List(pl.Float64),
    "p_values": pl.List(pl.Float64),
    "chi2_given": pl.Float64,
    "chi2_own": pl.Float64,
    "chi2_end": pl.Float64,
    "before": pl.Float64,
    "after": pl.Float64,
    "oracle": pl.Float64,
    "floor": pl.Float64,
    "wall": pl.Float64,
    "cpu": pl.Float64,
    "failure": pl.String,
}
"""Columns of a results file.

`called` are the effects that an answer should name and `truth` everything hidden, as JSON; `misjudged` are
the file's own effects with wrong values.  `share` is the part of the squared 5 s replay error of the file as
given that what is hidden makes, `shares` that of each hidden effect beside the others.  Findings follow in
the order of the diagnosis, those that were not excited left out; `supports` are what their confidences were
made from, see `Finding`; older tables lack them.  `before`, `after`, `oracle` and `floor` are
root mean square errors of 5 s replays of the held-out session: of the file, of the diagnosed vehicle, of the
file with the true effects fitted, and of noise alone.
"""


@dataclass(frozen=True)
class Flown:
    """What a study has recorded.

    Attributes:
        given: The vehicle file, its damping wrong.
        exact: The file with its right damping, nothing hidden.
        measured: Sessions to diagnose.
        held_out: One more session.
    """

    given: Vehicle
    exact: Vehicle
    measured: pl.DataFrame
    held_out: pl.DataFrame


def fly(case: Case, seconds: float, folder: Path) -> Flown:
    """Record a case: `seconds` in four sessions, and a held-out session of the same length as each.

    Raises:
        DataError: The motion diverges.
    """
    rows = [round(seconds / SESSIONS / flights.DT)] * (SESSIONS + 1)
    how: dict[str, Any] = {"rows": rows, "depth": case.depth, "noise": case.noise, "seed": case.seed}
    believed = exact = vehicles.preset(case.preset)
    if case.source == "teacher":
        exact = vehicles.of_teacher(case.preset, folder)
        tables = flights.by_teacher(believed, case.hidden, **how)
    elif case.source == "simulate":
        tables = flights.by_simulate(believed, vehicles.joined(exact, case.hidden), **how)
    else:
        tables = flights.independent(believed, exact, case.hidden, case.foreign, **how)
    given = vehicles.misjudged(exact, np.random.default_rng([case.seed, 11]))
    return Flown(given, exact, pl.concat(tables[:-1]), tables[-1])


def flyable(case: Case, seconds: float, folder: Path) -> tuple[Case, Flown]:
    """The case as it is, or so much weaker that its motion has bounds, and what it records.

    Raises:
        DataError: The vehicle cannot be flown with any of it.
    """
    for _ in range(WEAKER):
        try:
            return case, fly(case, seconds, folder)
        except DataError:
            case = weaker(case)
    return case, fly(case, seconds, folder)


def shares(case: Case, flown: Flown, errors: Ahead, before: float) -> tuple[float, list[float]]:
    """Part of the given file's squared replay error that what is hidden makes, in all and each effect."""
    nothing = errors.of(flown.exact) ** 2
    everything = (
        errors.floor**2 if case.foreign else errors.of(vehicles.joined(flown.exact, case.hidden)) ** 2
    )
    each = []
    for left_out in case.hidden if not case.foreign else ():
        rest = [table for table in case.hidden if table is not left_out]
        each.append(errors.of(vehicles.joined(flown.exact, rest)) ** 2)

    def share(error: float) -> float:
        return float(np.clip((error - everything) / before**2, 0.0, 1.0))

    return share(nothing), [share(error) for error in each]


def telling(case: Case, flown: Flown, seconds: float, folder: Path, least: float) -> tuple[Case, Flown]:
    """The case with every hidden effect so strong that it makes a share of the error, where it can."""
    for _ in range(STRONGER):
        errors = Ahead(flown.held_out, flown.exact)
        together, each = shares(case, flown, errors, errors.of(flown.given))
        weak = [share < least for share in (each if len(each) > 1 else [together])]
        if case.foreign or not (case.hidden and any(weak)):
            break
        try:
            more = stronger(case, weak)
            case, flown = more, fly(more, seconds, folder)
        except DataError:
            break
    return case, flown


def oracle(case: Case, flown: Flown) -> Vehicle:
    """The given file with the true effects, fitted together with its own from where the truth is."""
    vehicle, given = vehicles.joined(flown.given, case.hidden), flown.given
    record = recording(vehicle, flown.measured)
    own = [str(t["name"]) for t in given.effect if CATALOGUE[str(t["name"])].kind != "inertia"]
    wanted = [*dict.fromkeys([*own, *(str(table["name"]) for table in case.hidden)])]
    unknown = free(vehicle, wanted, reach=record.track)
    late = "sensor_delay" in wanted
    shots = make_shots(record, lead=LONGEST_SENSOR_DELAY if late else 0.0)
    start = unknown.starts[0]
    values, _, _ = descend(unknown, start, OutputError.of(shots, unknown.at(start)), ITERATIONS)
    return unknown.at(values)


def run(
    case: Case, seconds: float, folder: Path, with_oracle: bool = True, least: float = 0.0
) -> dict[str, Any]:
    """The row of one study; what went wrong stands under `failure`."""
    row: dict[str, Any] = dict.fromkeys(SCHEMA) | {
        "kind": case.kind,
        "seed": case.seed,
        "preset": case.preset,
        "source": case.source,
        "noise": case.noise,
        "seconds": seconds,
        "title": case.title,
        "called": list(case.called),
        "failure": "",
    }
    try:
        case, flown = flyable(case, seconds, folder)
        if least:
            case, flown = telling(case, flown, seconds, folder, least)
        row["truth"] = json.dumps({"hidden": case.hidden, "foreign": case.foreign})
        row["misjudged"] = vehicles.damping_of(flown.given)
        errors = Ahead(flown.held_out, flown.exact)
        row["before"], row["floor"] = errors.of(flown.given), errors.floor
        row["share"], row["shares"] = shares(case, flown, errors, row["before"])
        wall, cpu = time.perf_counter(), time.process_time()
        found = diagnose(flown.given, flown.measured)
        row |= {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
        row |= answer(found)
        row["after"] = errors.of(found.vehicle)
        if with_oracle and not case.foreign:
            row["oracle"] = errors.of(oracle(case, flown))
    except Exception as error:  # a study that fails is a result, and must not end the others
        row["failure"] = f"{type(error).__name__}: {error}"
    return row


def answer(found: Diagnosis) -> dict[str, Any]:
    """What a diagnosis says, as columns."""
    told = [one for one in found.findings if one.verdict != "not_excited"]

    def numbers(values: Sequence[float]) -> list[float | None]:
        return [float(value) if math.isfinite(value) else None for value in values]

    given, own, end = found.chi2
    return {
        "verdicts": [one.verdict for one in told],
        "effects": [one.effect for one in told],
        "members": [list(one.members) for one in told],
        "found_shares": numbers([one.share for one in told]),
        "confidences": numbers([one.confidence for one in told]),
        "supports": numbers([one.support for one in told]),
        "p_values": numbers([one.p_value for one in told]),
        "chi2_given": given,
        "chi2_own": own,
        "chi2_end": end,
    }
