"""Steps of a study: commands with the files they read and write, run only where something has changed."""

from __future__ import annotations

import hashlib
import json
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

LEDGER = "steps.json"


@dataclass(frozen=True)
class Step:
    """One command line.

    Attributes:
        line: Its words, without `hydro`.
        reads: Files it depends on.
        writes: Files it makes.
    """

    line: tuple[str, ...]
    reads: tuple[Path, ...]
    writes: tuple[Path, ...]

    @property
    def name(self) -> str:
        """The command line as one would type it."""
        return shlex.join(self.line)


class Runner:
    """Runs steps and remembers, in the folder of a study, what they read and wrote by its content.

    A step is left out where the same command of the same version has read the same bytes before and what it
    wrote is still there unchanged.  Every command gives the same bytes for the same inputs, so that a change
    goes no further than it matters.
    """

    def __init__(self, folder: Path, execute: Callable[[Step], None]) -> None:
        """Open the ledger of a folder; `execute` runs a step, see `here` and `apart`."""
        self._path = folder / LEDGER
        self._execute = execute
        self._digests: dict[tuple[Path, int, int], str] = {}
        self._ledger: dict[str, dict[str, str]] = {}
        if self._path.is_file():
            try:
                self._ledger = json.loads(self._path.read_bytes())
            except ValueError:
                typer.echo(f"hydro: {self._path}: cannot be read: every step is run anew", err=True)

    def run(self, steps: Sequence[Step], workers: int = 1) -> int:
        """Run those steps that are not done; how many that were.

        With more than one worker, steps run side by side as soon as none still to be run writes what they
        read.
        """
        if workers > 1:
            return self._side_by_side(list(steps), workers)
        todo = (step for step in steps if not self._told_done(step))
        return sum(self.record(step, self._timed(step)) for step in todo)

    def _side_by_side(self, waiting: list[Step], workers: int) -> int:
        running: dict[Future[float], Step] = {}
        ran = 0
        with ThreadPoolExecutor(workers) as pool:
            while waiting or running:
                for step in _ready(waiting, running.values(), workers):
                    waiting.remove(step)
                    if not self._told_done(step):
                        running[pool.submit(self._timed, step)] = step
                for finished in wait(running, return_when=FIRST_COMPLETED).done if running else ():
                    ran += self.record(running.pop(finished), finished.result())
        return ran

    def _told_done(self, step: Step) -> bool:
        done = self.done(step)
        typer.echo(f"{'already done: ' if done else ''}hydro {step.name}", err=True)
        return done

    def _timed(self, step: Step) -> float:
        """Run a step; how long it took [s]."""
        started = time.perf_counter()
        for path in step.writes:
            path.parent.mkdir(parents=True, exist_ok=True)
        self._execute(step)
        return time.perf_counter() - started

    def done(self, step: Step) -> bool:
        """Whether a step has been run on just these inputs and its outputs are as it left them."""
        known = self._ledger.get(step.name)
        if known is None or not all(path.is_file() for path in (*step.reads, *step.writes)):
            return False
        return known == self._state(step)

    def _state(self, step: Step) -> dict[str, str]:
        """Version of hydro, and digests of all files of a step."""
        from importlib.metadata import version

        files = {str(path): self._digest(path) for path in (*step.reads, *step.writes)}
        return {"version": version("deep-hydro-sim")} | files

    def record(self, step: Step, seconds: float) -> bool:
        """Enter a step that has been run, and write the ledger, whole or not at all; True."""
        from hydro.io.files import write_bytes

        self._ledger[step.name] = self._state(step)
        write_bytes(json.dumps(self._ledger, indent=1).encode(), str(self._path))
        typer.echo(f"  {seconds:.1f} s: {', '.join(path.name for path in step.writes)}", err=True)
        return True

    def _digest(self, path: Path) -> str:
        """SHA-256 of a file; computed once as long as the file is not written again."""
        seen = path.stat()
        key = path, seen.st_mtime_ns, seen.st_size
        if key not in self._digests:
            with path.open("rb") as file:
                self._digests[key] = hashlib.file_digest(file, "sha256").hexdigest()
        return self._digests[key]


def here(root: Any) -> Callable[[Step], None]:
    """Run steps in this process, by a Click command."""
    return lambda step: root.main(list(step.line), prog_name="hydro", standalone_mode=False)


def apart(step: Step) -> None:
    """Run a step in a process of its own.

    Raises:
        typer.Exit: It failed, and has said why; with its exit code.
    """
    code = subprocess.run([sys.executable, "-m", "hydro.cli", *step.line], check=False).returncode
    if code:
        raise typer.Exit(code)


def _ready(waiting: Sequence[Step], running: Iterable[Step], workers: int) -> list[Step]:
    """Steps that may begin: no other that is still to end writes what they read."""
    busy = list(running)
    to_come = {path for step in (*waiting, *busy) for path in step.writes}
    ready = [step for step in waiting if to_come.isdisjoint(step.reads)]
    return ready[: workers - len(busy)]
