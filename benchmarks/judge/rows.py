"""Rows of a study: the findings of its diagnosis, every fitted candidate, and the errors after adding."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.judge.candidates import candidates
from benchmarks.judge.studies import LISTS, Study
from hydro.core.diagnosis.findings import WITH_VALUES, Diagnosis, Finding, extended
from hydro.core.diagnosis.pipeline import diagnose
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

Row = dict[str, Any]
DIGITS = 4
"""Significant digits of stored values: standard errors are rarely below a thousandth of a value."""

OF_STUDY: dict[str, Any] = {
    "list": pl.String,
    "seed": pl.Int64,
    "seconds": pl.Float64,
    "condition": pl.String,
    "preset": pl.String,
    "title": pl.String,
    "noise": pl.Float64,
    "share": pl.Float64,
    "hidden": pl.String,
    "called": pl.List(pl.String),
    "alias": pl.List(pl.String),
    "misjudged": pl.List(pl.String),
    "chi2_given": pl.Float64,
    "chi2_own": pl.Float64,
    "chi2_end": pl.Float64,
    "before": pl.Float64,
    "after": pl.Float64,
    "after_top": pl.Float64,
    "with_truth": pl.Float64,
    "floor": pl.Float64,
    "cpu": pl.Float64,
    "study_cpu": pl.Float64,
    "failure": pl.String,
}
"""Columns that are the same in every row of a study.

`before`, `after`, `after_top`, `with_truth` and `floor` are root mean square velocity errors 5 s ahead on
held-out data [m/s]: of the file, of the file with all stated findings added, with the first named finding
added, with the true effects added, and of noise alone.  `cpu` is the processor time of the
diagnosis and `study_cpu` that of the whole study [s].
"""
OF_ROW: dict[str, Any] = {
    "role": pl.String,
    "rank": pl.Int16,
    "engine": pl.String,
    "step": pl.Int16,
    "effect": pl.String,
    "verdict": pl.String,
    "members": pl.List(pl.String),
    "confidence": pl.Float64,
    "support": pl.Float64,
    "chosen": pl.Boolean,
    "own": pl.Boolean,
    "plausible": pl.Boolean,
    "entries": pl.Int16,
    "shots": pl.Int32,
    "costs": pl.List(pl.Float32),
    "chi2": pl.Float64,
    "residuals": pl.Float64,
    "left_out": pl.Float64,
    "evidence": pl.Float64,
    "lead": pl.Float64,
    "absorbs": pl.Float64,
    "values": pl.String,
    "errors": pl.String,
    "off": pl.List(pl.Float32),
    "affected": pl.List(pl.Boolean),
}
"""Columns of one finding (`role` "finding"), one candidate ("candidate") or a study without either ("none").

`off` are differences from the truth in standard errors, entry by entry; `affected` says which entries the
hidden effect changes.  The other columns are those of `core.diagnosis.findings.Finding` and
`benchmarks.judge.candidates`.
"""
SCHEMA = OF_STUDY | OF_ROW
KEY = ("list", "seed", "seconds")


def run(name: str, seed: int, seconds: float, folder: Path) -> list[Row]:
    """Run one study and return its rows; an error is stored in the column `failure`.

    Args:
        name: Name of the list.
        seed: Seed of the study.
        seconds: Length of the recording [s].
        folder: Folder of files that studies share.
    """
    shared: Row = dict.fromkeys(OF_STUDY) | {"list": name, "seed": seed, "seconds": seconds, "failure": ""}
    begun = time.process_time()
    rows: list[Row] = []
    try:
        study = LISTS[name].prepare(seed, seconds, folder)
        shared |= dict(study.facts) | {"called": list(study.called), "alias": list(study.alias)}
        shared["misjudged"] = [one for one in study.misjudged if one not in study.called]
        clock = time.process_time()
        found = diagnose(study.given, study.measured, before=study.before)
        shared["cpu"] = time.process_time() - clock
        shared |= dict(zip(("chi2_given", "chi2_own", "chi2_end"), found.chi2, strict=True))
        rows = [*_findings(study, found), *map(_candidate, candidates(found))]
        shared |= _errors(study, found)
    except Exception as error:  # a failed study is a result; the others continue
        shared["failure"] = f"{type(error).__name__}: {error}"
    shared["study_cpu"] = time.process_time() - begun
    return [shared | row for row in rows or [dict.fromkeys(OF_ROW) | {"role": "none"}]]


def _findings(study: Study, found: Diagnosis) -> Iterator[Row]:
    """Yield a row for each finding, except findings that the recording cannot show an effect."""
    for rank, one in enumerate(found.findings):
        if one.verdict == "not_excited":
            continue
        off, affected = _against_truth(study, one)
        yield dict.fromkeys(OF_ROW) | {
            "role": "finding",
            "rank": rank,
            "effect": one.effect,
            "verdict": one.verdict,
            "members": list(one.members),
            "confidence": _finite(one.confidence),
            "support": _finite(one.support),
            "values": _text(one.parameters),
            "errors": _text(one.standard_errors),
            "off": off,
            "affected": affected,
        }


def _candidate(one: Row) -> Row:
    """Return the row of one candidate in the form of the table."""
    finite = {name: _finite(value) for name, value in one.items() if isinstance(value, float)}
    return dict.fromkeys(OF_ROW) | {"role": "candidate"} | one | finite | {"values": _text(one["values"])}


def _against_truth(study: Study, one: Finding) -> tuple[list[float] | None, list[bool] | None]:
    """Return the errors of a right finding's values in standard errors, and which values the change affects.

    Values without a standard error, such as a place that the file fixes, are left out.  Both are None for
    other findings.
    """
    if study.truth is None or one.effect not in study.called or not one.parameters:
        return None, None
    values = _packed(one.effect, one.parameters, study.given)
    errors = _packed(one.effect, one.standard_errors, study.given)
    truth = _of_vehicle(one.effect, study.truth)
    given = _of_vehicle(one.effect, study.given)
    if values is None or errors is None or truth is None or not len(values) == len(errors) == len(truth):
        return None, None
    sure = np.isfinite(errors) & (errors > 0.0)
    affected = truth != (given if given is not None else 0.0)
    return ((values - truth)[sure] / errors[sure]).tolist(), affected[sure].tolist()


def _of_vehicle(effect: str, vehicle: Vehicle) -> np.ndarray | None:
    """Return the values of a vehicle's effect in packing order; None if the vehicle lacks the effect."""
    tables = vehicle.effects(effect)
    return _packed(effect, tables[0], vehicle) if tables else None


def _packed(effect: str, table: Mapping[str, Any], vehicle: Vehicle) -> np.ndarray | None:
    """Return an effect's numbers in packing order; None where the table is incomplete."""
    try:
        numbers = CATALOGUE[effect].pack({"name": effect, **table}, thrusters=len(vehicle.thruster))
    except (DataError, KeyError, TypeError, ValueError):
        return None
    return np.asarray(numbers, float)


def _errors(study: Study, found: Diagnosis) -> Row:
    """Return the prediction errors on held-out data before and after the findings are added."""
    if study.errors is None:
        return {}
    ahead, given = study.errors, study.given
    told = [one for one in found.findings if one.parameters and one.effect not in study.of_log]
    stated = [one for one in told if one.is_confirmed]
    first = next((one for one in told if one.verdict in WITH_VALUES), None)
    wanted = [(name, study.truth) for name in study.called]
    true = [
        {"name": name, **{k: v for k, v in truth.effects(name)[0].items() if k != "name"}}
        for name, truth in wanted
        if truth is not None and truth.effects(name)
    ]
    return {
        "before": ahead.of(given),
        "floor": ahead.floor,
        "after": ahead.of(extended(given, [_table(one) for one in stated])),
        "after_top": ahead.of(extended(given, [_table(first)])) if first is not None else None,
        "with_truth": ahead.of(extended(given, true)) if true else None,
    }


def _table(one: Finding) -> Row:
    """Return a finding as an `[[effect]]` table."""
    return {"name": one.effect, **one.parameters}


def _finite(value: float) -> float | None:
    """Return the number, or None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def _text(values: Mapping[str, Any]) -> str:
    """Return values as JSON with DIGITS significant digits."""

    def short(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if isinstance(value, list | tuple):
            return [short(inner) for inner in value]
        if isinstance(value, float | np.floating):
            return float(f"{float(value):.{DIGITS}g}") if math.isfinite(value) else None
        return value

    return json.dumps({key: short(value) for key, value in values.items()}) if values else ""
