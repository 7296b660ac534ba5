"""Run studies of hidden effects with logs as they are at sea, and sum them up.

    python -m benchmarks.imperfect_logs run --studies 28 --first-seed 0 -o logs.parquet
    python -m benchmarks.imperfect_logs report logs.parquet

Each seed is one vehicle with one hidden effect, or none, and is diagnosed once under each condition.  A
results file grows by one row per study; the same command goes on where an earlier one stopped.  Seeds below
10,000 are for development, those from 70,000 are held back for published figures.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # studies run beside one another

import argparse
from pathlib import Path
from typing import Any

from benchmarks.imperfect_base.work import Results, add_report, add_workers, done, said
from benchmarks.imperfect_logs import report, study

KEY = ("kind", "seed", "condition", "seconds")


def run(chosen: argparse.Namespace) -> None:
    """Run what is not in the results file yet."""
    results = Results(chosen.out, study.SCHEMA)
    known = set(results.table.select(KEY).rows())
    wanted = [
        (kind, seed, condition, chosen.seconds)
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.studies)
        for kind in chosen.kind or study.KINDS
        for condition in chosen.condition or study.CONDITIONS
    ]
    tasks = [(*key, chosen.out.parent) for key in wanted if key not in known]
    for number, row in enumerate(done(study.run, tasks, chosen), 1):
        results.add(row)
        print(f"{number}/{len(tasks)} {line(row)}", flush=True)


def line(row: dict[str, Any]) -> str:
    """A study in one line, for whoever watches."""
    head = f"{row['kind']} {row['seed']} {row['preset']}, {row['condition']}: {row['title'] or '-'}"
    if row["failure"]:
        return f"{head} FAILED {row['failure']}"
    return f"{head} ({row['share']:.0%}) -> {said(row)}"


def parser() -> argparse.ArgumentParser:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.imperfect_logs", description=about)
    commands = top.add_subparsers(required=True)
    one = commands.add_parser("run", help="run studies")
    one.add_argument("--kind", action="append", choices=study.KINDS, help="both by default")
    one.add_argument("--condition", action="append", choices=study.CONDITIONS, help="all by default")
    one.add_argument("--studies", type=int, default=10, help="seeds per kind")
    one.add_argument("--first-seed", type=int, default=0)
    one.add_argument("--seconds", type=float, default=300.0, help="to diagnose, in four sessions")
    add_workers(one)
    one.add_argument("-o", "--out", type=Path, default=Path("imperfect_logs.parquet"))
    one.set_defaults(action=run)
    add_report(commands, report.summary, KEY)
    return top


def main() -> None:
    chosen = parser().parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
