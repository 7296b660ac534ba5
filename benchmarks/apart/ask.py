"""Ask `hydro diagnose` about cases, as a user asks it, and keep what it says as rows."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from benchmarks.apart.cases import CASES
from benchmarks.apart.make import TOO_LONG, hydro, record

KEY = ("seed", "name", "with_before")
SCHEMA: dict[str, Any] = {
    "seed": pl.Int64,
    "name": pl.String,
    "kind": pl.String,
    "vehicle": pl.String,
    "fitted": pl.Boolean,
    "with_before": pl.Boolean,
    "share": pl.Float64,
    "truth": pl.String,
    "verdicts": pl.List(pl.String),
    "effects": pl.List(pl.String),
    "members": pl.List(pl.List(pl.String)),
    "confidences": pl.List(pl.Float64),
    "found_shares": pl.List(pl.Float64),
    "parameters": pl.List(pl.String),
    "chi2_given": pl.Float64,
    "chi2_end": pl.Float64,
    "wall": pl.Float64,
    "failure": pl.String,
}
"""Columns of a results file.

`kind` is what is changed, `share` what it makes of the squared 5 s error of the file and `truth` its
numbers, as JSON; findings follow in the order of the diagnosis, those that were not excited left out,
`parameters` as JSON; `chi2_given` and `chi2_end` are mean squared residuals (1: noise alone) of the file
and of what is found; `wall` is the time of the command [s].
"""


def cases(folder: Path, only: Sequence[str] = ()) -> list[dict[str, Any]]:
    """What is true of each case in a folder that is whole, in their order, or of those of `only`."""
    records = (record(folder / case.name) for case in CASES if not only or case.name in only)
    return [each for each in records if each is not None]


def ask(folder: Path, told: Mapping[str, Any], with_before: bool) -> dict[str, Any]:
    """The row of one case; what went wrong stands under `failure`.

    Args:
        folder: Of the case.
        told: What is true of it.
        with_before: Give the recording before the change.
    """
    row: dict[str, Any] = dict.fromkeys(SCHEMA)
    row |= {key: told[key] for key in ("seed", "name", "kind", "vehicle", "fitted")}
    row |= {"with_before": with_before, "share": told["share5"], "truth": json.dumps(told["truth"])}
    before = ("--before", folder / "before.parquet") if with_before else ()
    begun = time.perf_counter()
    try:
        got = hydro("diagnose", folder / "vehicle.toml", folder / "after.parquet", *before, "--json")
        row["failure"] = got.stderr.strip()[-300:] or f"exit {got.returncode}" if got.returncode else ""
        if not got.returncode:
            row |= answer(json.loads(got.stdout))
    except subprocess.TimeoutExpired:
        row["failure"] = f"longer than {TOO_LONG:g} s"
    except (ValueError, KeyError) as error:  # a case that fails is a result, and must not end the others
        row["failure"] = f"{type(error).__name__}: {error}"
    row["wall"] = time.perf_counter() - begun
    return row


def answer(said: dict[str, Any]) -> dict[str, Any]:
    """What a diagnosis says as JSON, as columns."""
    told = [one for one in said["findings"] if one["verdict"] != "not_excited"]
    chi2 = said.get("chi2") or {}
    return {
        "verdicts": [one["verdict"] for one in told],
        "effects": [one["effect"] for one in told],
        "members": [one["members"] for one in told],
        "confidences": [one["confidence"] for one in told],
        "found_shares": [one["share_of_error_explained"] for one in told],
        "parameters": [json.dumps(one["parameters"]) for one in told],
        "chi2_given": chi2.get("given"),
        "chi2_end": chi2.get("found"),
    }
