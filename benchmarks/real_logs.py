"""Compare explained vehicle files with simple predictors on the held-out sessions of a real vehicle.

    python -m benchmarks.real_logs FOLDER [--split SPLIT] [--vehicle FILE] [--keep COMMIT]

The folder has the logs fit.csv and hold.csv, map.toml that reads both, and vehicle files vehicle*.toml.
`explain` adds steps on fit.csv, or on its first two sessions.  Nothing uses the held-out sessions but the
rule that ends the steps.  Errors are root mean squares over predictions of 5 s.  A paired test over blocks of
time (`explanation.axes`) gives the verdict of an axis.  It says whether the model predicts worse than zero
velocity, or than least squares fitted to the same sessions.  A kept table has the latest rows of every split
and vehicle file.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import polars as pl

import hydro
from benchmarks.kept_tables import RESULTS, Row, keep, markdown
from hydro.core.columns import VELOCITY
from hydro.core.evaluation.misfit import Misfit
from hydro.core.evaluation.regimes import Pieces
from hydro.core.evaluation.replay_error import replay
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.evaluation.velocity_errors import Squares
from hydro.core.evaluation.yardsticks import LEAST_SQUARES, ZERO
from hydro.core.explanation.axes import worse_axes
from hydro.core.explanation.explain import ending, explain
from hydro.core.explanation.ladder import HORIZON, best
from hydro.core.explanation.trials import Recordings
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.tracking import tracked
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as vehicles

SPLITS = {"two sessions": 2, "all sessions": None}
"""Number of the first sessions of each log in a split; None for all."""
JUDGED = ("u", "v", "w", "r")
"""Axes that the vehicle's controller drives."""


def head(raw: pl.DataFrame, sessions: int | None) -> pl.DataFrame:
    """Return the first sessions of a recording; all of them for None."""
    names = raw["session"].unique(maintain_order=True)[:sessions]
    return raw.filter(pl.col("session").is_in(names.implode()))


def squares(misfit: Misfit) -> Squares:
    """Return the squared errors, piece by piece, of the judged axes only."""
    of = [VELOCITY.index(axis) for axis in JUDGED]
    kept = np.isin(np.arange(len(VELOCITY)), of)
    return Squares(misfit.squares * kept, misfit.numbers * kept)


def held_out(recordings: Recordings, vehicle: Vehicle) -> dict[str, Squares]:
    """Return the squared errors on the held-out sessions of the model and of the simple predictors."""
    log, yardstick = recordings.holdout, recordings.yardstick.of_others
    assert log is not None
    record = tracked(vehicle, log.observed)
    motion, pieces = Motion.of(record), Pieces.of(record)
    found = replay(candidate(vehicle), record, motion, pieces, HORIZON, 0, yardstick.weights)
    assert found is not None
    simple = dict(yardstick.misfits(record, motion, pieces, HORIZON, found[0]))
    return {
        "model": squares(found[0]),
        ZERO: squares(simple[ZERO]),
        LEAST_SQUARES: squares(simple[LEAST_SQUARES]),
    }


def judged(errors: dict[str, Squares]) -> Iterator[Row]:
    """Yield a row for each axis, and one for the geometric mean of the error ratio to least squares.

    Args:
        errors: Squared errors of the model and of the simple predictors, by name.
    """
    beaten = {name: worse_axes(errors[name], errors["model"]) for name in (ZERO, LEAST_SQUARES)}
    root = {name: np.sqrt(one.mean) for name, one in errors.items()}
    for axis in JUDGED:
        i = VELOCITY.index(axis)
        worse = [name for name, axes in beaten.items() if axis in axes]
        figures = {name: f"{root[name][i]:.4f}" for name in (ZERO, LEAST_SQUARES, "model")}
        ratio = root["model"][i] / root[LEAST_SQUARES][i]
        verdict = f"worse than {' and '.join(worse)}" if worse else "not worse"
        yield {"axis": axis, **figures, "model / least squares": f"{ratio:.3f}", "verdict": verdict}
    of = [VELOCITY.index(axis) for axis in JUDGED]
    mean = float(np.exp(np.mean(np.log(root["model"][of] / root[LEAST_SQUARES][of]))))
    yield {"axis": "geometric mean", "model / least squares": f"{mean:.3f}"}


def studied(folder: Path, file: Path, split: str) -> Iterator[Row]:
    """Explain the training sessions from a vehicle file, and yield the rows of the best step."""
    raws = [
        head(hydro.import_log(folder / name, folder / "map.toml")[0], SPLITS[split])
        for name in ("fit.csv", "hold.csv")
    ]
    vehicle, _ = vehicles.read(file)
    begun = time.process_time()
    recordings = Recordings.of(vehicle, *raws, None)
    steps = []
    for step in explain(vehicle, raws[0], holdout=raws[1], recordings=recordings):
        steps.append(step)
        seconds = time.process_time() - begun
        print(
            f"{split}, {file.name}: step {step.number} {', '.join(step.added)} ({seconds:.0f} s)", flush=True
        )
    used = best(steps)
    added = ", ".join(name for step in steps[1 : used.number + 1] for name in step.added)
    print(f"    ends: {ending(steps)}; used: step {used.number} ({added})", flush=True)
    for row in judged(held_out(recordings, used.vehicle)):
        last = {} if row["axis"] in JUDGED else {"added by explain": added, "processor [s]": f"{seconds:.0f}"}
        yield {"split": split, "vehicle": file.name, **row, **last}


def with_kept(rows: Sequence[Row], kept: Sequence[Row]) -> list[Row]:
    """Return new rows with the kept ones of other splits and vehicle files, in the order of both.

    Args:
        rows: New rows.
        kept: Rows of the kept table.
    """
    new = {(row["split"], row["vehicle"]) for row in rows}
    every = [*rows, *(row for row in kept if (row["split"], row["vehicle"]) not in new)]
    return sorted(every, key=lambda row: ([*SPLITS].index(row["split"]), row["vehicle"]))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--split", choices=SPLITS, action="append", help="by default both")
    parser.add_argument("--vehicle", action="append", help="name of a vehicle file; by default all")
    parser.add_argument("--keep", metavar="COMMIT", help="keep the table as measured with this code")
    chosen = parser.parse_args()
    files = [f for f in sorted(chosen.folder.glob("vehicle*.toml")) if f.name in (chosen.vehicle or [f.name])]
    rows = [
        row
        for split in chosen.split or SPLITS
        for file in files
        for row in studied(chosen.folder, file, split)
    ]
    print(markdown(rows))
    if chosen.keep:
        where = {"commit": chosen.keep, "recorded": "", "date": datetime.date.today().isoformat()}
        where |= {"command": "python -m benchmarks.real_logs FOLDER", "seeds": ""}
        file = RESULTS / "real_logs.csv"
        kept = list(csv.DictReader(file.open(newline=""))) if file.exists() else []
        keep("real_logs", with_kept([row | where for row in rows], kept))


if __name__ == "__main__":
    main()
