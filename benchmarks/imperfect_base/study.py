"""One study: change a vehicle whose hull no formula describes, diagnose it, and hold that to the truth."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl

from benchmarks.hidden_effects import flights
from benchmarks.hidden_effects.cases import Case, stronger, weaker
from benchmarks.hidden_effects.study import SCHEMA as ANSWERS
from benchmarks.hidden_effects.study import STRONGER, WEAKER, Ahead, Flown, answer, oracle, shares
from benchmarks.imperfect_base import base
from benchmarks.imperfect_base.base import SESSIONS, Base
from hydro.core.diagnosis.diagnose import diagnose
from hydro.core.errors import DataError

NOISES = (1.0, 0.5, 0.25, 0.1)
"""Times ordinary noise: the greatest in which the base error stands out."""
STANDS_OUT = 5.0
"""Base error over what noise alone makes of it, at least."""
SHARE = 0.1
"""Share of the given file's squared 5 s error that a change is to make."""

SCHEMA: dict[str, Any] = {
    **{k: ANSWERS[k] for k in ("kind", "seed", "preset", "noise", "seconds", "title", "called", "truth")},
    "share": pl.Float64,
    "base_error": pl.Float64,
    "base_floor": pl.Float64,
    **{k: ANSWERS[k] for k in ("verdicts", "effects", "members", "found_shares")},
    **{k: ANSWERS[k] for k in ("confidences", "supports", "p_values")},
    **{k: ANSWERS[k] for k in ("chi2_given", "chi2_own", "chi2_end", "before", "after", "oracle", "floor")},
    "unchanged": pl.String,
    "unchanged_seconds": pl.Float64,
    "with_before": pl.Boolean,
    "wall": pl.Float64,
    "cpu": pl.Float64,
    "study_cpu": pl.Float64,
    "failure": pl.String,
}
"""Columns of a results file, those of `hidden_effects.study` with others besides.

`base_error` is the root mean square 5 s error of the fitted file on the unchanged vehicle's held-out flight
and `base_floor` that of noise alone there; `share` the part of the given file's squared 5 s error on the
changed vehicle's held-out flight that the true change, added to the file, takes away; `unchanged` the path of
the flights that the file was fitted to and `unchanged_seconds` their length (older tables lack it: as long as
what is diagnosed); `with_before` whether the diagnosis had them as the recording before.  `cpu` is the
diagnosis' processor time and `study_cpu` that of all, a base fitted beforehand left out [s].
"""


def fly(case: Case, known: Base, seconds: float) -> list[pl.DataFrame]:
    """Four sessions to diagnose and one to hold out, of `seconds` / 4 each.

    Raises:
        DataError: The motion knows no bounds.
    """
    rows = [round(seconds / SESSIONS / flights.DT)] * (SESSIONS + 1)
    return flights.by_teacher(
        known.believed,
        case.hidden,
        rows=rows,
        depth=case.depth,
        noise=case.noise,
        seed=case.seed,
        mesh=known.hull,
    )


def standing_out(case: Case, known: Base, seconds: float) -> tuple[Case, float, float]:
    """The case in as much noise as the base error stands out of; that error, and what noise alone makes.

    Raises:
        DataError: It never does.
    """
    for noise in NOISES:
        quiet = replace(case, noise=noise, hidden=())
        errors = Ahead(fly(quiet, known, seconds)[-1], known.vehicle)
        error = errors.of(known.vehicle)
        if error >= STANDS_OUT * errors.floor:
            return replace(case, noise=noise), error, errors.floor
    raise DataError(f"the file of {case.preset} describes the panels to {error:.3g} m/s, near the noise")


def changed(case: Case, known: Base, seconds: float) -> tuple[Case, Flown, Ahead]:
    """The case so strong that the change makes its share, and so weak that the vehicle can be flown.

    Raises:
        DataError: The vehicle cannot be flown with any of it.
    """

    def flown(case: Case) -> Flown:
        *measured, held_out = fly(case, known, seconds)
        return Flown(known.vehicle, known.vehicle, pl.concat(measured), held_out)

    for _ in range(WEAKER):
        try:
            found = flown(case)
            break
        except DataError:
            case = weaker(case)
    else:
        found = flown(case)
    for _ in range(STRONGER):
        errors = Ahead(found.held_out, known.vehicle)
        if not case.hidden or shares(case, found, errors, errors.of(known.vehicle))[0] >= SHARE:
            break
        try:
            more = stronger(case, [True])
            case, found = more, flown(more)
        except DataError:
            break
    return case, found, Ahead(found.held_out, known.vehicle)


def run(
    case: Case,
    seconds: float,
    unchanged: float,
    folder: Path,
    with_oracle: bool = True,
    with_before: bool = False,
) -> dict[str, Any]:
    """The row of one study; what went wrong stands under `failure`.

    Args:
        case: What is changed.
        seconds: Of the flights to diagnose.
        unchanged: Of those that the file is fitted to [s].
        folder: Where fitted files are kept.
        with_oracle: Fit the true change, too.
        with_before: Give the diagnosis the unchanged flights.
    """
    row: dict[str, Any] = dict.fromkeys(SCHEMA) | {
        "kind": case.kind,
        "seed": case.seed,
        "preset": case.preset,
        "seconds": seconds,
        "title": case.title,
        "called": list(case.called),
        "unchanged_seconds": unchanged,
        "with_before": with_before,
        "failure": "",
    }
    begun = time.process_time()
    try:
        known = base.of(case.preset, case.seed, unchanged, folder)
        row["unchanged"] = str(known.unchanged)
        case, row["base_error"], row["base_floor"] = standing_out(case, known, seconds)
        case, flown, errors = changed(case, known, seconds)
        row |= {"noise": case.noise, "truth": json.dumps(case.hidden)}
        row["before"], row["floor"] = errors.of(known.vehicle), errors.floor
        row["share"] = shares(case, flown, errors, row["before"])[0]
        wall, cpu = time.perf_counter(), time.process_time()
        earlier = pl.read_parquet(known.unchanged) if with_before else None
        found = diagnose(flown.given, flown.measured, before=earlier)
        row |= {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
        row |= answer(found)
        row["after"] = errors.of(found.vehicle)
        if with_oracle:
            row["oracle"] = errors.of(oracle(case, flown))
    except Exception as error:  # a study that fails is a result, and must not end the others
        row["failure"] = f"{type(error).__name__}: {error}"
    row["study_cpu"] = time.process_time() - begun
    return row


def write(case: Case, seconds: float, unchanged: float, folder: Path, out: Path) -> None:
    """Write a study as files: vehicle.toml, before, after and held_out.parquet, and truth.json."""
    known = base.of(case.preset, case.seed, unchanged, folder)
    case, _, _ = standing_out(case, known, seconds)
    case, flown, _ = changed(case, known, seconds)
    out.mkdir(parents=True, exist_ok=True)
    (out / "vehicle.toml").write_text(known.unchanged.with_suffix(".toml").read_text())
    pl.read_parquet(known.unchanged).write_parquet(out / "before.parquet")
    flown.measured.write_parquet(out / "after.parquet")
    flown.held_out.write_parquet(out / "held_out.parquet")
    (out / "truth.json").write_text(json.dumps({"title": case.title, "hidden": case.hidden}))
