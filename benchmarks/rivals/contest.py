"""Studies as seen by a rival method, evaluation of its answer, and its results file.

A rival gets the vehicle file and the log.  It returns a model, and the name of one effect or none.  Every
name counts as a statement, as if its confidence were high.  The error is that of predictions 5 s ahead on the
held-out session.
"""

from __future__ import annotations

import argparse
import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.hidden_effects import cases, vehicles
from benchmarks.hidden_effects.study import Flown, shares
from benchmarks.imperfect_base import base, changes
from benchmarks.imperfect_base import study as on_base
from benchmarks.imperfect_logs import study as on_logs
from benchmarks.shares import rate
from benchmarks.work import Results, add_workers, done
from hydro.core.evaluation.replay_error import AHEAD, Ahead
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import corrected_first, predict, prepare
from hydro.core.recording.arrays import Recording
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import body_states

BASE = "imperfect base"
CONDITIONS = (BASE, *on_logs.CONDITIONS)
SCHEMA: dict[str, Any] = {
    "rival": pl.String,
    "condition": pl.String,
    "kind": pl.String,
    "seed": pl.Int64,
    "seconds": pl.Float64,
    "preset": pl.String,
    "title": pl.String,
    "called": pl.List(pl.String),
    "misjudged": pl.List(pl.String),
    "share": pl.Float64,
    "named": pl.String,
    "before": pl.Float64,
    "after": pl.Float64,
    "floor": pl.Float64,
    "cpu": pl.Float64,
    "failure": pl.String,
}
KEY = ("rival", "condition", "kind", "seed", "seconds")


@dataclass(frozen=True)
class Held:
    """Held-out recording of N rows, with the starts of S predictions.

    Attributes:
        record: The recording; a prediction uses its commands.
        eta: Smoothed pose, (N, 6); used in the rows of `starts` only.
        nu: Smoothed velocity, (N, 6); used in the rows of `starts` only.
        starts: First rows of predictions, (S,).
        raw: Raw table of the recording; a prediction uses its commands.
    """

    record: Recording
    eta: np.ndarray
    nu: np.ndarray
    starts: np.ndarray
    raw: pl.DataFrame

    @classmethod
    def of(cls, errors: Ahead, raw: pl.DataFrame) -> Held:
        """Return consecutive predictions over a held-out session."""
        return cls(errors.record, errors.motion.eta, errors.motion.nu, ahead(errors), raw)

    @property
    def length(self) -> int:
        """Return the number of rows of a prediction, L."""
        return round(AHEAD / self.record.dt) + 1


@dataclass(frozen=True)
class Answer:
    """Answer of a rival.

    Attributes:
        name: The named effect; empty if none.
        error: Function from the held-out session and its raw table to the root mean square velocity error 5 s
            ahead.
        predict: Function from a held-out recording to the velocities of its S predictions of L rows, (S, L,
            6).
    """

    name: str
    error: Callable[[Ahead, pl.DataFrame], float]
    predict: Callable[[Held], np.ndarray]


Rival = Callable[[Vehicle, pl.DataFrame], Answer]


def answer_of(module: str) -> Rival:
    """Return the method of a module of `benchmarks.rivals`.

    Raises:
        ImportError: A package that the module needs is not installed.
    """
    found: Rival = importlib.import_module(f"benchmarks.rivals.{module}").answer
    return found


def ahead(errors: Ahead) -> np.ndarray:
    """Return the first rows of consecutive predictions over the held-out session, as in `Ahead`."""
    length = round(AHEAD / errors.record.dt) + 1
    parts = [np.arange(a, b - length + 1, length) for a, b in errors.record.segments]
    return np.concatenate(parts)


def by_vehicle(vehicle: Vehicle, held: Held) -> np.ndarray:
    """Return the velocities (S, L, 6) that a vehicle file predicts; NaN where its motion diverges."""
    record, rows = held.record, held.starts[:, None] + np.arange(held.length)
    segment = np.searchsorted(record.segments[:, 1], held.starts, side="right")
    first = body_states(held.eta, held.nu)[held.starts]
    logged = body_states(record.eta, record.nu)[rows]
    shots = Shots(
        *(record, held.starts, segment, held.length, 0, first, logged, np.ones(CHANNELS), held.eta, held.nu)
    )
    model = candidate(vehicle)
    shots = corrected_first(shots, model)
    return np.asarray(predict(prepare(model, shots), shots)[..., 7:])


def weighed(errors: Ahead, starts: np.ndarray, predicted: np.ndarray) -> float:
    """Return the root mean square error of predicted velocities (S, L, 6), weighted as in `Ahead.of`.

    A prediction that diverged counts with the largest possible error.
    """
    rows = starts[:, None] + np.arange(predicted.shape[1])
    off = np.clip(np.nan_to_num(errors.record.nu[rows] - predicted, nan=np.inf), -100.0, 100.0)
    assert errors.weight is not None  # set by the first vehicle
    return float(np.sqrt((off**2).mean(axis=(0, 1)) @ errors.weight))


def recorded(
    condition: str, kind: str, seed: int, seconds: float, folder: Path
) -> tuple[cases.Case, Flown, set[str]]:
    """Return a study's case, recordings, and all effects that may be named in it."""
    if condition == BASE:
        case = changes.draw("changed" if kind == "one" else "nothing", seed)
        known = base.of(case.preset, seed, base.UNCHANGED, folder / "bases")
        case, _, _ = on_base.standing_out(case, known, seconds)
        case, flown, _ = on_base.changed(case, known, seconds)
        return case, flown, set(case.called)
    case, flown = on_logs.logged(cases.draw(kind, seed, "independent"), condition, seconds)
    return case, flown, {*case.called, *([on_logs.ALSO[condition]] if condition in on_logs.ALSO else [])}


def run(
    name: str, rival: Rival, condition: str, kind: str, seed: int, seconds: float, folder: Path
) -> dict[str, Any]:
    """Return the row of one study; errors are in `failure`."""
    row: dict[str, Any] = dict.fromkeys(SCHEMA) | {
        **{"rival": name, "condition": condition, "kind": kind, "seed": seed, "seconds": seconds},
        "failure": "",
    }
    try:
        case, flown, called = recorded(condition, kind, seed, seconds, folder)
        row |= {"preset": case.preset, "title": case.title, "called": sorted(called)}
        row["misjudged"] = [] if condition == BASE else vehicles.damping_of(flown.given)
        errors = Ahead(flown.held_out, flown.exact)
        row["before"], row["floor"] = errors.of(flown.given), errors.floor
        row["share"] = shares(case, flown, errors, row["before"])[0]
        cpu = time.process_time()
        answer = rival(flown.given, flown.measured)
        row |= {"cpu": time.process_time() - cpu, "named": answer.name}
        row["after"] = answer.error(errors, flown.held_out)
    except Exception as error:  # a failed study is a result; the others continue
        row["failure"] = f"{type(error).__name__}: {error}"
    return row


def summary(results: pl.DataFrame) -> str:
    """Return how often each rival names a hidden effect, and its false alarms, as Markdown."""
    head = ("rival", "studies", "named first", "nothing named", "alarm", "error after / before", "cpu, s")
    lines = [f"| {' | '.join(head)} |", "|---|---|---:|---:|---:|---:|---:|"]
    for (rival, condition), part in results.group_by("rival", "condition", maintain_order=True):
        rows = [row for row in part.to_dicts() if not row["failure"]]
        hidden = [row for row in rows if row["kind"] == "one" and row["share"] >= on_base.SHARE]
        nothing = [row for row in rows if row["kind"] == "none"]
        ratio = np.median([row["after"] / row["before"] for row in rows]) if rows else np.nan
        cpu = np.median([row["cpu"] for row in rows]) if rows else np.nan
        told = (
            rate(row["named"] in row["called"] for row in hidden),
            rate(not row["named"] for row in hidden),
            rate(row["named"] not in ("", *row["called"], *row["misjudged"]) for row in nothing),
        )
        lines.append(f"| {rival} | {condition} | {' | '.join(told)} | {ratio:.2f} | {cpu:.0f} |")
    failed = results.filter(pl.col("failure") != "")
    return "\n".join(lines) + f"\n\nFailed: {failed.height} of {results.height}.\n"


def main(name: str, rival: Rival, about: str) -> None:
    """Run a rival's studies that are not in the results file yet, and sum up the file."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--condition", action="append", choices=CONDITIONS, help="by default the base alone")
    parser.add_argument("--kind", action="append", choices=("one", "none"), help="both by default")
    parser.add_argument("--studies", type=int, default=30, help="per kind")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=300.0)
    add_workers(parser)
    parser.add_argument("-o", "--out", type=Path, default=Path("rivals.parquet"))
    chosen = parser.parse_args()
    results = Results(chosen.out, SCHEMA)
    known = set(results.table.select(KEY).rows())
    keys = [
        (name, condition, kind, seed, chosen.seconds)
        for condition in chosen.condition or [BASE]
        for kind in chosen.kind or ("one", "none")
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.studies)
    ]
    tasks = [(name, rival, *key[1:], chosen.out.parent) for key in keys if key not in known]
    for number, row in enumerate(done(run, tasks, chosen), 1):
        results.add(row)
        said = row["failure"] or (
            f"-> {row['named'] or '-'} | before {row['before']:.3g} after {row['after']:.3g}, "
            f"cpu {row['cpu']:.0f} s"
        )
        head = f"{row['condition']} {row['kind']} {row['seed']} {row['preset']}: {row['title'] or '-'}"
        print(f"{number}/{len(tasks)} {head} {said}", flush=True)
    print(summary(results.table), end="")
