"""Separate diagnosis of each session of a data set."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hydro.core.diagnosis.baseline import refit, stable_start
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.pipeline import diagnose_log
from hydro.core.errors import DataError
from hydro.core.recording.segments import sample_time
from hydro.io import covariance, memory, partitions, table, vehicle
from hydro.io.files import name_of
from hydro.io.partitions import Part

if TYPE_CHECKING:
    import polars as pl

    from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Diagnosed:
    """Result of the diagnosis of one session of a data set.

    Attributes:
        session: Name of the session.
        findings: Diagnosis table; None if the session could not be diagnosed.
        headline: Headline of the diagnosis.
        error: Reason why the session could not be diagnosed; empty otherwise.
    """

    session: str
    findings: pl.DataFrame | None = None
    headline: str = ""
    error: str = ""


def diagnose_part(part: Part, folder: Path, start: Vehicle, text: str, corrected: bool = False) -> Diagnosed:
    """Diagnose one session, write the findings and their covariance into a folder, and return the result.

    An error in a session becomes part of its result, so that the other sessions are diagnosed.

    Args:
        part: File of the session.
        folder: Folder of the results, which gets a folder for each session.
        start: The vehicle, with its known values marked.
        text: Text of the vehicle's file.
        corrected: Whether a session whose thrusters contradict the file is diagnosed with the directions and
            the column order that the thruster audit finds; otherwise the contradiction is the only finding.
    """
    try:
        findings, headline = _written(part, partitions.place(folder, part.session), start, text, corrected)
    except DataError as error:
        where, words = name_of(part.path), str(error)
        return Diagnosed(part.session, error=words if words.startswith(where) else f"{where}: {words}")
    memory.give_back()
    return Diagnosed(part.session, findings, headline)


def _written(
    part: Part, target: Path, start: Vehicle, text: str, corrected: bool
) -> tuple[pl.DataFrame, str]:
    """Diagnose a session, write the findings to `target`, and return them with their headline.

    Args:
        part: The session.
        target: File of the findings.
        start: The vehicle, with its known values marked.
        text: Text of its file.
        corrected: Continue with the thrusters as the audit states them.
    """
    source = table.read_part(part)
    known = vehicle.without_errors_from(start, source.provenance.content)
    log = preprocess(known, source.frame)
    found = diagnose_log(known, log.as_audited() if corrected else log)
    changes = {"cleaning": list(log.changes)} if log.changes else {}
    made = table.make(
        "diagnosis",
        found.frame(),
        stage="diagnose",
        parameters=found.summary | changes,
        inputs=[source],
        vehicle_text=text,
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    table.write(made, target)
    if found.estimates is not None:
        covariance.write(found.estimates, target, stage="diagnose", inputs=[source], vehicle_text=text)
    return made.frame, found.headline


def warm(part: Part, start: Vehicle) -> None:
    """Compile the kernels of a diagnosis by diagnosing the first rows of a session; nothing is written.

    Args:
        part: File of the session.
        start: The vehicle.
    """
    rows = partitions.scan(part.path)
    with contextlib.suppress(DataError):  # the diagnosis of the whole session reports such an error
        dt = sample_time(rows.select("session", "t").head(FEW).collect())
        head = table.conform(part.kind, rows.head(round(WARM / dt)).collect())
        log = preprocess(start, head)
        begun, problem = stable_start(start, log)
        refit(start, log, problem, begun)


FEW, WARM = 100, 40.0
"""Number of rows from which the sample time is estimated, and duration that is enough for a fit [s]."""
