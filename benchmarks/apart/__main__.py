"""Make cases in a world apart, diagnose them, and sum up what is named.

    python -m benchmarks.apart make 1 cases/
    python -m benchmarks.apart run cases/
    python -m benchmarks.apart run cases/ --plain --only lag delay
    python -m benchmarks.apart report cases/results.parquet

Both `make` and `run` go on where an earlier one stopped: the first some twenty minutes a seed on one
core, the second about a minute a case.  Seed 1 is for development; others are held back for published
figures.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # threads of matrices this small only wait for one another

import argparse
from pathlib import Path
from typing import Any

from benchmarks.apart import ask, judgement, report
from benchmarks.apart.cases import CASES
from benchmarks.apart.make import make
from benchmarks.imperfect_base.work import Results, add_report


def run(chosen: argparse.Namespace) -> None:
    """Ask about what is not in the results file yet, one case at a time."""
    results = Results(chosen.out or chosen.folder / "results.parquet", ask.SCHEMA)
    known = set(results.table.select(ask.KEY).rows())
    cases = ask.cases(chosen.folder, chosen.only)
    cases = [case for case in cases if (case["seed"], case["name"], not chosen.plain) not in known]
    for number, case in enumerate(cases, 1):
        row = ask.ask(chosen.folder / case["name"], case, not chosen.plain)
        results.add(row)
        print(f"{number}/{len(cases)} {line(row)}", flush=True)


def line(row: dict[str, Any]) -> str:
    """A case in one line, for whoever watches."""
    return f"{report.line(judgement.judge(row))} ({row['wall']:.0f} s)"


def parser() -> argparse.ArgumentParser:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.apart", description=about)
    commands = top.add_subparsers(required=True)
    common = argparse.ArgumentParser(add_help=False)
    names = [case.name for case in CASES]
    common.add_argument("--only", nargs="+", default=[], choices=names, metavar="NAME", help="some cases")
    one = commands.add_parser("make", help="make the cases of a seed", parents=[common])
    one.add_argument("seed", type=int)
    one.add_argument("folder", type=Path, help="that gets a folder per case")
    one.set_defaults(action=lambda chosen: make(chosen.seed, chosen.folder, chosen.only))
    two = commands.add_parser("run", help="diagnose cases", parents=[common])
    two.add_argument("folder", type=Path, help="of the cases of one seed")
    two.add_argument("--plain", action="store_true", help="without the recording before")
    two.add_argument("-o", "--out", type=Path, help="results; by default results.parquet beside the cases")
    two.set_defaults(action=run)
    add_report(commands, report.summary, ask.KEY)
    return top


def main() -> None:
    chosen = parser().parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
