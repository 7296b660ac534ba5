"""Run the scoreboard of the diagnosis, print it, and compare two results in pairs.

    python -m benchmarks.judge run -o now.parquet          # lists and sizes of the frozen table
    python -m benchmarks.judge run --list panel-before=200 --first-seed 200000 -o before.parquet
    python -m benchmarks.judge show now.parquet --base benchmarks/results/judge-7389b25.parquet
    python -m benchmarks.judge show now.parquet --rescore confidence.NEAR=0.9

`run` adds the studies that the results file lacks, so the same command goes on where it stopped.  `--base`
compares studies that both files have, in pairs.  `--rescore` repeats the decisions on the kept candidates
with other constants; it needs no new fits.  Seeds below 10,000 are for development;
benchmarks/judge/seeds.csv lists the ranges that published figures have used.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # studies run beside one another

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import polars as pl

from benchmarks.imperfect_base import base, changes
from benchmarks.imperfect_base.work import Results, add_workers, done, together
from benchmarks.judge import board, rescore
from benchmarks.judge.rows import KEY, SCHEMA
from benchmarks.judge.rows import run as run_study
from benchmarks.judge.scores import score
from benchmarks.judge.studies import LISTS

Task = tuple[str, int, float, Path]
"""List, seed, length of the recording [s] and folder of a study."""
FIRST_SEED = 180_000
"""First seed of the frozen table; seeds from here on are held back."""


def run(chosen: argparse.Namespace) -> None:
    """Run the studies that the results file lacks, then print the scoreboard."""
    results = Results(chosen.out, SCHEMA)
    known = set(results.table.select(KEY).unique().rows())
    folder = chosen.folder or chosen.out.parent / "judge"
    wanted = [
        (number / count, name, chosen.first_seed + number, chosen.seconds or LISTS[name].seconds, folder)
        for name, count in sizes(chosen.list).items()
        for number in range(count)
    ]
    wanted.sort(key=lambda one: one[0])  # all lists grow alike, so that a part of the run tells of all
    tasks: list[Task] = [task[1:] for task in wanted if task[1:4] not in known]
    make_bases(tasks, chosen)
    begun = time.monotonic()
    for number, rows in enumerate(done(run_study, tasks, chosen), 1):
        results.add(*rows)
        left = (time.monotonic() - begun) / number * (len(tasks) - number) / 60.0
        print(f"{number}/{len(tasks)}, {left:.0f} min left: {board.line(score(rows))}", flush=True)
    print(board.scoreboard(scored(results.table)))


def make_bases(tasks: Sequence[Task], chosen: argparse.Namespace) -> None:
    """Fit the files of panel hulls before the studies run, so that each is fitted once."""
    kinds = {"panel": "changed", "unchanged": "nothing"}
    drawn = [
        (changes.draw(kinds[name.split("-")[0]], seed).preset, seed // base.GROUP * base.GROUP, folder)
        for name, seed, _, folder in tasks
        if name.split("-")[0] in kinds
    ]
    fits = [(preset, seed, base.UNCHANGED, folder / "bases") for preset, seed, folder in sorted(set(drawn))]
    for one in done(base.of, fits, chosen):
        print(f"file {one.unchanged.stem}", flush=True)


def sizes(chosen: Sequence[str]) -> dict[str, int]:
    """Return the number of studies of each list; those of the frozen table by default.

    Raises:
        SystemExit: A list is unknown, or its number is none.
    """
    found = dict[str, int]()
    for one in chosen:
        name, _, count = one.partition("=")
        if name not in LISTS or not (count.isdigit() or not count):
            raise SystemExit(f"--list {one}: give NAME or NAME=COUNT; names are {', '.join(LISTS)}")
        found[name] = int(count) if count else LISTS[name].count
    return found or {name: one.count for name, one in LISTS.items()}


def scored(table: pl.DataFrame) -> list[board.Score]:
    """Return the score of each study in a results table, in its order."""
    return [score(part.to_dicts()) for _, part in table.group_by(KEY, maintain_order=True)]


def show(chosen: argparse.Namespace) -> None:
    """Print the scoreboard of results, re-scored or beside a base where asked for."""
    table = together(map(pl.read_parquet, chosen.results)).unique(maintain_order=True)
    now = scored(table)
    if chosen.rescore:
        settings = rescore.parsed(chosen.rescore)
        again, decided = rescore.rescored(table, settings), rescore.rescored(table, {})
        print(rescore.agreement(now, decided))
        print(board.paired(decided, again, "settings of the code", ", ".join(chosen.rescore)))
        return
    print(board.scoreboard(now))
    if chosen.base is not None:
        print(board.paired(scored(pl.read_parquet(chosen.base)), now, str(chosen.base), "these results"))


def parser() -> argparse.ArgumentParser:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.judge", description=about)
    commands = top.add_subparsers(required=True)
    lists = "; ".join(f"{name} ({one.count}): {one.about}" for name, one in LISTS.items())
    one = commands.add_parser("run", help="run studies and print the scoreboard", epilog=f"Lists: {lists}.")
    one.add_argument(
        "--list",
        action="append",
        default=[],
        metavar="NAME[=COUNT]",
        help="repeat for several; all by default",
    )
    one.add_argument("--first-seed", type=int, default=FIRST_SEED)
    one.add_argument("--seconds", type=float, help="length of a recording; each list has its own by default")
    one.add_argument("--folder", type=Path, help="of fitted files; by default `judge` beside the results")
    add_workers(one)
    one.add_argument("-o", "--out", type=Path, default=Path("judge.parquet"))
    one.set_defaults(action=run)
    two = commands.add_parser("show", help="print the scoreboard of results")
    two.add_argument("results", type=Path, nargs="+")
    two.add_argument("--base", type=Path, help="earlier results; print paired differences")
    two.add_argument(
        "--rescore",
        action="append",
        default=[],
        metavar="MODULE.CONSTANT=VALUE",
        help=f"decide again with another constant: {', '.join(rescore.CONSTANTS)}",
    )
    two.set_defaults(action=show)
    return top


def main() -> None:
    chosen = parser().parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
