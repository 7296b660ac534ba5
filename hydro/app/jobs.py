"""Long work of the workbench, each a function that the worker process of a tab runs.

The last argument of each function, `report`, receives a kind of message and its content.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl

from hydro.app import opening
from hydro.app.opening import Craft, Further, Opened, Proposed
from hydro.app.worker import Report
from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.pipeline import hull_of
from hydro.core.diagnosis.provisional import Provisional
from hydro.core.errors import DataError
from hydro.core.evaluation.added_force import added_force
from hydro.core.evaluation.compare import compare as measure
from hydro.core.evaluation.place_times import place_times
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.explanation.explain import next_step
from hydro.core.explanation.ladder import Step
from hydro.core.explanation.trials import Recordings
from hydro.core.identification.fit import fit as estimate
from hydro.core.progress import Progress
from hydro.core.residual.hull import Hull
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Compared:
    """Result of a comparison of a vehicle with the recording.

    Attributes:
        table: Comparison table.
        places: For each worst place, its stretches of rows, (K, 2): first row, and row after the last.
    """

    table: pl.DataFrame
    places: Mapping[str, Rows]


@dataclass(frozen=True)
class Fitted:
    """Result of a fit of effects to the recording.

    Attributes:
        vehicle: Vehicle with the estimates.
        tables: `[[effect]]` tables of the fitted effects, with standard errors.
        estimates: Values with their covariance.
        chi2: Mean squared residual in units of the noise variance.
        warnings: Sentences on values that are not determined or not plausible.
    """

    vehicle: Vehicle
    tables: tuple[dict[str, Any], ...]
    estimates: Estimates
    chi2: float
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Stepped:
    """Result of a request for the next step of a study.

    Attributes:
        step: The step; None if no candidate effect predicts better.
    """

    step: Step | None


class _Kept:
    """Prepared recordings of the present study, which all its steps share.

    Attributes:
        key: Inputs from which the recordings were prepared.
        recordings: The recordings; None before the first step.
    """

    key: tuple[Any, ...] | None = None
    recordings: Recordings | None = None


def propose(
    paths: Sequence[str], given: Mapping[str, str], thrusters: int | None, report: Report
) -> Proposed:
    """Return the proposed map of logs.

    Args:
        paths: The files of one dive.
        given: Blocks that the user wrote, by name, each as one text.
        thrusters: Number of thrusters of the vehicle, if known.
        report: Receives progress.
    """
    return opening.propose_map(paths, given, thrusters, _progress(report))


def correct(paths: Sequence[str], before: Proposed, blocks: Mapping[str, Any], report: Report) -> Proposed:
    """Return a new proposal of a map with blocks that the user has changed.

    Args:
        paths: The files of one dive.
        before: The map before; not changed.
        blocks: All blocks of the new map, by name.
        report: Receives progress.
    """
    return opening.correct_map(paths, before, blocks, _progress(report))


def open_recording(
    paths: Sequence[str],
    map_: str,
    craft: Craft,
    correct: bool,
    holdout: str,
    before: str,
    report: Report,
) -> Opened:
    """Return a recording that was imported, cleaned and audited for a vehicle.

    Args:
        paths: A raw table, or the logs of one dive.
        map_: Path of the map; empty for a raw table.
        craft: The vehicle file.
        correct: Accept the directions and the order of the thrusters that the audit states.
        holdout: Path of the held-out recording; empty without one.
        before: Path of the recording before a change; empty without one.
        report: Receives progress.
    """
    return opening.open_recording(
        paths, map_, craft, _progress(report), correct=correct, holdout=holdout, before=before
    )


def compare(opened: Opened, vehicle: Vehicle, report: Report) -> Compared:
    """Return the errors of a vehicle on a recording, with noise floor and the places where the vehicle fails.

    Args:
        opened: The recording.
        vehicle: The vehicle.
        report: Receives progress.
    """
    log = opened.log
    table = measure(vehicle, log.raw, record=log.observed, progress=_progress(report))
    return Compared(table, place_times(table, vehicle, log.record, log.sessions))


def add_step(opened: Opened, craft: Craft, steps: Sequence[Step], wanted: str, report: Report) -> Stepped:
    """Return the next step of the study, as `hydro explain` makes it.

    Args:
        opened: The recording.
        craft: Vehicle file of step 0.
        steps: Steps so far; the first step compares and diagnoses the file.
        wanted: Effect of the finding to add, or `explain.BEST`.
        report: Receives progress, and the provisional best candidate of the first diagnosis.
    """
    recordings = _recordings(opened, craft, report)

    def provisional(best: Provisional) -> None:
        report("provisional", best)

    told = None if steps else provisional
    return Stepped(next_step(steps, craft.vehicle, recordings, wanted, _progress(report), provisional=told))


def fit(
    opened: Opened, vehicle: Vehicle, wanted: Sequence[str], held: Sequence[str], report: Report
) -> Fitted:
    """Return effects of a vehicle, fitted to the recording as `hydro fit` does.

    Args:
        opened: The recording.
        vehicle: The vehicle.
        wanted: Names of the effects.
        held: Parameters to keep at their values, each `effect.parameter`.
        report: Receives progress.
    """
    found = estimate(holding(vehicle, held), opened.source.frame, list(wanted), progress=_progress(report))
    return Fitted(
        holding(found.vehicle, held, instead=vehicle),
        tuple(found.tables()),
        found.estimates(),
        found.chi2,
        tuple(found.warnings),
    )


def force(opened: Opened, vehicle: Vehicle, without: Vehicle, report: Report) -> Array:
    """Return the force of an effect on the vehicle along the recorded motion, (N, 6) [N, N m].

    Args:
        opened: The recording.
        vehicle: Vehicle with the effect.
        without: The same vehicle without the effect.
        report: Receives progress.
    """
    report("progress", ("force of the effect", 0.5))
    record = opened.log.record
    motion = Motion.of(record)
    return np.asarray(added_force(vehicle, without, record, motion.eta, np.ascontiguousarray(motion.nu)))


def save_study(
    opened: Opened, craft: Craft, steps: Sequence[Step], wanted: Sequence[str], folder: str, report: Report
) -> str:
    """Write the files of a study's steps into a folder, as `hydro explain` does, and return the headline.

    Args:
        opened: The recording.
        craft: Vehicle file of step 0.
        steps: The steps.
        wanted: Effects that the user asked the steps to add, for the footers of the files.
        folder: Existing folder.
        report: Receives progress.

    Raises:
        DataError: A file cannot be written.
    """
    from hydro.core.explanation.explain import ending
    from hydro.core.explanation.ladder import best
    from hydro.core.explanation.status import study_status
    from hydro.io.lock import alone
    from hydro.io.study import Study
    from hydro.study.explained import save_bands, save_recorded

    log, holdout, before = opened.log, opened.holdout, opened.before
    told: dict[str, Any] = {"add": list(wanted)} if wanted else {}
    told |= {"cleaning": list(log.changes)} if log.changes else {}
    hull = None
    if holdout is not None or before is not None:
        recordings = _recordings(opened, craft, report)
        told, hull = told | _told_beside(opened, recordings), recordings.hull
    study = Study(
        Path(folder),
        craft.text,
        opened.source,
        None if holdout is None else holdout.source,
        () if before is None else (before.source,),
        told,
    )
    chosen = best(steps)
    headline = study_status(steps, chosen, log.record.dt, hull).headline
    with alone(Path(folder)):
        study.clear([])
        for count in range(1, len(steps) + 1):
            report("progress", (f"step {count - 1}", 0.5 * count / len(steps)))
            study.save_step(steps[:count])
        study.end(steps, ending(steps, wanted), headline)
        report("progress", ("replays and forces", 0.6))
        save_recorded(study, {one.number: one.vehicle for one in (steps[0], chosen)}, log)
        report("progress", ("bands", 0.8))
        save_bands(study, chosen)
    return headline


def write_report(folder: str, destination: str, report: Report) -> str:
    """Write the report of a study folder as one HTML page at `destination`, and return its path."""
    from hydro.io.files import write_bytes
    from hydro.report import sources
    from hydro.report.page import render

    report("progress", ("report", 0.5))
    write_bytes(render(sources.gather([folder])).encode(), destination)
    return destination


def holding(vehicle: Vehicle, held: Sequence[str], *, instead: Vehicle | None = None) -> Vehicle:
    """Return a copy of a vehicle in which parameters are marked as known, so that a fit does not change them.

    Args:
        vehicle: The vehicle.
        held: Parameters, each `effect.parameter`.
        instead: Undo the marking: restore the marks of `held` from this vehicle.
    """
    tables = list[dict[str, Any]]()
    before = {} if instead is None else {table["name"]: table.get("known") for table in instead.effect}
    for table in vehicle.effect:
        made = dict(table)
        own = [one.partition(".")[2] for one in held if one.partition(".")[0] == table["name"]]
        if instead is not None and own:
            made.pop("known", None)
            made |= {"known": before[table["name"]]} if before.get(table["name"]) is not None else {}
        elif own and made.get("known") is not True:
            made["known"] = sorted({*own, *(made.get("known") or ())})
        tables.append(made)
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def _told_beside(opened: Opened, recordings: Recordings) -> dict[str, Any]:
    """Return the parameters that `hydro explain` writes about held-out and earlier recordings."""
    from hydro.report.change import parameters_of

    told: dict[str, Any] = {}
    if recordings.holdout is not None and recordings.holdout.changes:
        told["cleaning_holdout"] = list(recordings.holdout.changes)
    if opened.before is not None and recordings.hull is not None:
        told |= parameters_of({"recording": Path(opened.before.path).stem}, recordings.hull)
    return told


def _recordings(opened: Opened, craft: Craft, report: Report) -> Recordings:
    """Return the recordings of a study with the hull-force model, prepared once for all its steps."""
    given = opened.source, *(None if one is None else one.source for one in (opened.holdout, opened.before))
    key = (
        *(None if one is None else one.provenance.content for one in given),
        craft.text,
        opened.log.misdirected,
    )
    if _Kept.recordings is None or _Kept.key != key:
        hull = None if opened.before is None else _hull(opened.before, craft, report)
        holdout = None if opened.holdout is None else opened.holdout.source.frame
        made = Recordings.of(craft.vehicle, opened.source.frame, holdout, hull)
        if not opened.log.misdirected and made.log.misdirected:  # the page accepted the audit's directions
            made = replace(made, log=made.log.as_audited())
        if hull is None:
            made.log.require_directions(Path(craft.path).name)
        _Kept.key, _Kept.recordings = key, made
    return _Kept.recordings


def _hull(before: Further, craft: Craft, report: Report) -> Hull:
    """Return the hull-force model, fitted to a recording before a change.

    Raises:
        DataError: The recording does not fit the vehicle, or is too short.
    """
    report("progress", ("hull force before the change", 0.0))
    try:
        return hull_of(craft.vehicle, before.source.frame)
    except DataError as error:
        raise DataError(f"{Path(before.path).name}: {error}") from error


def _progress(report: Report) -> Progress:
    """Return a callback that sends a description of the work and the share done as one message."""
    return lambda words, share: report("progress", (words, share))
