"""Folder of a study: the files of every step of `hydro explain`, which adds one effect per step.

A step is up to date if its rows of the ladder and its files exist, and their hashes match the inputs.  The
ladder is written last.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl

from hydro.core.diagnosis.findings import HEADLINE
from hydro.core.errors import DataError
from hydro.core.explanation.ladder import Step
from hydro.io import covariance, table
from hydro.io import vehicle as vehicles
from hydro.io.table import Artefact

LADDER = "ladder.parquet"
FILES = re.compile(
    r"(comparison|diagnosis)-\d+\.parquet|vehicle-\d+(\.covariance\.parquet|\.toml)"
    r"|(ladder|replay|leftover|growth|sessions|bands)\.parquet"
)
STAGE = "explain"
ENDED = "ended"
"""Parameter of `ladder.parquet`: reason why no step follows the last; absent until it is known."""
NO_FORCES = "no_forces"
"""Parameter of `sessions.parquet`: reason why forces cannot be computed and `leftover.parquet` is absent."""


@dataclass(frozen=True)
class Study:
    """Study of one vehicle and recording, whose steps are stored in a folder.

    Attributes:
        folder: Existing folder of its files.
        vehicle_text: Vehicle file as given.
        measured: Recording.
        holdout: Held-out recording, or None.
        beside: Further inputs of the steps, such as a recording before a change.
        parameters: Parameters in the footer of all tables.
    """

    folder: Path
    vehicle_text: str
    measured: Artefact
    holdout: Artefact | None
    beside: tuple[Artefact, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def done(self) -> list[Step]:
        """Return the steps whose files in the folder are up to date, from step 0 on; empty without any."""
        try:
            ladder = table.read(self.folder / LADDER, "ladder")
        except DataError:
            return []
        parameters = ladder.provenance.parameters
        ended = {name: parameters[name] for name in (ENDED, HEADLINE) if name in parameters}
        ours = self._table("ladder", ladder.frame, self.vehicle_text, **ended).provenance
        if ladder.provenance != ours:
            return []
        steps: list[Step] = []
        for number in ladder.frame["step"].unique().sort():
            try:
                step = self._read(number, ladder.frame.filter(step=number))
            except DataError:
                break
            if step is None or number != len(steps):
                break
            steps.append(step)
        return steps

    def has_ended(self, steps: Sequence[Step]) -> bool:
        """Return whether the folder records that the last of `steps` ended the study."""
        if not steps:
            return False
        ladder = table.read(self.folder / LADDER, "ladder")
        return ENDED in ladder.provenance.parameters and ladder.frame["step"].max() == steps[-1].number

    def clear(self, steps: Sequence[Step]) -> bool:
        """Remove files of other steps than `steps`, and of other studies.

        Return whether a file was removed.
        """
        keep = {name for step in steps for name in _names(step.number)} | ({LADDER} if steps else set())
        keep |= {covariance.beside(_names(step.number)[2]).name for step in steps}
        gone = [
            path for path in self.folder.iterdir() if FILES.fullmatch(path.name) and path.name not in keep
        ]
        for path in gone:
            path.unlink()
        return bool(gone)

    def save_step(self, steps: Sequence[Step]) -> None:
        """Write tables and vehicle file of the last of `steps`, and the table `ladder` of all `steps`."""
        step = steps[-1]
        comparison, diagnosis, vehicle = (self.folder / name for name in _names(step.number))
        text = self.text(step)
        vehicles.write(text, vehicle)
        table.write(self._table("comparison", step.comparison, text), comparison)
        made = self._table("diagnosis", step.diagnosis, text, chi2=[round(value, 4) for value in step.chi2])
        table.write(made, diagnosis)
        if step.estimates is not None:
            covariance.write(step.estimates, vehicle, stage=STAGE, inputs=[self.measured], vehicle_text=text)
        self._save_ladder(steps)

    def end(self, steps: Sequence[Step], why: str, headline: str) -> None:
        """Record in the folder that a study has ended.

        Args:
            steps: All steps of the study.
            why: Reason why no further step follows.
            headline: Answer of the study in one line.
        """
        self._save_ladder(steps, **{ENDED: why, HEADLINE: headline})

    def _save_ladder(self, steps: Sequence[Step], **parameters: str) -> None:
        """Write the ladder table of all steps, with further parameters in its footer."""
        ladder = pl.concat(one.ladder for one in steps)
        table.write(self._table("ladder", ladder, self.vehicle_text, **parameters), self.folder / LADDER)

    def save(self, kind: str, frame: pl.DataFrame, **parameters: object) -> None:
        """Write a table about the whole study into its folder, as `KIND.parquet`.

        Args:
            kind: Kind of table.
            frame: The table.
            parameters: Further parameters in the footer of the file.
        """
        made = self._table(kind, frame, self.vehicle_text, **parameters)
        table.write(made, self.folder / f"{kind}.parquet")

    def text(self, step: Step) -> str:
        """Return the text of the vehicle file of a step: the given file's text with the fitted values."""
        text = self.vehicle_text
        for fitted in step.tables:
            text = vehicles.set_effect(text, fitted | {"fit": self._origin})
        return text

    @property
    def _origin(self) -> dict[str, str]:
        """Origin of fitted values in the vehicle file of a step."""
        return {"data": self.measured.provenance.content, "method": STAGE}

    def _table(self, kind: str, frame: pl.DataFrame, text: str, **parameters: object) -> Artefact:
        """Return a table of the study; if its kind depends on held-out data, they are among its inputs."""
        about_both = kind in ("ladder", "replay", "sessions", "bands") and self.holdout is not None
        inputs = [self.measured, self.holdout if about_both else None, *self.beside]
        given = [one for one in inputs if one is not None]
        told = {**self.parameters, **parameters}
        return table.make(kind, frame, stage=STAGE, parameters=told, inputs=given, vehicle_text=text)

    def _read(self, number: int, ladder: pl.DataFrame) -> Step | None:
        """Read a step from its files; None if the files were made from other inputs.

        Args:
            number: Number of the step.
            ladder: Ladder table of the folder.

        Raises:
            DataError: A file is missing or damaged.
        """
        comparison, diagnosis, path = (self.folder / name for name in _names(number))
        vehicle, text = vehicles.read(path)
        compared, diagnosed = table.read(comparison, "comparison"), table.read(diagnosis, "diagnosis")
        chi2 = diagnosed.provenance.parameters.get("chi2", [])
        ours = (
            self._table("comparison", compared.frame, text),
            self._table("diagnosis", diagnosed.frame, text, chi2=chi2),
        )
        if (compared.provenance, diagnosed.provenance) != tuple(one.provenance for one in ours):
            return None
        estimates, other = covariance.read(path, vehicle)
        origin = self._origin
        fitted = [e for e in vehicle.effect if number and e.get("fit", {}).items() >= origin.items()]
        if other or (fitted and estimates is None):
            return None
        return Step(
            number,
            tuple(name for name in ladder["effect"][0].split(", ") if name),
            tuple({key: value for key, value in one.items() if key != "fit"} for one in fitted),
            vehicle,
            compared.frame,
            diagnosed.frame,
            tuple(chi2),
            ladder,
            estimates,
        )


def _names(number: int) -> tuple[str, str, str]:
    """Return the file names of a step: comparison, diagnosis, vehicle."""
    return f"comparison-{number}.parquet", f"diagnosis-{number}.parquet", f"vehicle-{number}.toml"
