"""Run studies of hidden effects, and sum them up.

    python -m benchmarks.hidden_effects run --kind one --studies 200 --first-seed 0 -o results.parquet
    python -m benchmarks.hidden_effects report results.parquet --plot confusions.png

A results file grows by one row per study; the same command goes on where an earlier one stopped.  Seeds below
10,000 are for development; a published figure needs seeds that nothing was mended with.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # studies run beside one another

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import polars as pl

from benchmarks.hidden_effects import cases, report, study, vehicles
from benchmarks.hidden_effects.scoring import score
from benchmarks.imperfect_base.work import Results, add_workers, done, together

KEY = ("kind", "seed", "source", "seconds")


def run(chosen: argparse.Namespace) -> None:
    """Run what is not in the results file yet."""
    results = Results(chosen.out, study.SCHEMA)
    known = set(results.table.select(KEY).rows())
    wanted = range(chosen.first_seed, chosen.first_seed + chosen.studies)
    folder = chosen.folder or chosen.out.parent
    drawn = (cases.draw(kind, seed, chosen.source) for kind in chosen.kind for seed in wanted)
    tasks = [
        (case, chosen.seconds, folder, not chosen.no_oracle, chosen.least)
        for case in drawn
        if (case.kind, case.seed, case.source, chosen.seconds) not in known
        if chosen.only is None or chosen.only in case.title
    ]
    for name in sorted({case.preset for case, *_ in tasks if case.source == "teacher"}):
        vehicles.of_teacher(name, folder)  # before the workers begin, so that only one of them makes it
    for number, row in enumerate(done(study.run, tasks, chosen), 1):
        results.add(row)
        print(f"{number}/{len(tasks)} {line(row)}", flush=True)


def line(row: dict[str, Any]) -> str:
    """A study in one line, for whoever watches."""
    where = f"{row['preset']} {row['source']} x{row['noise']:g}"
    head = f"{row['kind']} {row['seed']} {where}: {row['title'] or '-'}"
    if row["failure"]:
        return f"{head} FAILED {row['failure']}"
    said = [
        f"{verdict} {'/'.join(dict.fromkeys([effect, *members]))}".strip()
        for verdict, effect, members in zip(row["verdicts"], row["effects"], row["members"], strict=True)
    ]
    errors = " ".join(
        f"{name} {row[name]:.3g}" for name in ("before", "after", "oracle", "floor") if row[name] is not None
    )
    time = f"{row['wall']:.0f} s, cpu {row['cpu']:.0f} s"
    return f"{head} ({row['share']:.1%}) -> {'; '.join(said)} | {errors} | {time}"


def read(paths: Iterable[Path]) -> pl.DataFrame:
    """Results of several files as one table."""
    return together(map(pl.read_parquet, paths)).unique(KEY, keep="last", maintain_order=True)


def parser() -> argparse.ArgumentParser:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.hidden_effects", description=about)
    commands = top.add_subparsers(required=True)
    one = commands.add_parser("run", help="run studies")
    one.add_argument(
        "--kind", action="append", choices=cases.KINDS, help="repeat for several; all by default"
    )
    one.add_argument("--studies", type=int, default=25, help="per kind")
    one.add_argument("--first-seed", type=int, default=0)
    one.add_argument("--seconds", type=float, default=300.0, help="to diagnose, in four sessions")
    one.add_argument("--only", help="only studies whose hidden effects' names contain this")
    one.add_argument("--source", choices=list(cases.SOURCES), help="fly all cases in this simulator")
    one.add_argument("--least", type=float, default=0.0, help="share that each hidden effect is to make")
    add_workers(one)
    one.add_argument("--no-oracle", action="store_true", help="do not fit the true effects")
    one.add_argument(
        "--folder", type=Path, help="of the teacher's base models; by default beside the results"
    )
    one.add_argument("-o", "--out", type=Path, default=Path("hidden_effects.parquet"))
    one.set_defaults(action=run)
    two = commands.add_parser("report", help="sum up results, as Markdown")
    two.add_argument("results", type=Path, nargs="+")
    two.add_argument("--plot", type=Path, help="draw the confusion matrix, as .png or .svg")
    two.set_defaults(action=lambda chosen: show(read(chosen.results), chosen.plot))
    return top


def show(table: pl.DataFrame, plot: Path | None) -> None:
    """Print the summary, and draw the confusion matrix where wanted."""
    print(report.summary(table), end="")
    if plot is not None:
        from benchmarks.hidden_effects.figure import confusions

        confusions([score(row) for row in table.to_dicts() if not row["failure"]], plot)


def main() -> None:
    chosen = parser().parse_args()
    if getattr(chosen, "kind", True) is None:
        chosen.kind = list(cases.KINDS)
    chosen.action(chosen)


if __name__ == "__main__":
    main()
