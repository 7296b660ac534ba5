"""Test of `--discover` on laws outside the catalogue, in the benchmarks' own simulator.

Each study flies a vehicle of `datasets/vehicles` with one law that its file lacks, and damping with an error
of up to a quarter.  It is diagnosed with `--discover`.  The laws are:

* a power of a velocity, 1.3 to 3, that acts along its axis and off CO;
* a power of a velocity on another axis;
* a product of two velocities;
* drag that a power of another speed raises;
* a force with a threshold speed.

Some studies have no hidden law.  The discovered terms are compared with the file, with the catalogue's
effects alone, and with the fitted true law.

    python -m benchmarks.discovery run --studies 60 --first-seed 0 -o discovery.parquet
    python -m benchmarks.discovery report discovery.parquet

A results file grows by one row per study; the same command continues an earlier run.  Seeds below 10,000 are
for development, those from 70,000 for published figures.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # studies run in parallel

import argparse
from pathlib import Path

import polars as pl

from benchmarks.discovery.laws import KINDS
from benchmarks.discovery.study import SCHEMA, study
from benchmarks.shares import rate
from benchmarks.work import Results, add_report, add_workers, done

SEEN = 1.2
"""Minimum reduced chi-square of the file's effects for a detectable law."""


def run(chosen: argparse.Namespace) -> None:
    """Run the studies that the results file lacks."""
    results = Results(chosen.out, SCHEMA)
    known = set(results.table.select("seed", pl.col("kind") == "none").rows())
    wanted = [
        (kind, seed, chosen.seconds)
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.studies)
        for kind in chosen.kind or ("law", "none")
        if (seed, kind == "none") not in known
    ]
    for number, row in enumerate(done(study, wanted, chosen), 1):
        results.add(row)
        words = row["failure"] or f"form {row['form']}, {row['terms']}"
        names = ("before", "catalogue", "after", "oracle", "floor")
        errors = ", ".join(f"{name} {row[name]:.3g}" for name in names if row[name])
        head = f"{number}/{len(wanted)} {row['kind']} {row['seed']} {row['preset']} {row['truth']}"
        print(f"{head} -> {words} | {errors}", flush=True)


def summary(rows: pl.DataFrame) -> str:
    """Return figures by kind of law, and for studies without a hidden law, as text."""
    lines = [
        "| law | seen | form right | error at most 1.3 of the true law's | by the catalogue alone | cpu, s |"
    ]
    lines.append("|---|---:|---:|---:|---:|---:|")
    rows = rows.filter(failure="")
    hidden, near = rows.filter(pl.col("kind") != "none"), 1.3 * pl.col("oracle")
    for name, part in (("all", hidden), *((kind, hidden.filter(kind=kind)) for kind in KINDS)):
        seen = part.filter(pl.col("chi2_own") > SEEN)
        close = seen.select(pl.col("after", "catalogue") <= near)
        lines.append(
            f"| {name} | {seen.height} of {part.height} | {rate(seen['form'])} | {rate(close['after'])} | "
            f"{rate(close['catalogue'])} | {seen['cpu'].median() or 0:.0f} |"
        )
    nothing = rows.filter(kind="none")
    lines.append(f"| nothing hidden: discovered | | {rate(nothing['discovered'])} | | | |")
    return "\n".join(lines) + "\n"


def main() -> None:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.discovery", description=about)
    commands = top.add_subparsers(required=True)
    one = commands.add_parser("run", help="run studies")
    one.add_argument("--kind", action="append", choices=("law", "none"), help="both by default")
    one.add_argument("--studies", type=int, default=60, help="per kind")
    one.add_argument("--first-seed", type=int, default=0)
    one.add_argument("--seconds", type=float, default=240.0, help="to diagnose, in four sessions")
    add_workers(one)
    one.add_argument("-o", "--out", type=Path, default=Path("discovery.parquet"))
    one.set_defaults(action=run)
    add_report(commands, summary, ("kind", "seed", "seconds"))
    chosen = top.parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
