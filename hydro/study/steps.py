"""Steps of a study: commands with their input and output files, run only if something has changed."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path

from hydro.core.errors import HydroError

LEDGER = "steps.json"
"""Name of the file that records the steps that are done."""


@dataclass(frozen=True)
class Step:
    """One command line of a study, with its input and output files.

    Attributes:
        line: Words of the command line, without `hydro`.
        reads: Input files.
        writes: Output files.
        kind: Command and options that determine the run time, for estimates of time.  Steps of one kind take
            about the same time.
        holds: Folders into which only one running step may write.
    """

    line: tuple[str, ...]
    reads: tuple[Path, ...]
    writes: tuple[Path, ...]
    kind: tuple[str, ...] = ()
    holds: tuple[Path, ...] = ()

    @property
    def name(self) -> str:
        """The command line as the user would type it after `hydro`."""
        return shlex.join(self.line)


class Runner:
    """Runner of steps (command lines), with a file (ledger) of the hashes of their input and output files.

    A step is skipped if the same version of the command has read the same bytes before and its outputs are
    unchanged.  Every command writes the same bytes for the same inputs, so a change causes new runs only of
    the steps that it affects.
    """

    def __init__(
        self,
        folder: Path,
        execute: Callable[[Step], None],
        message: Callable[[str], None] = lambda text: None,
    ) -> None:
        """Open the ledger of a folder.

        Args:
            folder: Folder of the study.
            execute: Function that runs a step, such as `apart`.
            message: Called with lines of text on the progress of the study.
        """
        self._path = folder / LEDGER
        self._execute, self._message = execute, message
        self._digests: dict[tuple[Path, int, int], str] = {}
        self._ledger: dict[str, dict[str, str]] = {}
        self._todo: list[Step] = []
        self._took: dict[tuple[str, ...], list[float]] = {}
        self._spent: dict[str, float] = {}
        if self._path.is_file():
            try:
                self._ledger = json.loads(self._path.read_bytes())
            except (ValueError, RecursionError):
                self._message(f"hydro: {self._path}: cannot be read: every step is run again")

    def run(self, steps: Sequence[Step], workers: int = 1) -> int:
        """Run the steps that are not done, and return how many steps were run.

        Args:
            steps: Steps, each after those whose output it reads.
            workers: Number of steps that run at the same time.
        """
        return sum(anew for _, anew in self.one_by_one(steps, workers))

    def one_by_one(self, steps: Sequence[Step], workers: int = 1) -> Iterator[tuple[Step, bool]]:
        """Run the steps that are not done; yield each step when it is done, and whether it was run now.

        With more than one worker, steps run in parallel as soon as their input files are complete.  Messages
        state the running command, the time that each step took and, once a step of every command has been
        timed, the approximate remaining time.

        Args:
            steps: Steps, each after those whose output it reads.
            workers: Number of steps that run at the same time.

        Yields:
            The step; and True if it was run now, False if it had been done before.
        """
        self._todo = [step for step in steps if not self.done(step)]
        if self._todo and len(self._todo) < len(steps):
            self._message(f"{len(steps) - len(self._todo)} of {len(steps)} steps are done already")
        if workers > 1:
            yield from self._side_by_side(list(steps), workers)
            return
        for step in steps:
            if self.done(step):
                yield step, False
            else:
                self.record(step, self._timed(step))
                yield step, True

    def _side_by_side(self, waiting: list[Step], workers: int) -> Iterator[tuple[Step, bool]]:
        running: dict[Future[float], Step] = {}
        try:
            with ThreadPoolExecutor(workers) as pool:
                while waiting or running:
                    ready = _ready(waiting, running.values(), workers)
                    for step in ready:
                        waiting.remove(step)
                        if self.done(step):
                            yield step, False
                        else:
                            running[pool.submit(self._timed, step)] = step
                    if ready and len(running) < workers:
                        continue
                    for finished in wait(running, return_when=FIRST_COMPLETED).done:
                        self.record(running[finished], finished.result(), workers)
                        yield running.pop(finished), True
        finally:  # after a failure the other running steps have ended normally
            for future, step in running.items():
                if not future.cancelled() and future.exception() is None:
                    self.record(step, future.result(), workers)

    def _timed(self, step: Step) -> float:
        """Run a step and return the time that it took [s]; record its processor time."""
        self._message(f"hydro {step.name}")
        started, spent = time.perf_counter(), _processor_time()
        for path in step.writes:
            path.parent.mkdir(parents=True, exist_ok=True)
        self._execute(step)
        self._spent[step.name] = _processor_time() - spent
        return time.perf_counter() - started

    def done(self, step: Step) -> bool:
        """Return whether a step was run on its present inputs and its outputs are unchanged."""
        known = self._ledger.get(step.name)
        if known is None or not all(path.is_file() for path in (*step.reads, *step.writes)):
            return False
        return known.items() >= self._state(step).items()

    def _state(self, step: Step) -> dict[str, str]:
        """Return the version of hydro and the digests of all files of a step."""
        from importlib.metadata import version

        files = {str(path): self._digest(path) for path in (*step.reads, *step.writes)}
        return {"version": version("deep-hydro-sim")} | files

    def record(self, step: Step, seconds: float, workers: int = 1) -> None:
        """Record a step as done, write the ledger of all steps atomically, and report the progress.

        Args:
            step: The step, which has been run.
            seconds: Duration of the run [s].
            workers: Number of steps that run at the same time.
        """
        from hydro.io.files import write_bytes

        self._ledger[step.name] = self._state(step) | {"seconds": f"{seconds:.1f}"}
        if workers == 1 and step.name in self._spent:  # several steps at a time share their processor time
            self._ledger[step.name]["processor"] = f"{self._spent[step.name]:.1f}"
        write_bytes(json.dumps(self._ledger, indent=1).encode(), str(self._path))
        self._took.setdefault(step.kind or step.line[:1], []).append(seconds)
        self._todo = [other for other in self._todo if other != step]
        names = ", ".join(path.name for path in step.writes)
        self._message(f"  wrote {names} in {seconds:.1f} s{self._left(workers)}")

    def _left(self, workers: int) -> str:
        """Return the number of remaining steps and their time, estimated from steps of the same kind."""
        if not self._todo:
            return ""
        seconds = 0.0
        for step in self._todo:
            alike = self._took.get(step.kind or step.line[:1]) or [
                one for kind, some in self._took.items() if kind[0] == step.line[0] for one in some
            ]
            if not alike:
                return f"; steps left: {len(self._todo)}"
            seconds += sum(alike) / len(alike)
        return f"; steps left: {len(self._todo)}, about {_duration(seconds / workers)}"

    def _digest(self, path: Path) -> str:
        """Return the SHA-256 of a file, computed again only if the file has changed."""
        seen = path.stat()
        key = path, seen.st_mtime_ns, seen.st_size
        if key not in self._digests:
            with path.open("rb") as file:
                self._digests[key] = hashlib.file_digest(file, "sha256").hexdigest()
        return self._digests[key]


class StepFailed(HydroError):
    """Error of a step whose own process failed and has printed the reason; has the process's exit code."""

    def __init__(self, step: Step, code: int) -> None:
        """Store the step and its exit code."""
        super().__init__(f"a step has failed, see above: hydro {step.name}")
        self.exit_code = code


def _processor_time() -> float:
    """Return the processor time of this process and of its ended children [s]."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def apart(step: Step) -> None:
    """Run a step of a study, which is a command line of hydro, in its own process.

    Args:
        step: The step.

    Raises:
        StepFailed: The process returned an exit code other than 0.
    """
    code = subprocess.run([sys.executable, "-m", "hydro.cli", *step.line], check=False).returncode
    if code:
        raise StepFailed(step, code)


_BOUND = """
import ctypes, runpy, signal, sys
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
runpy.run_module("hydro.cli", run_name="__main__", alter_sys=True)
"""
"""Program that runs a command line, and that Linux ends together with its parent process."""


def captured(step: Step) -> tuple[int, str, str]:
    """Run a step of a study in its own process; return the exit code and the texts of stdout and stderr.

    On Linux, the step is killed when the calling process ends.  A surviving step would write to its folder
    while another process repeats the same step.

    Args:
        step: The step, a command line of hydro.
    """
    line = [sys.executable, "-c", _BOUND, *step.line]
    done = subprocess.run(line, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    return done.returncode, done.stdout, done.stderr


def _ready(waiting: Sequence[Step], running: Iterable[Step], workers: int) -> list[Step]:
    """Return the steps that can start now.

    Their inputs are complete, and no running step writes into the folders that they hold.

    Args:
        waiting: Steps that have not started, in order.
        running: Steps that are running.
        workers: Number of steps that may run at the same time.
    """
    busy = list(running)
    to_come = {path for step in (*waiting, *busy) for path in step.writes}
    held = {folder for step in busy for folder in step.holds}
    ready = list[Step]()
    for step in waiting:
        if to_come.isdisjoint(step.reads) and held.isdisjoint(step.holds):
            ready.append(step)
            held.update(step.holds)
    return ready[: workers - len(busy)]


def _duration(seconds: float) -> str:
    """Return a duration in words, in seconds, minutes or hours."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
