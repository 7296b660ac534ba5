"""Run the study of divergence, and keep its table.

    # Flights without a policy, all cells and seeds, a second for each network after its training:
    python -m benchmarks.divergence open divergence --full RECORDINGS
    # Trainings, about a minute each; cells in the order given:
    python -m benchmarks.divergence sac divergence --cells centre "DVL noise" --seeds 3
    # Keep the table:
    python -m benchmarks.divergence keep divergence --commit COMMIT

Each cell and seed is one row of `rows.jsonl` in the folder, and the same command continues where an earlier
one stopped.  Only 200 minutes of data need the full recordings; by default they are those of the distribution
deep-hydro-sim-data.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # threads of matrices this small only wait for one another

import argparse
import json
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import polars as pl

from benchmarks.divergence import open_loop, trainings
from benchmarks.divergence.cells import CELLS, CONDITIONS, Cell, cell_of
from benchmarks.divergence.networks import STONEFISH, Source, network
from benchmarks.divergence.summary import OPEN, TRAINED, kept
from benchmarks.kept_tables import Row, keep, origin

SEEDS = 5
COMMAND = "python -m benchmarks.divergence open divergence; python -m benchmarks.divergence sac divergence"


def rows_of(folder: Path) -> list[Row]:
    """Return the rows that are done."""
    path = folder / "rows.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def todo(
    part: str, cells: Sequence[Cell], seeds: int, done: Sequence[Row]
) -> Iterator[tuple[Cell, str, int]]:
    """Yield cell, condition and seed of the rows that are not done, seed by seed."""
    known = {(row["part"], row["cell"], row["condition"], row["seed"]) for row in done}
    for seed in range(seeds):
        for cell in cells:
            for condition in CONDITIONS:
                if (part, cell.name, condition, seed) not in known:
                    yield cell, condition, seed


def run(
    part: str, cells: Sequence[Cell], seeds: int, folder: Path, work: Callable[[Cell, str, int], Row]
) -> None:
    """Do all rows of a part, and append each to the file as it comes."""
    folder.mkdir(parents=True, exist_ok=True)
    for cell, condition, seed in todo(part, cells, seeds, rows_of(folder)):
        row = {"part": part, "cell": cell.name, "condition": condition, "seed": seed}
        row |= work(cell, condition, seed)
        finite = {name: value if _finite(value) else 1e300 for name, value in row.items()}
        with (folder / "rows.jsonl").open("a") as file:
            file.write(json.dumps(finite) + "\n")
        print(json.dumps(finite), flush=True)


def _finite(value: object) -> bool:
    """Return whether a cell can be written as JSON."""
    return not isinstance(value, float) or math.isfinite(value)


def fly(source: Source, folder: Path) -> Callable[[Cell, str, int], Row]:
    """Return the function that flies a cell in open loop."""
    vehicle = source.vehicle
    given = open_loop.flights(vehicle, STONEFISH / "replay90.parquet")

    def one(cell: Cell, condition: str, seed: int) -> Row:
        model = network(source, cell.data, CONDITIONS[condition], seed, folder / "networks")
        found = open_loop.measure(vehicle, open_loop.condition_of(cell, condition, model), given)
        return found | {"validation": float(model.training["validation_rmse"])}

    return one


def learn(source: Source, folder: Path, steps: int) -> Callable[[Cell, str, int], Row]:
    """Return the function that trains a policy in a cell."""

    def one(cell: Cell, condition: str, seed: int) -> Row:
        model = network(source, cell.data, CONDITIONS[condition], seed, folder / "networks")
        return trainings.train(trainings.config(cell, condition, seed, steps), source.vehicle, model)

    return one


def main() -> None:
    about = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.divergence", description=about)
    parser.add_argument("part", choices=[OPEN, TRAINED, "keep"])
    parser.add_argument("folder", type=Path, help="folder of networks and rows")
    parser.add_argument("--full", type=Path, help="folder of the full recordings")
    parser.add_argument("--cells", nargs="+", default=[one.name for one in CELLS], metavar="NAME")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="number of seeds")
    parser.add_argument("--steps", type=int, default=trainings.STEPS, help="control steps of a training")
    parser.add_argument("--commit", default="", help="commit of the measured code, to keep the table")
    parser.add_argument("--command", default=COMMAND, help="command lines of the kept rows")
    given = parser.parse_args()
    if given.part == "keep":
        found = rows_of(given.folder)
        where = origin(pl.DataFrame({"seed": [row["seed"] for row in found]}), given.command, given.commit)
        keep("divergence", [row | where for row in kept(found)])
        return
    source, cells = Source(full=given.full), [cell_of(name) for name in given.cells]
    work = fly(source, given.folder) if given.part == OPEN else learn(source, given.folder, given.steps)
    run(given.part, cells, given.seeds, given.folder, work)


if __name__ == "__main__":
    main()
