"""Steps of a study: commands with the files they read and write, run only where something has changed."""

from __future__ import annotations

import hashlib
import json
import shlex
import time
from collections.abc import Sequence
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

    def __init__(self, folder: Path, root: Any) -> None:
        """Open the ledger of a folder; `root` is the Click command that the steps are run by."""
        self._path = folder / LEDGER
        self._root = root
        self._digests: dict[tuple[Path, int, int], str] = {}
        self._ledger: dict[str, dict[str, str]] = {}
        if self._path.is_file():
            try:
                self._ledger = json.loads(self._path.read_bytes())
            except ValueError:
                typer.echo(f"hydro: {self._path}: cannot be read: every step is run anew", err=True)

    def run(self, steps: Sequence[Step]) -> int:
        """Run those steps that are not done; how many that were."""
        ran = 0
        for number, step in enumerate(steps, 1):
            where = f"[{number}/{len(steps)}]"
            if self.done(step):
                typer.echo(f"{where} already done: hydro {step.name}", err=True)
                continue
            typer.echo(f"{where} hydro {step.name}", err=True)
            started = time.perf_counter()
            for path in step.writes:
                path.parent.mkdir(parents=True, exist_ok=True)
            self._root.main(list(step.line), prog_name="hydro", standalone_mode=False)
            typer.echo(f"  {time.perf_counter() - started:.1f} s", err=True)
            self.record(step)
            ran += 1
        return ran

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

    def record(self, step: Step) -> None:
        """Enter a step that has been run, and write the ledger, whole or not at all."""
        from hydro.io.files import write_bytes

        self._ledger[step.name] = self._state(step)
        write_bytes(json.dumps(self._ledger, indent=1).encode(), str(self._path))

    def _digest(self, path: Path) -> str:
        """SHA-256 of a file; computed once as long as the file is not written again."""
        seen = path.stat()
        key = path, seen.st_mtime_ns, seen.st_size
        if key not in self._digests:
            with path.open("rb") as file:
                self._digests[key] = hashlib.file_digest(file, "sha256").hexdigest()
        return self._digests[key]
