"""Generation of the cases of a seed as files: flights, the owner's file, and flights after a change.

A case is a folder with `vehicle.toml` (and `start.toml`, what it was fitted from), `fit.parquet`,
`before.parquet`, `after.parquet`, `stated.json` (accuracy of the file) and, written last, `truth.json`.
Existing files are kept.  `hydro fit` and `hydro compare` run as for a user.  A build with another fit gives
other files, and possibly other sizes of changes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.apart import owner
from benchmarks.apart.cases import CASES, SPREAD, Drawn, draw
from benchmarks.apart.changes import Truth, changed
from benchmarks.apart.frames import Array
from benchmarks.apart.recordings import Flown, Recording, effect, fly, table
from benchmarks.apart.vehicles import Parameters

SHARE = 0.15
"""Minimum share of the squared 5 s error that a change must cause."""
LARGER, SMALLER = 1.6, 0.7
"""Factors on the size of an effect that is too small, and of one with which the vehicle cannot be flown."""
ROUNDS = 5
SHOTS = 70
"""Number of shots of the fit of a file."""
TOO_LONG = 900.0
"""Longest duration of one command of hydro [s]."""
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def hydro(*arguments: Any, seconds: float = TOO_LONG) -> subprocess.CompletedProcess[str]:
    """Run a command of hydro with this interpreter in one thread.

    Args:
        arguments: Words of the command, without `hydro`.
        seconds: Longest duration [s].

    Raises:
        subprocess.TimeoutExpired: The command takes longer than `seconds`.
    """
    command = [sys.executable, "-m", "hydro", *map(str, arguments)]
    environment = {**os.environ, **ONE_THREAD}
    return subprocess.run(
        command, capture_output=True, text=True, env=environment, timeout=seconds, check=False
    )


def make(seed: int, folder: Path, only: Sequence[str] = ()) -> None:
    """Make the missing files of the cases of a seed.

    If a change must be made larger, the noise depends on the other cases with larger changes.  So with
    `only`, cases get other noise than in a full run.

    Args:
        seed: Seed of the cases.
        folder: Folder that gets a folder per case.
        only: Names of cases; all by default.
    """
    drawn = [draw(seed, place) for place in range(len(CASES))]
    chosen = [each for each in drawn if not only or each.case.name in only]
    unchanged_flights(drawn, chosen, folder)
    for each in chosen:
        if not (folder / each.case.name / "stated.json").exists():
            owners_file(each, folder / each.case.name)
    changed_flights(drawn, chosen, folder)


def unchanged_flights(drawn: Sequence[Drawn], chosen: Sequence[Drawn], folder: Path) -> None:
    """Write missing `fit.parquet` and `before.parquet` of chosen cases, with the noise of the full batch."""
    wanted = {each.place for each in chosen}

    def lacks(each: Drawn) -> bool:
        return each.place in wanted and not (folder / each.case.name / "before.parquet").exists()

    flown = fly(
        [
            Recording(each, name, each.vehicle.P if lacks(each) else None)
            for each in drawn
            for name in ("fit", "before")
        ],
        drawn[0].seed,
        _say,
    )
    for (place, name), sessions in flown.items():
        each = drawn[place]
        keep(table(sessions, each.rows[name], {}, name[0]), folder / each.case.name / f"{name}.parquet")


def owners_file(drawn: Drawn, folder: Path) -> None:
    """Write `start.toml`, `vehicle.toml` and `stated.json`: whether it is fitted, and its 5 s error."""
    rng = drawn.rng(8)
    fitted = drawn.fitted
    told = owner.effects(drawn.vehicle, rng, SPREAD[fitted])
    name = f"apart-{drawn.case.name.replace('_', '-')}"
    start, vehicle = folder / "start.toml", folder / "vehicle.toml"
    start.write_text(owner.file(drawn.vehicle, name, told, rng))
    if fitted:
        own = [part for effect in drawn.vehicle.own for part in ("--effect", effect)]
        got = hydro("fit", start, folder / "fit.parquet", *own, "--shots", SHOTS, "-o", vehicle)
        if got.returncode:
            _say(f"{drawn.case.name}: used as stated, not fitted: {got.stderr.strip()[-300:]}")
            fitted = False
    if not fitted:
        vehicle.write_text(start.read_text())
    error = error_of(vehicle, folder / "before.parquet")
    (folder / "stated.json").write_text(json.dumps({"fitted": fitted, "error": error}))
    _say(f"{drawn.case.name}: file {'fitted' if fitted else 'stated'}, {error:.3g} 5 s ahead")


def error_of(vehicle: Path, before: Path) -> float:
    """Return the root mean square 5 s error of a file on two earlier sessions, all axes [m/s, rad/s].

    Raises:
        RuntimeError: `hydro compare` fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        two = Path(folder) / "two.parquet"
        pl.read_parquet(before).filter(pl.col("session").is_in(["b0", "b1"])).write_parquet(two)
        got = hydro("compare", vehicle, two, "--json")
    if not got.stdout:
        raise RuntimeError(f"hydro compare {vehicle}: {got.stderr.strip()[-300:]}")
    rows = json.loads(got.stdout)
    rows = rows if isinstance(rows, list) else next(iter(rows.values()))
    ahead = [
        row for row in rows if (row.get("level"), row.get("by"), row.get("horizon")) == ("replay", "all", 5.0)
    ]
    for row in ahead:
        if row.get("axis") in ("all", None, ""):
            return float(row["rmse"])
    return float(
        np.sqrt(np.sum(np.square([row["rmse"] for row in ahead if row.get("axis") in list("uvwpqr")])))
    )


def changed_flights(drawn: Sequence[Drawn], chosen: Sequence[Drawn], folder: Path) -> None:
    """Write missing `after.parquet` and `truth.json` of chosen cases, with changes of sufficient effect."""
    done = {each.place: record(folder / each.case.name) for each in drawn}
    waiting = [each for each in chosen if done[each.place] is None]
    size = {each.place: each.size for each in waiting}
    for number in range(ROUNDS):
        if not waiting:
            return
        changes = {
            each.place: changed(each.case.kind, each.vehicle, each.rng(9), size[each.place])
            for each in waiting
        }
        flown = fly(batch(drawn, changes, done, number), drawn[0].seed, _say)
        again = []
        for each in waiting:
            sessions, truth = flown[each.place, "after"], changes[each.place][1]
            told = telling(each, sessions, truth, folder / each.case.name)
            factor = 1.0 if number == ROUNDS - 1 else another(each, truth, told["share5"])
            if factor != 1.0:
                size[each.place] *= factor
                again.append(each)
                _say(f"{each.case.name}: share {told['share5']:.3f}, size {size[each.place]:.3g}")
                continue
            keep(table(sessions, each.rows["after"], truth, "a"), folder / each.case.name / "after.parquet")
            told |= {"scale": size[each.place], "round": number}
            text = json.dumps(plain(described(each, truth) | told), indent=1)
            (folder / each.case.name / "truth.json").write_text(text + "\n")
            _say(f"{each.case.name}: {each.maker}, share {told['share5']:.2f}, {plain(truth)}")
        waiting = again


def batch(
    drawn: Sequence[Drawn],
    changes: dict[int, tuple[Parameters, Truth]],
    done: dict[int, dict[str, Any] | None],
    number: int,
) -> list[Recording]:
    """Return the recordings of a round: changed vehicles to fly, and cases that only share its noise.

    Args:
        drawn: All cases.
        changes: Parameters and truth of the changes to fly, by place of the case.
        done: `truth.json` of the cases that are complete, by place; None for others.
        number: Number of the round.
    """
    found = []
    for each in drawn:
        kept = done[each.place]
        if each.place in changes:
            found.append(Recording(each, "after", changes[each.place][0]))
        elif number == 0 or (kept is not None and kept["round"] >= number):
            found.append(Recording(each, "after", None))
    return found


def record(folder: Path) -> dict[str, Any] | None:
    """Return `truth.json` of the case in a folder; None if it does not exist."""
    path = folder / "truth.json"
    return json.loads(path.read_text()) if path.exists() else None


def telling(drawn: Drawn, flown: Sequence[Flown], truth: Truth, folder: Path) -> dict[str, Any]:
    """Return the effect of a change on the velocity 5 s ahead, and its share of the squared error.

    Args:
        drawn: The case.
        flown: Flights of the changed vehicle.
        truth: True values of the change.
        folder: Folder of the case, with the error of the vehicle file.
    """
    stated = json.loads((folder / "stated.json").read_text())
    made: Array = np.full(6, np.nan)
    if all(np.isfinite(each.states).all() for each in flown):
        made = effect(drawn.vehicle.P, drawn.vehicle.kind, flown, drawn.rows["after"])
    square = (made**2).sum()
    share = float(square / (square + stated["error"] ** 2))
    return {"fitted": stated["fitted"], "share5": share, "error5_before": stated["error"], "effect5": made}


def another(drawn: Drawn, truth: Truth, share: float) -> float:
    """Return the factor by which to change the size of a change; 1 to keep it.

    A change with a size is made larger if its share of the error is too small, and smaller if a flight
    diverged.
    """
    if not np.isfinite(share):
        return SMALLER
    sized = bool(truth) and not {"sensor", "columns"} & set(truth) and drawn.case.kind != "thr_dead"
    return LARGER if sized and share < SHARE else 1.0


def described(drawn: Drawn, truth: Truth) -> dict[str, Any]:
    """Return the truth of a case, for `truth.json`."""
    vehicle, rows = drawn.vehicle, drawn.rows
    return {
        "name": drawn.case.name,
        "kind": drawn.case.kind,
        "seed": drawn.seed,
        "vehicle": drawn.maker,
        "n": vehicle.n,
        "mass": vehicle.P["mass"],
        "box": vehicle.box,
        "truth": truth,
        "modes_before": drawn.modes["before"],
        "modes_after": drawn.modes["after"],
        "seconds_before": sum(rows["before"]) / 50,
        "seconds_after": sum(rows["after"]) / 50,
    }


def plain(x: Any) -> Any:
    """Convert a value to JSON types, with numbers to a millionth."""
    if isinstance(x, dict):
        return {k: plain(v) for k, v in x.items()}
    if isinstance(x, np.ndarray):
        return np.round(x, 6).tolist()
    if isinstance(x, list | tuple):
        return [plain(v) for v in x]
    if isinstance(x, np.floating | np.integer):
        return round(float(x), 6)
    return x


def keep(frame: pl.DataFrame, path: Path) -> None:
    """Write a table to a temporary file and rename it, so that it is complete or absent."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    frame.write_parquet(partial)
    partial.replace(path)


def _say(line: str) -> None:
    """Print a progress line."""
    print(f"  {line}", flush=True)
