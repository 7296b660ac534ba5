"""Detection rate and false alarm rate of the thruster audit.

Four vehicles run for two minutes each: BlueROV2s with six and with eight thrusters in the benchmark's own
simulator (`hidden_effects.plant`), and two panel hulls in the embedded simulator. The file of a panel hull is
the estimate of `hydro vehicle new`. The vehicles differ from the file by 30 % in the damping and by one
disturbance: a current, wrong ballast, a command delay, or a controller for station keeping or way-points.

A fault is a random subset of reversed thrusters (in the file, or in the log's columns), two swapped columns,
or a common scale of 0.6 to 1.4. An answer on directions is right if it states exactly the fault. A
common scale is right if no direction is stated and its 95 % interval contains the truth. An alarm is any
statement about a correct file. Seeds below 10,000 are for development, those from 200,000 for published
figures. A results file grows by one row per study; the same command continues an earlier one.

    python -m benchmarks.thruster_audit run --studies 200 --correct 300 --first-seed 200000 -o audit.parquet
    python -m benchmarks.thruster_audit report audit.parquet --keep COMMIT
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # studies run in parallel

import argparse
from pathlib import Path
from typing import Any

import polars as pl

from benchmarks import kept_tables
from benchmarks.shares import interval
from benchmarks.thruster_audit.study import DISTURBANCES, FAULTS, SCHEMA, VEHICLES, study
from benchmarks.work import Results, add_workers, done


def run(chosen: argparse.Namespace) -> None:
    """Run the studies that the results file lacks."""
    results = Results(chosen.out, SCHEMA)
    known = set(results.table.select("kind", "seed").rows())
    wanted = [
        (kind, seed)
        for kind, count in (("faulty", chosen.studies), ("correct", chosen.correct))
        for seed in range(chosen.first_seed, chosen.first_seed + count)
        if (kind, seed) not in known
    ]
    for number, row in enumerate(done(study, wanted, chosen), 1):
        results.add(row)
        mark = "right" if row["right"] else "WRONG"
        about = f"{row['kind']} {row['seed']} {row['vehicle']}, {row['disturbance']}"
        head = f"{number}/{len(wanted)} {mark} {about}"
        told = row["failure"] or (" | ".join(row["said"] or []) if chosen.lines or not row["right"] else "")
        print(f"{head}: {row['fault']} {row['truth']} -> {told} ({row['seconds'] or 0:.2f} s)", flush=True)


def rows_of(table: pl.DataFrame) -> list[dict[str, Any]]:
    """Return the kept table: share of right studies, by fault and by vehicle, and of alarms."""
    out = []

    def add(what: str, part: pl.DataFrame, hits: int) -> None:
        if part.height:
            low, high = interval(hits, part.height)
            out.append(
                {
                    "studies": what,
                    "count": f"{hits} of {part.height}",
                    "95 % interval": f"{100 * low:.1f} to {100 * high:.1f} %",
                    "longest audit [s]": f"{part['seconds'].max():.1f}",
                }
            )

    faulty, correct = table.filter(kind="faulty"), table.filter(kind="correct")
    add("all faults: right", faulty, int(faulty["right"].sum()))
    for fault in FAULTS:
        part = faulty.filter(fault=fault)
        add(f"{fault}: right", part, int(part["right"].sum()))
    for name in VEHICLES:
        part = faulty.filter(vehicle=name)
        add(f"{name}: right", part, int(part["right"].sum()))
    for name in DISTURBANCES:
        part = faulty.filter(disturbance=name)
        add(f"{name}: right", part, int(part["right"].sum()))
    add("correct files: alarms", correct, int((~correct["right"]).sum()))
    return out


def report(chosen: argparse.Namespace) -> None:
    """Print the kept table, and write it with --keep."""
    table = pl.concat([pl.read_parquet(path) for path in chosen.results]).unique(["kind", "seed"])
    rows = rows_of(table)
    print(kept_tables.markdown(rows))
    if chosen.keep:
        origin = kept_tables.origin(table, chosen.command, chosen.keep)
        kept_tables.keep("thruster_audit", [row | origin for row in rows])


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    top = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = top.add_subparsers(required=True)
    runs = commands.add_parser("run", help="run studies that are not in the results yet")
    runs.add_argument("--studies", type=int, default=200, help="with a fault")
    runs.add_argument("--correct", type=int, default=300, help="without one")
    runs.add_argument("--first-seed", type=int, default=0)
    runs.add_argument("--lines", action="store_true", help="print all that is said")
    runs.add_argument("-o", dest="out", type=Path, required=True)
    add_workers(runs)
    runs.set_defaults(action=run)
    reports = commands.add_parser("report", help="sum up results, as Markdown")
    reports.add_argument("results", type=Path, nargs="+")
    reports.add_argument("--keep", metavar="COMMIT", help="write benchmarks/results, with the code's commit")
    reports.add_argument("--command", default="python -m benchmarks.thruster_audit run -o audit.parquet")
    reports.set_defaults(action=report)
    return top


if __name__ == "__main__":
    given = parser().parse_args()
    given.action(given)
