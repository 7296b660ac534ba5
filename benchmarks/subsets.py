"""Test of `hydro fit` with missing or slow sensors.

Each trial flies a vehicle of `datasets/vehicles` in the benchmark's own simulator with ordinary noise, and
keeps the samples of some of its sensors.  Damping and added mass are fitted from initial values with an error
of 20 %.  Values that the fit calls determined should lie within three standard errors of the truth. The list
`sparse` of `benchmarks.judge` diagnoses flights with asynchronous sensors.

    python -m benchmarks.subsets run --trials 3 -o subsets.parquet
    python -m benchmarks.subsets report subsets.parquet

Results files grow by one row per trial; the same command continues an earlier run.  Seeds below 10,000 are
for development, those from 70,000 for published figures.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl

from benchmarks.hidden_effects import flights
from benchmarks.hidden_effects.vehicles import PRESETS, damping_of, preset
from benchmarks.recovery import interval, true_values
from benchmarks.work import Results, add_workers, done
from hydro.core.columns import POSE, VELOCITY
from hydro.core.identification.fit import fit
from hydro.core.identification.outcome import Fit
from hydro.core.vehicle.description import Vehicle

POSITION, ANGLES, DVL, RATES = ("x", "y", "z"), ("phi", "theta", "psi"), ("u", "v", "w"), ("p", "q", "r")
COMPLETE, ASYNCHRONOUS = "complete, 50 Hz", "asynchronous, 5, 10 and 50 Hz"
Every = Mapping[str, tuple[int, int]]
SUBSETS: dict[str, Every] = {
    COMPLETE: dict.fromkeys((*POSE, *VELOCITY), (1, 0)),
    "position": dict.fromkeys(POSITION, (1, 0)),
    "attitude and depth": dict.fromkeys(("z", *ANGLES), (1, 0)),
    "DVL, attitude and depth": dict.fromkeys(("z", *ANGLES, *DVL), (1, 0)),
    ASYNCHRONOUS: {
        **dict.fromkeys(DVL, (10, 3)),
        **dict.fromkeys(ANGLES, (5, 1)),
        **dict.fromkeys(RATES, (1, 0)),
        **dict.fromkeys(POSITION, (10, 8)),
    },
}
"""Sampling of each column with samples: step and first row.  Other columns have no samples."""
WRONG = 0.2
SESSIONS = 3
DEPTH = 8.0

SCHEMA: dict[str, Any] = {
    **{"seed": pl.Int64, "preset": pl.String, "subset": pl.String, "seconds": pl.Float64},
    **{"names": pl.List(pl.String), "determined": pl.List(pl.Boolean)},
    **{name: pl.List(pl.Float64) for name in ("truth", "start", "values", "errors")},
    **{"chi2": pl.Float64, "cpu": pl.Float64, "failure": pl.String},
}


def sampled(raw: pl.DataFrame, every: Every) -> pl.DataFrame:
    """Return the table with the samples of slower sensors, and null elsewhere.

    Args:
        raw: Raw table.
        every: By column, the number of rows between samples, and the row of the first sample.
    """
    row = pl.int_range(pl.len())
    columns = []
    for name in (*POSE, *VELOCITY):
        count, at = every.get(name, (1, 1))
        columns.append(pl.when(row % count == at).then(pl.col(name)).alias(name))
    return raw.with_columns(columns)


def misjudged(vehicle: Vehicle, names: Iterable[str], rng: np.random.Generator) -> Vehicle:
    """Return the vehicle with every number of the named effects 20 % too large or too small."""

    def wrong(value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [wrong(inner) for inner in value]
        return value * (1.0 + WRONG * rng.choice([-1.0, 1.0]))

    chosen = set(names)
    tables = [
        {k: v if k == "name" else wrong(v) for k, v in table.items()} if table["name"] in chosen else table
        for table in vehicle.effect
    ]
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def fitted(vehicle: Vehicle) -> list[str]:
    """Return the fitted effects of a trial: damping, and added mass if it is a diagonal."""
    diagonal = [t["name"] for t in vehicle.effect if t["name"] == "added_mass" and "diagonal" in t]
    return [*damping_of(vehicle), *diagonal]


def flown(vehicle: Vehicle, seconds: float, seed: int) -> pl.DataFrame:
    """Return a complete flight in sessions, with ordinary noise."""
    rows = [round(seconds / SESSIONS / flights.DT)] * SESSIONS
    return pl.concat(
        flights.independent(vehicle, vehicle, (), {}, rows=rows, depth=DEPTH, noise=1.0, seed=seed)
    )


def trial(seed: int, name: str, subset: str, seconds: float) -> dict[str, Any]:
    """Return the row of one trial; errors are in `failure`."""
    row: dict[str, Any] = dict.fromkeys(SCHEMA) | {"seed": seed, "preset": name, "subset": subset}
    row |= {"seconds": seconds, "failure": ""}
    clock = time.process_time()
    try:
        truth = preset(name)
        names = fitted(truth)
        start = misjudged(truth, names, np.random.default_rng([seed, zlib.crc32(name.encode())]))
        found = fit(start, sampled(flown(truth, seconds, seed), SUBSETS[subset]), names)
        row |= _numbers(found, truth, start)
    except Exception as error:  # a trial that fails is a result, and must not end the others
        row["failure"] = f"{type(error).__name__}: {error}"
    return row | {"cpu": time.process_time() - clock}


def _numbers(found: Fit, truth: Vehicle, start: Vehicle) -> dict[str, Any]:
    return {
        "names": [entry.name for entry in found.free.entries],
        "determined": found.determined.tolist(),
        "truth": true_values(truth, found.free).tolist(),
        "start": true_values(start, found.free).tolist(),
        "values": found.values.tolist(),
        "errors": found.standard_errors.tolist(),
        "chi2": found.chi2,
    }


def run(chosen: argparse.Namespace) -> None:
    """Run the trials that are not in the results file yet."""
    results = Results(chosen.out, SCHEMA)
    known = set(results.table.select("seed", "preset", "subset", "seconds").rows())
    wanted = [
        (seed, name, subset, chosen.seconds)
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.trials)
        for name in chosen.preset or PRESETS
        for subset in chosen.subset or SUBSETS
    ]
    tasks = [key for key in wanted if key not in known]
    for number, row in enumerate(done(trial, tasks, chosen), 1):
        results.add(row)
        print(f"{number}/{len(tasks)} {line(row)}", flush=True)


def line(row: Mapping[str, Any]) -> str:
    """Describe a trial in one line."""
    head = f"{row['seed']} {row['preset']}, {row['subset']}:"
    if row["failure"]:
        return f"{head} FAILED {row['failure']}"
    z, sure = off(row), np.array(row["determined"])
    wrong = zip(row["names"], z, sure & (np.abs(z) > 3.0), strict=True)
    apart = ", ".join(f"{name} {error:+.1f}" for name, error, listed in wrong if listed)
    return (
        f"{head} {(np.abs(z[sure]) <= 3).sum()} of {sure.sum()} right of {len(z)}, chi2 {row['chi2']:.3g}, "
        f"{row['cpu']:.0f} s {apart}"
    )


def off(row: Mapping[str, Any]) -> np.ndarray:
    """Return the deviation of each value from the truth in standard errors."""
    return (np.array(row["values"]) - np.array(row["truth"])) / np.array(row["errors"])


def summary(results: pl.DataFrame) -> Iterator[dict[str, str]]:
    """Yield a line for each subset: share of determined values, share of correct ones, and accuracy."""
    complete = results.filter(subset=COMPLETE, failure="").to_dicts()
    whole = {(row["seed"], row["preset"]): row for row in complete}
    for subset in SUBSETS:
        rows = results.filter(subset=subset).to_dicts()
        fine = [row for row in rows if not row["failure"]]
        if not fine:
            continue
        z = np.concatenate([off(row) for row in fine])
        sure = np.concatenate([row["determined"] for row in fine]).astype(bool)
        ratios = [
            np.array(row["errors"]) / np.array(whole[row["seed"], row["preset"]]["errors"])
            for row in fine
            if (row["seed"], row["preset"]) in whole
        ]
        right = int((np.abs(z[sure]) <= 3.0).sum())
        yield {
            "samples of": subset,
            "trials": str(len(rows)),
            "fitted": str(len(fine)),
            "numbers determined": f"{sure.sum()} of {len(sure)}",
            "of these within 3 s.e.": f"{right} of {sure.sum()}",
            "share (95 % interval)": " ".join(interval(right, max(int(sure.sum()), 1)).split()),
            "median s.e. over complete": f"{np.median(np.concatenate(ratios)):.2f}" if ratios else "",
            "mean squared residual": f"{np.median([row['chi2'] for row in fine]):.2f}",
            "processor time [s]": f"{np.median([row['cpu'] for row in fine]):.0f}",
        }


def report(chosen: argparse.Namespace) -> None:
    """Write the sums as CSV to standard output."""
    lines = list(summary(pl.concat([pl.read_parquet(path) for path in chosen.results])))
    writer = csv.DictWriter(sys.stdout, list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)


def parser() -> argparse.ArgumentParser:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.subsets", description=about)
    commands = top.add_subparsers(required=True)
    one = commands.add_parser("run", help="fit flights with samples of some sensors")
    one.add_argument("--preset", action="append", choices=PRESETS, help="all by default")
    one.add_argument("--subset", action="append", choices=list(SUBSETS), help="all by default")
    one.add_argument("--trials", type=int, default=3, help="seeds")
    one.add_argument("--first-seed", type=int, default=0)
    one.add_argument("--seconds", type=float, default=150.0)
    add_workers(one)
    one.add_argument("-o", "--out", type=Path, default=Path("subsets.parquet"))
    one.set_defaults(action=run)
    two = commands.add_parser("report", help="sum up results, as CSV")
    two.add_argument("results", type=Path, nargs="+")
    two.set_defaults(action=report)
    return top


def main() -> None:
    chosen = parser().parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
