"""Studies of trainings: commands of hydro one after another, with their processor time, kept as tables."""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path


def made(words: Sequence[str | Path], out: Path) -> bool:
    """Run `hydro WORDS -o OUT` unless it is complete, and store its time next to its output.

    Args:
        words: The command and its arguments.
        out: The file or folder that it makes.

    Returns:
        Whether it was run; one that fails ends the program with its exit status.
    """
    spent = beside(out)
    if spent.exists():
        return False
    out.parent.mkdir(parents=True, exist_ok=True)
    line = [sys.executable, "-m", "hydro", *map(str, words), "-o", str(out)]
    with subprocess.Popen(line, env=os.environ | {"OMP_NUM_THREADS": "1"}) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(process.returncode)
    spent.write_text(f"{used.ru_utime:.1f} {used.ru_stime:.1f}")
    return True


def seconds(out: Path) -> float:
    """Processor time, of user and system, that making something took [s]."""
    return sum(map(float, beside(out).read_text().split()))


def beside(out: Path) -> Path:
    """Return the path of the stored time of an output."""
    return out.with_name(f"{out.name}.time")


def place(folder: Path, name: str, seed: int | str) -> Path:
    """Return the path of a training of a variant."""
    return folder / f"{name.replace(' ', '-').replace(',', '')}-{seed}"


def ranged(numbers: Sequence[float], form: str, unit: str = "") -> str:
    """Median, with its unit, least and greatest of some numbers, in a form such as `.1f`."""
    middle, least, greatest = statistics.median(numbers), min(numbers), max(numbers)
    return f"{middle:{form}}{unit} ({least:{form}} to {greatest:{form}})"


def parser(
    about: str,
    run: Callable[[argparse.Namespace], None],
    kept: Callable[[argparse.Namespace], None],
    seeds: int,
) -> tuple[argparse.ArgumentParser, argparse.ArgumentParser]:
    """Return the parser of a study that is run or kept as a table, and that of `run`; `what` is chosen."""
    whole = argparse.ArgumentParser(description=about)
    parts = whole.add_subparsers(required=True)
    runs = parts.add_parser("run")
    runs.add_argument("--first-seed", type=int, default=0)
    runs.add_argument("--seeds", type=int, default=seeds)
    runs.add_argument("-o", "--out", type=Path, required=True, help="folder of the study")
    runs.set_defaults(what=run)
    keeps = parts.add_parser("keep")
    keeps.add_argument("folder", type=Path, help="of a study")
    keeps.add_argument("--commit", required=True, help="of the code that was measured")
    keeps.set_defaults(what=kept)
    return whole, runs
