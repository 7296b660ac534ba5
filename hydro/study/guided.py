"""Steps of `hydro start`, and a shell script that repeats them."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hydro.study.steps import Step


@dataclass(frozen=True)
class Places:
    """Paths of the files of a guided study, as `hydro start` makes it.

    Attributes:
        folder: Folder of the study.
        map: The map of the log; None where the recording is a raw table.
        vehicle: The vehicle file.
        recording: The raw table.
    """

    folder: Path
    map: Path | None
    vehicle: Path
    recording: Path

    @property
    def picture(self) -> Path:
        """Path of the picture of the recording, whether it exists or not."""
        return self.folder / "recording.png"

    @property
    def study(self) -> Path:
        """Path of the folder that `hydro explain` writes, whether it exists or not."""
        return self.folder / "study"

    @property
    def report(self) -> Path:
        """Path of the HTML report in the folder of the study, whether it exists or not."""
        return self.folder / "report.html"

    @property
    def explained(self) -> tuple[Path, ...]:
        """Paths of the inputs of `hydro explain`: the vehicle file and all files of the recording."""
        parts = sorted(each for each in self.recording.rglob("*") if each.is_file())
        return (self.vehicle, *(parts or [self.recording]))

    @property
    def script(self) -> Path:
        """Path of the shell script with all commands, whether it exists or not."""
        return self.folder / "commands.sh"


def imported(places: Places, logs: Sequence[str], files: Sequence[Path], reading: Sequence[str]) -> Step:
    """Return the step, not yet run, that imports the logs as the raw table of the study.

    Args:
        places: Paths of the files of the study.
        logs: Paths of the logs as the user gave them.
        files: All files of the logs, the inputs of the step.
        reading: Further options of `hydro import`.
    """
    line = ["import", *logs, "--map", str(places.map), "--vehicle", str(places.vehicle), *reading]
    reads = (*files, *([places.map] if places.map is not None else []), places.vehicle)
    return Step((*line, "-o", str(places.recording)), reads, (places.recording,))


def audited(places: Places) -> Step:
    """Return the step, not yet run, that audits the thrusters with the recording.

    Args:
        places: Paths of the files of the study.
    """
    line = ("check", str(places.vehicle), str(places.recording))
    return Step(line, places.explained, ())


def explained(places: Places, *, corrected: bool) -> Step:
    """Return the step, not yet run, that searches for missing effects by `hydro explain`.

    Args:
        places: Paths of the files of the study.
        corrected: Whether the directions and the order of the thrusters that the audit found replace those of
            the vehicle file.
    """
    files = (places.vehicle, places.recording)
    more = ["--correct-thrusters"] if corrected else []
    written = tuple(places.study / f"{name}.parquet" for name in ("ladder", "replay", "sessions"))
    return Step(("explain", *map(str, files), *more, "-o", str(places.study)), places.explained, written)


def reported(places: Places) -> Step:
    """Return the step, not yet run, that writes the HTML report of the study.

    Args:
        places: Paths of the files of the study.
    """
    line = ("report", str(places.study), "-o", str(places.report))
    return Step(line, explained(places, corrected=False).writes, (places.report,))


def script(steps: Sequence[Step], folder: Path, again: Sequence[str]) -> str:
    """Return the text of a shell script that runs the commands of given steps.

    Args:
        steps: The steps, in order.
        folder: The folder in which they were run.
        again: Arguments of a `hydro start` that gives the same result without questions.
    """
    lines = [
        "#!/bin/sh",
        "# The commands of `hydro start`. Map and vehicle file may be edited before they are run again.",
        f"# The same without questions: hydro {shlex.join(again)}",
        "set -e",
        f"cd {shlex.quote(str(folder))}",
    ]
    for step in steps:
        line = f"hydro {step.name}"
        if step.line[0] == "check":
            line += " || test $? -eq 1  # 1: the audit contradicts the file"
        elif step.line[0] == "vehicle":
            line = f"test -e {shlex.quote(str(step.writes[0]))} || {line}"
        lines.append(line)
    return "\n".join(lines) + "\n"
