"""Robustness test of long commands: kill at random times, continue, and compare files with an unbroken run.

    python -m benchmarks.kills --kills 100 -o kills.parquet

Every second kill is an interrupt from the keyboard; the others cannot be caught.  After each kill, existing
files must be complete.  After an interrupt there must also be no unfinished files and at most one line of
output.  A command that was killed often enough is run to its end, and must produce the same bytes.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from hydro.core.errors import DataError
from hydro.io import lock, table
from hydro.io.files import bundled
from hydro.rl.training.runs import _read_state

IN_A_ROW = 4
"""Kills of one run before it may finish."""
CLOCKS = ("steps.json",)
"""Files that contain durations."""
SCHEMA: dict[str, Any] = {
    "command": pl.String,
    "signal": pl.String,
    "after": pl.Float64,
    "whole": pl.Float64,
    "ended": pl.Boolean,
    "fault": pl.String,
}
"""Columns: the command, signal and time of the kill, total duration [s], whether it had ended by itself, and
the errors afterwards; empty without errors."""


@dataclass(frozen=True)
class Work:
    """Command with its inputs.

    Attributes:
        name: Name of the command.
        line: Words of the command without `hydro`; run in its own folder.
        needs: Command lines that make its inputs.
    """

    name: str
    line: str
    needs: tuple[str, ...] = ()


def works() -> list[Work]:
    """Return every long command, with minimal inputs."""
    hidden, logs = bundled("hidden"), bundled("logs")
    vehicle, sample = bundled("vehicles") / "auv151.toml", bundled("stonefish") / "sample.parquet"
    replay = bundled("stonefish") / "replay90.parquet"
    short = f"collect --vehicle {vehicle} --excitation walks --rows 3000 -o raw.parquet"
    labels = "labels raw.parquet -o labels.parquet"
    dives = tuple(
        f"collect --vehicle {vehicle} --excitation walks --rows 3000 --seed {seed} -o dive{seed}.parquet"
        for seed in range(4)
    )
    small = "--set sac.layers=[32,32] --set sac.batch=64 --set sac.random=40"
    few = f"--set vehicles=4 {small} --set evaluate=80 --set record=40 --set episodes=1"
    return [
        Work("import", f"import {logs}/example.csv --map {logs}/map.toml -o raw.parquet"),
        Work("collect", short),
        Work("labels", labels, (short,)),
        Work("train", "train labels.parquet --model mlp --epochs 3 -o model.parquet", (short, labels)),
        Work(
            "fit",
            f"fit {hidden}/vehicle.toml {hidden}/measured.parquet --effect linear_damping -o fitted.toml",
        ),
        Work("explain", f"explain {hidden}/vehicle.toml {hidden}/measured.parquet -o study"),
        Work(
            "track",
            f"track {vehicle} {' '.join(f'dive{seed}.parquet' for seed in range(4))} --baseline 2 -o history",
            dives,
        ),
        Work("study", f"study models {sample} --replay {replay} --quick -o study"),
        Work("rl train", f"rl train {vehicle} --condition R_effects --steps 320 {few} -o run"),
        Work(
            "rl study",
            f"rl study {vehicle} --condition R_0 --seeds 1 --stages 1 --steps 160 --episodes 2 {few}"
            " -o study",
        ),
    ]


def hydro(line: str, folder: Path) -> subprocess.Popen[str]:
    """Start a command of hydro in a folder, in a new process group."""
    words = [sys.executable, "-m", "hydro", *line.split()]
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    return subprocess.Popen(words, cwd=folder, text=True, start_new_session=True, **quiet)  # type: ignore[call-overload, no-any-return]


def finished(line: str, folder: Path) -> float:
    """Run a command to its end, and return its duration [s].

    Raises:
        DataError: The command failed.
    """
    started = time.perf_counter()
    process = hydro(line, folder)
    said = process.communicate()[1]
    if process.returncode:
        raise DataError(f"hydro {line}: {said.strip()}")
    return time.perf_counter() - started


def killed(line: str, folder: Path, after: float, how: signal.Signals) -> tuple[bool, str]:
    """Run a command and send it a signal after `after` [s].

    Returns:
        Whether the command had ended before, and a description of a fault; empty without a fault.
    """
    before = {path for path in files(folder) if unfinished(path)}  # of a kill, swept when next written
    process = hydro(line, folder)
    try:
        said, ended = process.communicate(timeout=after)[1], True
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, how)
        said, ended = process.communicate()[1], False
    except BaseException:  # we are interrupted ourselves
        os.killpg(process.pid, signal.SIGKILL)
        raise
    if ended:
        return True, "" if process.returncode == 0 else f"exit {process.returncode}: {said.strip()}"
    if how == signal.SIGKILL:
        return False, ""
    if ("Traceback" in said and "cli.py" in said) or "bug" in said:  # else the interpreter was still loading
        return False, f"interrupted: {said.strip()}"
    left = [path.name for path in files(folder) if unfinished(path) and path not in before]
    return False, f"left behind: {', '.join(left)}" if left else ""


def files(folder: Path) -> Iterator[Path]:
    """Yield all files in a folder and below."""
    yield from sorted(path for path in folder.rglob("*") if path.is_file())


def unfinished(path: Path) -> bool:
    """Return whether a file is marked as unfinished."""
    return path.suffix == ".tmp" or path.name in (lock.LOCK, lock.OWNER)


def broken(folder: Path) -> str:
    """Return the names of the files in a folder that are not complete, separated by commas."""
    return ", ".join(path.name for path in files(folder) if not unfinished(path) and not whole(path))


def whole(path: Path) -> bool:
    """Return whether a file can be read to its end."""
    try:
        if path.suffix == ".parquet":
            table.read(path)
        elif path.suffix == ".toml":
            tomllib.loads(path.read_text())
        elif path.suffix == ".pt":
            _read_state(path)
    except (DataError, ValueError):
        return False
    return path.stat().st_size > 0


def different(folder: Path, other: Path) -> str:
    """Return the names of the files that differ between two folders, separated by commas."""
    those, its = (
        {str(path.relative_to(one)): path for path in files(one) if path.name not in CLOCKS}
        for one in (folder, other)
    )
    odd = [name for name in those.keys() & its.keys() if those[name].read_bytes() != its[name].read_bytes()]
    return ", ".join(sorted([*odd, *(those.keys() ^ its.keys())]))


def study(work: Work, kills: int, rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """Kill a command at random times and continue it; yield one row for each kill."""
    with tempfile.TemporaryDirectory() as place:
        unbroken = begun(work, Path(place) / "unbroken")
        span = finished(work.line, unbroken)
        for first in range(0, kills, IN_A_ROW):
            rows = list[dict[str, Any]]()
            folder = begun(work, Path(place) / str(first))
            for number in range(first, min(first + IN_A_ROW, kills)):
                how, after = (signal.SIGKILL, signal.SIGINT)[number % 2], float(rng.uniform(0.0, span))
                ended, fault = killed(work.line, folder, after, how)
                if not fault and (torn := broken(folder)):
                    fault = f"not whole: {torn}"
                rows.append(dict(zip(SCHEMA, (work.name, how.name, after, span, ended, fault), strict=True)))
            try:
                finished(work.line, folder)
                other = different(folder, unbroken)
                fault = f"other bytes: {other}" if other else ""
            except DataError as error:
                fault = str(error)
            rows[-1]["fault"] = rows[-1]["fault"] or fault
            yield from rows


def begun(work: Work, folder: Path) -> Path:
    """Return a folder with the inputs of a command."""
    folder.mkdir()
    for line in work.needs:
        finished(line, folder)
    return folder


def main(arguments: Sequence[str] | None = None) -> int:
    about = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.kills", description=about)
    parser.add_argument("--kills", type=int, default=100, help="over all commands")
    parser.add_argument("--only", action="append", help="a command's name; repeat for several")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--out", type=Path, help="a table of all kills")
    chosen = parser.parse_args(arguments)
    some = [work for work in works() if not chosen.only or work.name in chosen.only]
    rows = list[dict[str, Any]]()
    for place, work in enumerate(some):
        share = chosen.kills * (place + 1) // len(some) - chosen.kills * place // len(some)
        for row in study(work, share, np.random.default_rng([chosen.seed, place])):
            rows.append(row)
            print(
                f"{len(rows)}/{chosen.kills} {row['command']} {row['signal']} {row['fault'] or 'ok'}",
                flush=True,
            )
            if chosen.out:
                pl.DataFrame(rows, SCHEMA).write_parquet(chosen.out)
    lost = sum(bool(row["fault"]) for row in rows)
    print(f"{len(rows)} kills of {len(some)} commands, {lost} with something lost")
    return int(lost > 0)


if __name__ == "__main__":
    sys.exit(main())
