"""Calibration of the screening test in a diagnosis: p-values of recordings without a missing effect.

Each seed draws one vehicle of `hidden_effects` without hidden effects and with a damping error of up to a
quarter, simulated once for each length.  The same run is recorded with white noise, and with Student-t(3)
noise of equal variance on every channel.  Each log is screened as in the first round of a diagnosis.  A group
is an effect of the catalogue in all its shapes, with a p-value of its own.  The overall p-value, used by a
diagnosis, is over all groups at once.

A results file grows by the rows of one log at a time; the same command continues an earlier run. Seeds below
10,000 are for development.  `write` makes benchmarks/results/null_p_values.csv.

    python -m benchmarks.null_p_values run --studies 60 --first-seed 90000 -o nulls.parquet
    # Report, and keep the table.
    python -m benchmarks.null_p_values report nulls.parquet
    python -m benchmarks.null_p_values write nulls.parquet --commit 1234567
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from scipy.stats import binomtest, kstest

from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects.flights import scaled
from benchmarks.hidden_effects.study import Flown, fly
from benchmarks.imperfect_logs.sensors import replaced
from benchmarks.kept_tables import Row, keep, markdown, origin
from benchmarks.shares import rate
from benchmarks.work import Results, add_workers, done
from hydro.core.columns import POSE, VELOCITY, Array
from hydro.core.diagnosis.baseline import refit, stable_start
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.model import Screening
from hydro.core.diagnosis.search import Search
from hydro.core.diagnosis.settings import ALPHA
from hydro.core.evaluation.score_test import FLIPS, p_values
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.vehicle.description import Vehicle

WHITE, HEAVY = "white", "t(3)"
NOISES = (WHITE, HEAVY)
LENGTHS = (120.0, 300.0)
KEY = ("seed", "seconds", "noise")

SCHEMA: dict[str, Any] = {
    **{"seed": pl.Int64, "preset": pl.String, "source": pl.String, "noise": pl.String, "seconds": pl.Float64},
    **{"group": pl.String, "columns": pl.Int64, "p_value": pl.Float64, "overall": pl.Float64},
    **{"shots": pl.Int64, "chi2": pl.Float64, "cpu": pl.Float64, "failure": pl.String},
}
"""Columns of a results file, a row per log and group.

`columns` are those of one shape of the group, and `shots` the pieces of the problem.  `chi2` is the reduced
chi-square with the file's effects, and `cpu` the processor time of the log [s].  A log that could not be
screened has one row with its `failure` and no group.
"""


def written(quiet: pl.DataFrame, noise: str, size: float, rng: np.random.Generator) -> pl.DataFrame:
    """Return a raw table of true motion with sensor noise of `size` times the ordinary level."""
    names = (*POSE, *VELOCITY)
    motion = quiet.select(names).to_numpy()
    # The variance of t(3) is 3.
    errors = (
        rng.standard_t(3, motion.shape) / np.sqrt(3.0) if noise == HEAVY else rng.normal(size=motion.shape)
    )
    return replaced(quiet, names, disturb(motion + errors * scaled(size).deviations, PROFILES["none"], rng))


def screened(vehicle: Vehicle, raw: pl.DataFrame) -> tuple[Screening, float]:
    """Return the first screening of a diagnosis, and the reduced chi-square before the screening."""
    log = preprocess(vehicle, raw)
    start, problem = stable_start(vehicle, log)
    baseline = refit(vehicle, log, problem, start)
    return Search(baseline).screen(baseline.refitted, []), baseline.refitted.normal.chi2


def run_one(seed: int, seconds: float, wanted: tuple[str, ...]) -> list[Row]:
    """Return the rows of one flight with each kind of noise; errors are in `failure`."""
    case = cases.draw("none", seed)
    same = {"seed": seed, "preset": case.preset, "source": case.source, "seconds": seconds, "failure": ""}
    rows: list[Row] = []
    flown: Flown | None = None
    for noise in wanted:
        begun, row = time.process_time(), dict.fromkeys(SCHEMA) | same | {"noise": noise}
        try:
            flown = flown or fly(replace(case, noise=0.0), seconds)
            rng = np.random.default_rng([seed, NOISES.index(noise), 31])
            screening, chi2 = screened(flown.given, written(flown.measured, noise, case.noise, rng))
            row |= {"overall": screening.p_value, "chi2": chi2, "shots": len(screening.evidence.error)}
            groups = list(_groups(screening))
        except Exception as error:  # a failed log is a result; the others continue
            groups = [{"failure": f"{type(error).__name__}: {error}"}]
        row["cpu"] = time.process_time() - begun
        rows += [row | group for group in groups]
    return rows


def _groups(screening: Screening) -> Iterator[Row]:
    """Yield the p-value of each group alone."""
    for name, shapes in screening.shapes.items():
        alone = p_values(screening.evidence, screening.own, {name: shapes})[name]
        yield {"group": name, "columns": len(shapes[0]), "p_value": alone}


def run(chosen: argparse.Namespace) -> None:
    """Run the flights that the results file lacks."""
    results = Results(chosen.out, SCHEMA)
    known = set(results.table.select(KEY).rows())
    tasks = []
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.studies):
        for seconds in chosen.seconds or LENGTHS:
            if wanted := tuple(noise for noise in NOISES if (seed, seconds, noise) not in known):
                tasks.append((seed, seconds, wanted))
    for number, rows in enumerate(done(run_one, tasks, chosen), 1):
        results.add(*rows)
        print(f"{number}/{len(tasks)} {line(rows)}", flush=True)


def line(rows: list[Row]) -> str:
    """Return the results of a flight in one line, for progress."""
    head = f"{rows[0]['seed']} {rows[0]['preset']} {rows[0]['source']}, {rows[0]['seconds']:g} s:"
    told = []
    for noise in dict.fromkeys(row["noise"] for row in rows):
        first = next(row for row in rows if row["noise"] == noise)
        said = first["failure"] or f"p {first['overall']:.4f}, chi2 {first['chi2']:.3f}"
        told.append(f"{noise} {said}, cpu {first['cpu']:.0f} s")
    return f"{head} {'; '.join(told)}"


def conditions(table: pl.DataFrame) -> Iterator[tuple[str, pl.DataFrame]]:
    """Yield the screened rows of each noise and length."""
    there = table.filter(pl.col("failure") == "").unique([*KEY, "group"], keep="last", maintain_order=True)
    for noise in NOISES:
        for seconds in sorted(set(there["seconds"])):
            part = there.filter(noise=noise, seconds=seconds)
            if part.height:
                yield f"{noise}, {seconds:g} s", part


def uniform(p: Array) -> float:
    """Return the Kolmogorov-Smirnov p-value of p-values (N,) against the uniform distribution.

    P-values of sign flips are multiples of a small step.  Half a step is subtracted, so that they are
    uniform at the centres of equal cells.
    """
    return float(kstest(np.asarray(p) - 0.5 / (FLIPS + 1), "uniform").pvalue)


def rare(p: Array) -> float:
    """Return the probability of at least as many p-values (N,) at or below ALPHA, if they were uniform."""
    return float(binomtest(int((p <= ALPHA).sum()), len(p), ALPHA, alternative="greater").pvalue)


def holm(p: Array) -> Array:
    """Adjust p-values (K,) for multiple testing by Holm's method (1979), (K,)."""
    order, count = np.argsort(p), len(p)
    adjusted = np.maximum.accumulate(np.asarray(p)[order] * (count - np.arange(count)))
    out = np.empty(count)
    out[order] = np.minimum(adjusted, 1.0)
    return out


def groups(part: pl.DataFrame) -> pl.DataFrame:
    """Return one row per group of a condition, farthest from uniform first.

    Returns:
        `group`, `logs`; `uniform` and `rare` (see these functions), and both adjusted over groups by `holm`;
        `at_alpha`, the number of p-values at or below ALPHA.
    """
    rows = []
    for (name,), those in part.group_by("group", maintain_order=True):
        p = those["p_value"].to_numpy()
        low = int((p <= ALPHA).sum())
        rows.append({"group": name, "logs": p.size, "uniform": uniform(p), "rare": rare(p), "at_alpha": low})
    found = pl.DataFrame(rows)
    adjusted = [pl.Series(f"{name}_adjusted", holm(found[name].to_numpy())) for name in ("uniform", "rare")]
    return found.with_columns(adjusted).sort("uniform")


def sums(table: pl.DataFrame) -> Iterator[Row]:
    """Yield one row per noise and length: results of the groups, and of the overall p-value."""
    for words, part in conditions(table):
        each, once = groups(part), part.unique(KEY)["overall"].to_numpy()
        worst, most = each.row(0, named=True), each.sort("rare").row(0, named=True)
        uneven = each.filter(pl.col("uniform_adjusted") <= 0.05)["group"].to_list()
        yield {
            "noise and length": words,
            "logs": once.size,
            "groups": each.height,
            "least KS p of a group, after Holm": f"{worst['uniform_adjusted']:.2g} ({worst['group']})",
            "groups at or below 0.05": ", ".join(uneven) or "none",
            "p <= 0.01, all groups": rate(part["p_value"] <= ALPHA),
            "most in one group": f"{rate_of(most)}, after Holm {most['rare_adjusted']:.2g}",
            "KS p of all at once": f"{uniform(once):.2g}",
            "all at once <= 0.01": rate(once <= ALPHA),
            "<= 0.05": rate(once <= 0.05),
        }


def rate_of(row: Row) -> str:
    """Return the number of p-values of a group at or below ALPHA, as text."""
    return f"{row['group']} {row['at_alpha']} of {row['logs']}"


def summary(table: pl.DataFrame) -> str:
    """Return the summary of a results table as Markdown."""
    told = [markdown(list(sums(table)))]
    for words, part in conditions(table):
        lines = [
            {
                **{"group": row["group"], "logs": row["logs"], "KS p": f"{row['uniform']:.3g}"},
                **{"after Holm": f"{row['uniform_adjusted']:.3g}"},
                **{"p <= 0.01": row["at_alpha"], "after Holm, of so many": f"{row['rare_adjusted']:.3g}"},
            }
            for row in groups(part).iter_rows(named=True)
        ]
        told += [f"### {words}", markdown(lines)]
    failed = table.filter(pl.col("failure") != "")
    told += [f"Failed: {row['seed']}, {row['noise']}: {row['failure']}" for row in failed.to_dicts()]
    return "\n\n".join(told) + "\n"


def write(table: pl.DataFrame, commit: str) -> None:
    """Write the kept sums, and regenerate the pages."""
    whence = origin(table, "python -m benchmarks.null_p_values run", commit)
    keep("null_p_values", [row | whence for row in sums(table)])


def main() -> None:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.null_p_values", description=about)
    commands = top.add_subparsers(required=True)
    one = commands.add_parser("run", help="screen logs")
    one.add_argument("--studies", type=int, default=60, help="seeds")
    one.add_argument("--first-seed", type=int, default=90_000)
    one.add_argument("--seconds", type=float, action="append", help="repeat for several; 120 and 300")
    add_workers(one)
    one.add_argument("-o", "--out", type=Path, default=Path("null_p_values.parquet"))
    one.set_defaults(action=run)
    two = commands.add_parser("report", help="sum up results, as Markdown")
    two.add_argument("results", type=Path)
    two.set_defaults(action=lambda chosen: print(summary(pl.read_parquet(chosen.results)), end=""))
    three = commands.add_parser("write", help="write the sums for the pages")
    three.add_argument("results", type=Path)
    three.add_argument("--commit", required=True, help="commit of the measured code")
    three.set_defaults(action=lambda chosen: write(pl.read_parquet(chosen.results), chosen.commit))
    chosen = top.parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
