"""Scoreboard of the diagnosis: run studies, print scores, and compare two results in pairs.

    python -m benchmarks.judge run -o now.parquet          # lists and sizes of the frozen table
    python -m benchmarks.judge run --list panel-before=200 --first-seed 200000 -o before.parquet
    python -m benchmarks.judge show now.parquet --base benchmarks/results/judge-7389b25.parquet
    python -m benchmarks.judge show now.parquet --rescore settings.RIGHT_ABOVE=0.9
    python -m benchmarks.judge write --list panel-before --seed 12 -o study/

`run` adds the studies missing in the results file, so the same command continues an earlier run.  `--base`
compares studies that both files have, in pairs.  `--rescore` repeats the decisions on the kept candidates
with other constants; it needs no new fits.  `--keep` writes the scoreboard as a kept table.  `write` writes
one study as files, for `hydro diagnose` and other programs.

Seeds below 10,000 are for development; benchmarks/judge/seeds.csv lists the ranges that published figures
have used.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # studies run in parallel

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.imperfect_base import base, changes
from benchmarks.judge import board, rescore, results, studies
from benchmarks.judge.rows import KEY, SCHEMA
from benchmarks.judge.rows import run as run_study
from benchmarks.judge.scores import score, scored
from benchmarks.judge.studies import LISTS
from benchmarks.kept_tables import keep, origin
from benchmarks.work import Results, add_workers, done

Task = tuple[str, int, float, Path]
"""Task: list, seed, length of the recording [s] and folder of a study."""
FIRST_SEED = 180_000
"""First seed of the frozen table; seeds from here on are held back."""


def run(chosen: argparse.Namespace) -> None:
    """Run the studies that the results file lacks, then print the scoreboard."""
    kept = Results(chosen.out, SCHEMA)
    known = set(kept.table.select(KEY).unique().rows())
    folder = chosen.folder or chosen.out.parent / "judge"
    wanted = [
        (number / count, name, chosen.first_seed + number, chosen.seconds or LISTS[name].seconds, folder)
        for name, count in sizes(chosen.list).items()
        for number in range(count)
    ]
    wanted.sort(key=lambda one: one[0])  # all lists grow at one rate: a partial run represents all
    tasks: list[Task] = [task[1:] for task in wanted if task[1:4] not in known]
    make_bases(tasks, chosen)
    begun = time.monotonic()
    for number, rows in enumerate(done(run_study, tasks, chosen), 1):
        kept.add(*rows)
        left = (time.monotonic() - begun) / number * (len(tasks) - number) / 60.0
        print(f"{number}/{len(tasks)}, {left:.0f} min left: {board.line(score(rows))}", flush=True)
    print(board.scoreboard(scored(kept.table)))


def make_bases(tasks: Sequence[Task], chosen: argparse.Namespace) -> None:
    """Fit the vehicle files of panel hulls before the studies run, so that each file is fitted once."""
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
        SystemExit: A list is unknown, its number is not a number, or it needs a number.
    """
    found = dict[str, int]()
    for one in chosen:
        name, _, count = one.partition("=")
        if name not in LISTS or not (count.isdigit() or not count):
            raise SystemExit(f"--list {one}: give NAME or NAME=COUNT; names are {', '.join(LISTS)}")
        found[name] = int(count) if count else LISTS[name].count
        if not found[name]:
            raise SystemExit(f"--list {one}: the frozen table has none of these; give {name}=COUNT")
    return found or {name: one.count for name, one in LISTS.items()}


def show(chosen: argparse.Namespace) -> None:
    """Print the scoreboard of results, optionally re-scored or compared with a base."""
    table = results.read(chosen.results)
    now = scored(table)
    if chosen.rescore:
        again = rescore.rescored(table, rescore.parsed(chosen.rescore))
        decided = rescore.rescored(table, {})
        print(rescore.agreement(now, decided))
        print(board.paired(decided, again, "settings of the code", ", ".join(chosen.rescore)))
        return
    print(board.scoreboard(now))
    if chosen.confusions:
        print(board.confusions(now))
    if chosen.base is not None:
        print(board.paired(scored(results.read([chosen.base])), now, str(chosen.base), "these results"))
    if chosen.keep:
        if not chosen.commit:
            raise SystemExit("--keep: give the --commit of the code that was measured, too")
        whence = origin(table, results.made_by(table), chosen.commit)
        keep(chosen.keep, [row | whence for row in board.table(now)])


def write(chosen: argparse.Namespace) -> None:
    """Write one study as files."""
    one = LISTS[chosen.list]
    folder = chosen.folder or chosen.out.parent / "judge"
    study = one.prepare(chosen.seed, chosen.seconds or one.seconds, folder)
    studies.write(study, chosen.out)


def parser() -> argparse.ArgumentParser:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.judge", description=about)
    commands = top.add_subparsers(required=True)
    plain = {name: one for name, one in LISTS.items() if ":" not in name}
    words = "; ".join(f"{name} ({one.count}): {one.about}" for name, one in plain.items())
    conditions = ", ".join(name for name in LISTS if name.startswith("logs:"))
    lists = (
        f"Lists, with their number of studies in the frozen table: {words}.  "
        f"Lists of one condition: {conditions}; likewise logs-none:CONDITION."
    )
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument(
        "--seconds", type=float, help="length of a recording; each list has its own by default"
    )
    common.add_argument(
        "--folder", type=Path, help="for fitted files; by default `judge` in the folder of the output"
    )
    one = commands.add_parser(
        "run", help="run studies and print the scoreboard", epilog=lists, parents=[common]
    )
    one.add_argument(
        "--list",
        action="append",
        default=[],
        metavar="NAME[=COUNT]",
        help="repeat for several; those of the frozen table by default",
    )
    one.add_argument("--first-seed", type=int, default=FIRST_SEED)
    add_workers(one)
    one.add_argument("-o", "--out", type=Path, default=Path("judge.parquet"))
    one.set_defaults(action=run)
    two = commands.add_parser("show", help="print the scoreboard of results")
    two.add_argument("results", type=Path, nargs="+")
    two.add_argument("--base", type=Path, help="earlier results; print paired differences")
    two.add_argument("--confusions", action="store_true", help="print what was named first for each truth")
    two.add_argument(
        "--rescore",
        action="append",
        default=[],
        metavar="settings.CONSTANT=VALUE",
        help=f"decide again with another constant: {', '.join(rescore.CONSTANTS)}",
    )
    two.add_argument("--keep", metavar="NAME", help="write the scoreboard to benchmarks/results/NAME.csv")
    two.add_argument("--commit", help="commit of the code that was measured, for --keep")
    two.set_defaults(action=show)
    three = commands.add_parser("write", help="write one study as files", epilog=lists, parents=[common])
    three.add_argument("--list", choices=LISTS, required=True, metavar="NAME")
    three.add_argument("--seed", type=int, required=True)
    three.add_argument("-o", "--out", type=Path, default=Path("study"), help="folder that gets the files")
    three.set_defaults(action=write)
    return top


def main() -> None:
    chosen = parser().parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
