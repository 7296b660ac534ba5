"""Make cases, answer them with a baseline, and write the leaderboard.

    python -m benchmarks.challenge make --key key.txt --cases 0-59 FOLDER
    python -m benchmarks.challenge run FOLDER --baseline hydro
    python -m benchmarks.challenge board FOLDER

FOLDER gets `cases` for entrants, `truth` for the scorer, and an entry per baseline in `entries`.  Entries of
others go there, too.  Every command continues where an earlier one stopped.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # processor time is compared on one thread

import argparse
from pathlib import Path

import numpy as np
import polars as pl

from benchmarks.challenge import seal
from benchmarks.challenge.baselines import BASELINES, run
from benchmarks.challenge.board import board
from benchmarks.challenge.layout import cases
from benchmarks.challenge.make import CASES, make, name_of
from benchmarks.kept_tables import keep, markdown, origin


def makes(chosen: argparse.Namespace) -> None:
    """Make the cases that the command line names."""
    make(seal.key_of(chosen.key), chosen.folder, places(chosen.cases))


def places(text: str) -> list[int]:
    """Return the numbers of a text such as `0-11,14`."""
    found: list[int] = []
    for part in text.split(","):
        low, _, high = part.partition("-")
        found += range(int(low), int(high or low) + 1)
    return found


def ordered(numbers: list[int], seed: int | None) -> list[int]:
    """Return the numbers of cases in the random order of a seed; unchanged without a seed."""
    if seed is None:
        return numbers
    return [int(number) for number in np.random.default_rng(seed).permutation(numbers)]


def runs(chosen: argparse.Namespace) -> None:
    """Answer with a baseline all cases that it has not answered yet."""
    known = {one.name: one for one in cases(chosen.folder / "cases")}
    wanted = [name_of(place) for place in ordered(places(chosen.cases), chosen.random)]
    for there in (known[name] for name in wanted if name in known):
        for name in chosen.baseline or BASELINES:
            entry = chosen.folder / "entries" / name
            if not (entry / there.name / "answer.json").exists():
                print(f"{there.name}, {name}: {run(name, there, entry):.1f} s", flush=True)


def boards(chosen: argparse.Namespace) -> None:
    """Print the leaderboard, and write it as a kept table if requested."""
    entries = sorted(path for path in (chosen.folder / "entries").iterdir() if path.is_dir())
    rows = board(chosen.folder, entries, chosen.common)
    print(markdown(rows))
    if chosen.keep:
        option, name = (" --common", "challenge_common") if chosen.common else ("", "challenge")
        command = f"python -m benchmarks.challenge board edition{option}"
        source = origin(pl.DataFrame({"seed": [0]}), command, chosen.keep)
        keep(name, [row | source | {"seeds": "by the key of the edition"} for row in rows])


def main() -> None:
    top = argparse.ArgumentParser(
        prog="python -m benchmarks.challenge",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = top.add_subparsers(required=True)
    one = commands.add_parser("make", help="make the cases of an edition")
    one.add_argument("folder", type=Path)
    one.add_argument("--key", type=Path, required=True, help="key of the edition; drawn if it is missing")
    one.add_argument("--cases", default=f"0-{CASES - 1}", metavar="NUMBERS", help="such as 0-11,14")
    one.set_defaults(action=makes)
    two = commands.add_parser("run", help="answer cases with baselines")
    two.add_argument("folder", type=Path)
    two.add_argument("--baseline", action="append", choices=BASELINES, help="all by default")
    two.add_argument("--cases", default=f"0-{CASES - 1}", metavar="NUMBERS", help="of those that exist")
    two.add_argument("--random", type=int, metavar="SEED", help="take the cases in a random order")
    two.set_defaults(action=runs)
    three = commands.add_parser("board", help="score all entries and print the leaderboard")
    three.add_argument("folder", type=Path)
    three.add_argument("--common", action="store_true", help="score only cases that every entry answers")
    three.add_argument("--keep", metavar="COMMIT", help="keep the table, of the code of a commit")
    three.set_defaults(action=boards)
    chosen = top.parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
