"""Artefacts of a report, from the folder of a study or from single files, sorted by kind."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import polars as pl

from hydro.core.columns import VELOCITY
from hydro.core.errors import DataError
from hydro.io import table
from hydro.io.files import explained
from hydro.io.table import Artefact

REPORTED_KINDS = (
    "comparison", "diagnosis", "ladder", "replay", "metrics", "leftover", "growth", "sessions", "bands",
)  # fmt: skip
"""Kinds of table that a report can show."""
NAMES = (*REPORTED_KINDS, "evaluation", "errors", "ranking", "minutes", "conditioning")
"""Stems of file names in the folder of a study, in the order of the page."""
SINGLE = ("ladder", "leftover", "growth", "sessions", "bands")
"""Kinds of table that a study has once, not once per step."""
STUDY = re.compile(rf"({'|'.join(NAMES)})(-\d+)?\.parquet")
"""Names of files that a report reads from a folder."""


@dataclass(frozen=True)
class Named:
    """Artefact (table with provenance) together with the file name that the user gave for it.

    Attributes:
        name: The file name.
        artefact: The artefact.
    """

    name: str
    artefact: Artefact

    @property
    def frame(self) -> pl.DataFrame:
        """Table of the artefact."""
        return self.artefact.frame


@dataclass(frozen=True)
class Sources:
    """Artefacts (tables with provenance) of a report, sorted by kind.

    Attributes:
        comparisons: Comparisons, in the order of a study's steps.
        diagnoses: Diagnoses, in the order of a study's steps.
        ladder: Errors of the steps of a study; None without.
        replays: Recorded and simulated motions.
        metrics: Errors.
        leftover: Unexplained forces; None without.
        growth: Powers of velocity by which unexplained forces grow; None without.
        sessions: List of the sessions; None without.
        bands: 95 % intervals of predictions; None without.
    """

    comparisons: tuple[Named, ...] = ()
    diagnoses: tuple[Named, ...] = ()
    ladder: Named | None = None
    replays: tuple[Named, ...] = ()
    metrics: tuple[Named, ...] = ()
    leftover: Named | None = None
    growth: Named | None = None
    sessions: Named | None = None
    bands: Named | None = None

    @property
    def everything(self) -> tuple[Named, ...]:
        """All artefacts, in the order of the report."""
        single = (self.ladder, self.leftover, self.growth, self.sessions, self.bands)
        found = [one for one in single if one is not None]
        return (*self.comparisons, *self.diagnoses, *found, *self.replays, *self.metrics)

    def vehicle_text(self) -> str | None:
        """Return the text of the vehicle file of the first step; None if no artefact has one."""
        return next((text for one in self.everything if (text := one.artefact.provenance.vehicle)), None)


def gather(places: Sequence[str | Path | BinaryIO]) -> Sources:
    """Return the artefacts of a report, read from folders of studies, single files and streams.

    Args:
        places: Folders, Parquet files and binary streams.

    Raises:
        DataError: A folder has nothing to report on, a file is of another kind or broken, two studies are
            given, or a comparison is of a recording without velocity.
    """
    found = [one for place in places for one in _read(place)]
    for one in found:
        if one.artefact.kind == "comparison" and not (one.artefact.frame["axis"] == VELOCITY[0]).any():
            raise DataError(
                f"{one.name}: its recording lacks velocities, which the page needs; see `hydro show`"
            )
    of = {kind: tuple(one for one in found if one.artefact.kind == kind) for kind in REPORTED_KINDS}
    single = {kind: _single(kind, of[kind]) for kind in SINGLE}
    return Sources(of["comparison"], of["diagnosis"], replays=of["replay"], metrics=of["metrics"], **single)


def _single(kind: str, found: Sequence[Named]) -> Named | None:
    """Return the table of a kind that a report shows once; None without one.

    Raises:
        DataError: There are two.
    """
    if len(found) > 1:
        raise DataError(f"{found[1].name}: the {kind} of a second study; report on one at a time")
    return found[0] if found else None


def _read(place: str | Path | BinaryIO) -> list[Named]:
    """Read the artefacts of one folder, file or stream."""
    if not isinstance(place, str | Path):
        return [Named("stdin", table.read(place, REPORTED_KINDS))]
    path = Path(place)
    if not path.is_dir():
        return [Named(str(place), table.read(path, REPORTED_KINDS))]
    try:
        names = sorted((one.name for one in path.iterdir() if STUDY.fullmatch(one.name)), key=_step)
    except OSError as error:
        raise explained(str(path), error) from error
    if not names:
        raise DataError(f"{path}: no comparison, diagnosis, ladder, replay or metrics in this folder")
    return [Named(name, table.read(path / name, REPORTED_KINDS)) for name in names]


def _step(name: str) -> tuple[int, int]:
    """Return the key for sorting: kinds in the order of the page, `diagnosis-2` before `diagnosis-10`."""
    kind, _, number = name.removesuffix(".parquet").partition("-")
    return NAMES.index(kind), int(number or 0)
