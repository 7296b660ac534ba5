"""Run studies of changed vehicles whose hulls no formula describes, and sum them up.

    python -m benchmarks.imperfect_base run --studies 60 --first-seed 0 -o base.parquet
    python -m benchmarks.imperfect_base run --before -o base.parquet
    python -m benchmarks.imperfect_base report base.parquet
    python -m benchmarks.imperfect_base write --kind changed --first-seed 12 --folder bases -o study/

A results file grows by one row per study; the same command goes on where an earlier one stopped.  Seeds below
10,000 are for development, those from 70,000 are held back for published figures.  Fitted files and the
unchanged flights that they come from are kept in a folder beside the results.  `write` writes one study as
files, for `hydro diagnose` and other programs.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # studies run beside one another

import argparse
from pathlib import Path
from typing import Any

from benchmarks.imperfect_base import base, changes, report, study
from benchmarks.imperfect_base.work import Results, add_report, add_workers, done, said

KEY = ("kind", "seed", "seconds", "unchanged_seconds", "with_before")


def run(chosen: argparse.Namespace) -> None:
    """Run what is not in the results file yet."""
    folder = chosen.folder or chosen.out.parent / "bases"
    cases = [
        changes.draw(kind, seed)
        for kind in chosen.kind or changes.KINDS
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.studies)
    ]
    results = Results(chosen.out, study.SCHEMA)
    known = set(results.table.select(KEY).rows())
    how = (chosen.seconds, chosen.unchanged, chosen.before)
    cases = [case for case in cases if (case.kind, case.seed, *how) not in known]
    hulls = {(case.preset, case.seed // base.GROUP * base.GROUP) for case in cases}
    fits = [(preset, seed, chosen.unchanged, folder) for preset, seed in sorted(hulls)]
    for one in done(base.of, fits, chosen):  # before the studies, so that each is made once
        print(f"base {one.unchanged.stem}", flush=True)
    tasks = [
        (case, chosen.seconds, chosen.unchanged, folder, not chosen.no_oracle, chosen.before)
        for case in cases
    ]
    for number, row in enumerate(done(study.run, tasks, chosen), 1):
        results.add(row)
        print(f"{number}/{len(tasks)} {line(row)}", flush=True)


def line(row: dict[str, Any]) -> str:
    """A study in one line, for whoever watches."""
    head = f"{row['kind']} {row['seed']} {row['preset']}: {row['title'] or '-'}"
    if row["failure"]:
        return f"{head} FAILED {row['failure']}"
    stands = f"{row['base_error'] / row['base_floor']:.0f} x noise x{row['noise']:g}"
    return f"{head} ({row['share']:.0%}; base {row['base_error']:.3g} = {stands}) -> {said(row)}"


def write(chosen: argparse.Namespace) -> None:
    """Write one study as files."""
    case = changes.draw((chosen.kind or ["changed"])[0], chosen.first_seed)
    folder = chosen.folder or chosen.out / "bases"
    study.write(case, chosen.seconds, chosen.unchanged, folder, chosen.out)


def parser() -> argparse.ArgumentParser:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.imperfect_base", description=about)
    commands = top.add_subparsers(required=True)
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--kind", action="append", choices=changes.KINDS, help="all by default")
    common.add_argument("--first-seed", type=int, default=0)
    common.add_argument("--seconds", type=float, default=300.0, help="to diagnose, in four sessions")
    common.add_argument(
        "--unchanged",
        type=float,
        default=base.UNCHANGED,
        help="seconds that the file is fitted to, and with --before the recording before",
    )
    common.add_argument("--folder", type=Path, help="of fitted files; by default `bases` beside the results")
    one = commands.add_parser("run", help="run studies", parents=[common])
    one.add_argument("--studies", type=int, default=30, help="per kind")
    add_workers(one)
    one.add_argument("--no-oracle", action="store_true", help="do not fit the true change")
    one.add_argument(
        "--before", action="store_true", help="with the unchanged flights as the recording before"
    )
    one.add_argument("-o", "--out", type=Path, default=Path("imperfect_base.parquet"))
    one.set_defaults(action=run)
    add_report(commands, report.summary, KEY)
    three = commands.add_parser("write", help="write one study as files", parents=[common])
    three.add_argument("-o", "--out", type=Path, default=Path("study"))
    three.set_defaults(action=write)
    return top


def main() -> None:
    chosen = parser().parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
