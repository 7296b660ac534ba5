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
    """Run `hydro WORDS -o OUT` unless the output is complete, and store its processor time next to it.

    If the command fails, the program ends with its exit status.

    Args:
        words: The command and its arguments.
        out: The file or folder that the command makes.

    Returns:
        Whether the command was run.
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
    """Return the processor time, of user and system, of the command that made an output [s]."""
    return sum(map(float, beside(out).read_text().split()))


def beside(out: Path) -> Path:
    """Return the path of the stored time of an output."""
    return out.with_name(f"{out.name}.time")


def place(folder: Path, name: str, seed: int | str) -> Path:
    """Return the path of a training: the folder's entry for a variant and a seed."""
    return folder / f"{name.replace(' ', '-').replace(',', '')}-{seed}"


def ranged(numbers: Sequence[float], form: str, unit: str = "") -> str:
    """Return median, least and greatest of numbers as text, in a format such as `.1f`, with a unit."""
    middle, least, greatest = statistics.median(numbers), min(numbers), max(numbers)
    return f"{middle:{form}}{unit} ({least:{form}} to {greatest:{form}})"


def parser(
    about: str,
    run: Callable[[argparse.Namespace], None],
    kept: Callable[[argparse.Namespace], None],
    seeds: int,
) -> tuple[argparse.ArgumentParser, argparse.ArgumentParser]:
    """Return the parser of a study with the subcommands `run` and `keep`, and the parser of `run`.

    Args:
        about: Description of the program.
        run: Function of the subcommand `run`.
        kept: Function of the subcommand `keep`.
        seeds: Default number of seeds.
    """
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
