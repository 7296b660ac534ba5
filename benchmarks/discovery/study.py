"""Study of one vehicle with a law outside the catalogue: flight, diagnosis, comparison with the truth."""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np
import polars as pl

from benchmarks.discovery.laws import ahead_only, law, right
from benchmarks.hidden_effects import flights, vehicles
from hydro.core.diagnosis.findings import Diagnosis, extended
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.pipeline import diagnose_log
from hydro.core.discovery.discover import discovered
from hydro.core.effects.formula import amounts, joined
from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.identification.fit import fit

SESSIONS, ATTEMPTS = 4, 40
SCHEMA: dict[str, Any] = {
    "kind": pl.String,
    "seed": pl.Int64,
    "preset": pl.String,
    "seconds": pl.Float64,
    "truth": pl.String,
    "terms": pl.String,
    "form": pl.Boolean,
    "discovered": pl.Boolean,
    "verdicts": pl.List(pl.String),
    "effects": pl.List(pl.String),
    "confidences": pl.List(pl.Float64),
    "chi2_own": pl.Float64,
    "chi2_end": pl.Float64,
    "before": pl.Float64,
    "catalogue": pl.Float64,
    "after": pl.Float64,
    "oracle": pl.Float64,
    "floor": pl.Float64,
    "cpu": pl.Float64,
    "failure": pl.String,
}
"""Columns of a results file.  Errors are root mean squares of velocities 5 s ahead on the held-out session:
of the file, of the catalogue's effects, of the discovered terms, of the true law, and of noise."""


def study(kind: str, seed: int, seconds: float) -> dict[str, Any]:
    """Return the row of one study; errors are in `failure`."""
    row: dict[str, Any] = dict.fromkeys(SCHEMA) | {
        "kind": kind,
        "seed": seed,
        "seconds": seconds,
        "failure": "",
    }
    rng = np.random.default_rng([seed, 23])
    try:
        given, exact, rows, truth, tables, row["kind"], row["preset"] = flown(kind, seed, seconds, rng)
        row["truth"] = json.dumps(rows)
        raw, held = pl.concat(tables[:-1]), tables[-1]
        clock = time.process_time()
        log = preprocess(given, raw)
        plain = diagnose_log(given, log)
        found = discovered(given, log, plain)
        row["cpu"] = time.process_time() - clock
        row |= answer(plain, found)
        errors = Ahead(held, exact)
        row |= {"before": errors.of(given), "floor": errors.floor, "catalogue": errors.of(plain.vehicle)}
        row["after"] = errors.of(found.vehicle)
        formulas = found.vehicle.effects("formula")
        row["discovered"] = bool(formulas)
        row["terms"] = json.dumps(amounts(formulas[0])) if formulas else ""
        if rows:
            row["form"] = bool(formulas) and right(
                truth, formulas[0], ahead_only(raw), powers=row["kind"] != "threshold"
            )
            own = [str(t["name"]) for t in given.effect if t["name"] not in ("added_mass", "formula")]
            row["oracle"] = errors.of(fit(extended(given, [truth]), raw, [*own, "formula"]).vehicle)
    except Exception as error:  # a study that fails is a result, and must not end the others
        row["failure"] = f"{type(error).__name__}: {error}"
    return row


def flown(kind: str, seed: int, seconds: float, rng: np.random.Generator) -> Any:
    """Return a vehicle with a law under which its motion does not diverge, and its flights."""
    for _ in range(ATTEMPTS):
        preset = str(rng.choice(vehicles.PRESETS))
        exact = vehicles.preset(preset)
        name, rows, every = law(seed, exact, rng) if kind == "law" else ("none", [], [])
        given = vehicles.misjudged(exact, np.random.default_rng([seed, 11]))
        counts = [round(seconds / SESSIONS / flights.DT)] * (SESSIONS + 1)
        how: dict[str, Any] = {"rows": counts, "depth": 15.0, "noise": 1.0, "seed": seed, "laws": rows}
        try:
            tables = flights.independent(exact, exact, (), {}, **how)
        except DataError:
            continue
        return given, exact, rows, joined(every) if every else {}, tables, name, preset
    raise DataError(f"no vehicle can be flown with the law of seed {seed}")


def answer(plain: Diagnosis, found: Diagnosis) -> dict[str, Any]:
    """Return the results of two diagnoses as columns: without and with discovery."""
    told = [one for one in found.findings if one.verdict not in ("not_excited", "not_separable")]
    return {
        "verdicts": [one.verdict for one in told],
        "effects": [one.effect for one in told],
        "confidences": [None if np.isnan(one.confidence) else float(one.confidence) for one in told],
        "chi2_own": plain.chi2[1],
        "chi2_end": found.chi2[2],
    }
