"""Commands of hydro as processes of their own, one after another, and the processor time that each takes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path


def made(words: Sequence[str | Path], out: Path) -> bool:
    """Run `hydro WORDS -o OUT` where it has not been run to its end, and keep its time beside what it makes.

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
    """Where the time of what is made stands."""
    return out.with_name(f"{out.name}.time")
