"""Thrust that changes between the sessions of a recording, on vehicles of the independent simulator.

    python -m benchmarks.within FOLDER --seed 6 --seed 7

For each seed, two unchanged vehicles get four courses of thrust over the four later sessions (`COURSES`).
`--keep COMMIT` writes the answers as the kept table `within`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from benchmarks.apart import make
from benchmarks.apart.cases import CASES, Drawn, draw
from benchmarks.apart.recordings import Flown, Recording, fly, table
from benchmarks.kept_tables import keep, markdown, origin
from hydro.core.diagnosis.findings import Diagnosis
from hydro.core.diagnosis.pipeline import diagnose
from hydro.io import vehicle as files

NAMES = ("unchanged_1", "unchanged_2")
"""Cases whose vehicles are flown: a frame with eight thrusters, and a hovering vehicle."""
ALL, SECOND = slice(None), 1
"""Thrusters: all, and the second alone."""
COURSES: Mapping[str, tuple[slice | int, tuple[float, ...]]] = {
    "all at 86 %": (ALL, (0.86, 0.86, 0.86, 0.86)),
    "all falling from 97 to 76 %": (ALL, (0.97, 0.90, 0.83, 0.76)),
    "one at 50 %": (SECOND, (0.5, 0.5, 0.5, 0.5)),
    "one failing to 40 % after two sessions": (SECOND, (1.0, 1.0, 0.4, 0.4)),
}
"""Thrusters that change, and the share of their thrust that is left in each of four sessions."""
Row = dict[str, Any]


def recordings(seed: int, name: str, folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the courses of a vehicle, each with the file of the later recording; missing files are made.

    The folder of the vehicle, `folder`/NAME, also gets `vehicle.toml` and `before.parquet`.

    Args:
        seed: Seed of the vehicles.
        name: Name of the unchanged case.
        folder: Folder of the seed.
    """
    drawn = [draw(seed, place) for place in range(len(CASES))]
    case = next(one for one in drawn if one.case.name == name)
    there = folder / name
    if not (there / "stated.json").exists():
        there.mkdir(parents=True, exist_ok=True)
        make.unchanged_flights(drawn, [case], folder)
        make.owners_file(case, there)
    for number, (words, (which, left)) in enumerate(COURSES.items()):
        path = there / f"course-{number}.parquet"
        if not path.exists():
            sessions = [_session(drawn, case, place, which, share) for place, share in enumerate(left)]
            make.keep(table(sessions, case.rows["after"], {}, "a"), path)
        yield words, path


def _session(drawn: Sequence[Drawn], case: Drawn, place: int, which: slice | int, share: float) -> Flown:
    """Fly one of the later sessions of a case with a share of the thrust of some thrusters."""
    gain = case.vehicle.P["thr_gain"].copy()
    gain[which] *= share
    weaker = case.vehicle.P | {"thr_gain": gain}
    batch = [Recording(one, "after", weaker if one is case else None) for one in drawn]
    return fly(batch, case.seed)[case.place, "after"][place]


def answer(seed: int, name: str, words: str, found: Diagnosis) -> Row:
    """Return the answer of a diagnosis as a row of the result table."""
    first = next((one for one in found.findings if one.parameters), None)
    return {
        "seed": seed,
        "vehicle": name,
        "thrust": words,
        "answer": found.headline,
        "confidence": f"{first.confidence:.3f}" if first is not None else "",
    }


def run(folder: Path, seeds: Sequence[int], commit: str | None) -> None:
    """Make and diagnose the recordings of some seeds, and print the answers as a table.

    Args:
        folder: Folder for the files of vehicles and recordings.
        seeds: Seeds of the vehicles.
        commit: Commit of the measured code, which keeps the table; None keeps nothing.
    """
    rows: list[Row] = []
    for seed in seeds:
        for name in NAMES:
            there = folder / f"within-{seed}"
            for words, path in recordings(seed, name, there):
                given = files.read(there / name / "vehicle.toml")[0]
                before = pl.read_parquet(there / name / "before.parquet")
                found = diagnose(given, pl.read_parquet(path), before=before)
                rows.append(answer(seed, name, words, found))
                print(f"{len(rows)}/{len(seeds) * len(NAMES) * len(COURSES)}: {rows[-1]}", flush=True)
    print(markdown(rows))
    if commit is not None:
        command = " ".join(["python -m benchmarks.within FOLDER", *(f"--seed {one}" for one in seeds)])
        keep("within", [row | origin(pl.DataFrame(rows), command, commit) for row in rows])


def main() -> None:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.within", description=about)
    top.add_argument("folder", type=Path, help="for vehicles and recordings; what is there is used again")
    top.add_argument("--seed", type=int, action="append", required=True, help="repeat for several")
    top.add_argument("--keep", metavar="COMMIT", help="keep the table, with the commit that was measured")
    chosen = top.parse_args()
    run(chosen.folder, chosen.seed, chosen.keep)


if __name__ == "__main__":
    main()
