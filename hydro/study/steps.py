"""Steps of a study: commands with the files they read and write, run only where something has changed."""

from __future__ import annotations

import hashlib
import json
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


@dataclass(frozen=True)
class Step:
    """One command line.

    Attributes:
        line: Its words, without `hydro`.
        reads: Files it depends on.
        writes: Files it makes.
        kind: Steps of one kind take about as long: the command, and what else matters, such as a model.
        holds: Folders that it writes into and that no other may meanwhile.
    """

    line: tuple[str, ...]
    reads: tuple[Path, ...]
    writes: tuple[Path, ...]
    kind: tuple[str, ...] = ()
    holds: tuple[Path, ...] = ()

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

    def __init__(
        self,
        folder: Path,
        execute: Callable[[Step], None],
        message: Callable[[str], None] = lambda text: None,
    ) -> None:
        """Open the ledger of a folder.

        Args:
            folder: Of the study.
            execute: Runs a step, such as `apart`.
            message: Hears in lines of text how far the study is.
        """
        self._path = folder / LEDGER
        self._execute, self._message = execute, message
        self._digests: dict[tuple[Path, int, int], str] = {}
        self._ledger: dict[str, dict[str, str]] = {}
        self._todo: list[Step] = []
        self._took: dict[tuple[str, ...], list[float]] = {}
        if self._path.is_file():
            try:
                self._ledger = json.loads(self._path.read_bytes())
            except (ValueError, RecursionError):
                self._message(f"hydro: {self._path}: cannot be read: every step is run again")

    def run(self, steps: Sequence[Step], workers: int = 1) -> int:
        """Run those steps that are not done; how many that were."""
        return sum(anew for _, anew in self.one_by_one(steps, workers))

    def one_by_one(self, steps: Sequence[Step], workers: int = 1) -> Iterator[tuple[Step, bool]]:
        """Run those steps that are not done; every step as soon as it is, and whether it was run now.

        With more than one worker, steps run side by side as soon as none still to be run writes what they
        read. Messages tell what is run, what each step took and, once a step of every command has been
        timed, about how long the others will take.
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
        finally:  # where one has failed, the others have run to their end
            for future, step in running.items():
                if not future.cancelled() and future.exception() is None:
                    self.record(step, future.result(), workers)

    def _timed(self, step: Step) -> float:
        """Run a step; how long it took [s]."""
        self._message(f"hydro {step.name}")
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
        return known.items() >= self._state(step).items()

    def _state(self, step: Step) -> dict[str, str]:
        """Version of hydro, and digests of all files of a step."""
        from importlib.metadata import version

        files = {str(path): self._digest(path) for path in (*step.reads, *step.writes)}
        return {"version": version("deep-hydro-sim")} | files

    def record(self, step: Step, seconds: float, workers: int = 1) -> None:
        """Enter a step that has been run, write the ledger, whole or not at all, and tell how far we are."""
        from hydro.io.files import write_bytes

        self._ledger[step.name] = self._state(step) | {"seconds": f"{seconds:.1f}"}
        write_bytes(json.dumps(self._ledger, indent=1).encode(), str(self._path))
        self._took.setdefault(step.kind or step.line[:1], []).append(seconds)
        self._todo = [other for other in self._todo if other != step]
        names = ", ".join(path.name for path in step.writes)
        self._message(f"  {seconds:.1f} s: {names}{self._left(workers)}")

    def _left(self, workers: int) -> str:
        """What there is still to do and how long that takes, by steps of the same kind, else command."""
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
        return f"; steps left: {len(self._todo)}, some {_duration(seconds / workers)}"

    def _digest(self, path: Path) -> str:
        """SHA-256 of a file; computed once as long as the file is not written again."""
        seen = path.stat()
        key = path, seen.st_mtime_ns, seen.st_size
        if key not in self._digests:
            with path.open("rb") as file:
                self._digests[key] = hashlib.file_digest(file, "sha256").hexdigest()
        return self._digests[key]


class StepFailed(HydroError):
    """A step in a process of its own has failed, and has said why; with its exit code."""

    def __init__(self, step: Step, code: int) -> None:
        """Name the step that ended with `code`."""
        super().__init__(f"a step has failed, see above: hydro {step.name}")
        self.exit_code = code


def apart(step: Step) -> None:
    """Run a step in a process of its own.

    Raises:
        StepFailed: It failed.
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
"""A command line that ends with the process which has begun it, however that ends."""


def captured(step: Step) -> tuple[int, str, str]:
    """Run a step in a process of its own; its exit code, and what it wrote to stdout and stderr.

    It does not outlive this process: the step is run again elsewhere then, and would find its folder in use.
    """
    line = [sys.executable, "-c", _BOUND, *step.line]
    done = subprocess.run(line, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    return done.returncode, done.stdout, done.stderr


def _ready(waiting: Sequence[Step], running: Iterable[Step], workers: int) -> list[Step]:
    """Steps that may begin: no other that is still to end writes what they read, or holds their folders."""
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
    """A duration for a person, in the unit that suits it."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
