"""Labels of a recording, and of each session of a data set separately, on any engine.

The noise filter is designed once for all sessions.  Each session is then read, labelled, written and removed
from memory.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import polars as pl

from hydro.core.columns import MOTION, VELOCITY
from hydro.core.distillation.labels import filter_design_of_sessions, labels, subtracted
from hydro.core.distillation.labels_of_samples import Bounds, has_nulls, labels_of_samples, unlabelled
from hydro.core.errors import DataError
from hydro.core.recording.segments import Clock, clock, gaps
from hydro.core.recording.smoothing import Design
from hydro.core.recording.supply import unknown_voltage
from hydro.io import memory, partitions, table, vehicle
from hydro.io.files import name_of
from hydro.io.partitions import Dataset, Part
from hydro.io.table import Artefact

BOUNDS = Bounds()
"""Default limits of the standard deviations of labels."""
WARM = 64
"""Number of rows with which every kernel is compiled."""


@dataclass(frozen=True)
class Labelling:
    """Settings for labelling a recording, as for `core.distillation.labels.labels`.

    Attributes:
        vehicle: Text of the vehicle file.
        acceleration: Method that smooths the motion: rts, kalman or kalman-difference.
        subtract: Effects that the label excludes: `inertia`, its added mass, or all `effects`.
        noise: Standard deviation of each velocity, six numbers [m/s, rad/s]; None to estimate it.
        limits: Maximum standard deviations of a labelled row, for recordings with nulls.
        design: Filter that all sessions share; None to design it from the recording.
        of_samples: Whether rows are labelled from samples even if the recording has no nulls.
    """

    vehicle: str
    acceleration: str = "rts"
    subtract: Literal["inertia", "effects"] = "inertia"
    noise: tuple[float, ...] | None = None
    limits: Bounds = BOUNDS
    design: Design | None = None
    of_samples: bool = False


@dataclass(frozen=True)
class Labelled:
    """Result of labelling one session of a data set.

    Attributes:
        session: Name of the session.
        notes: Notes on the session, such as gaps in time, one line each.
    """

    session: str
    notes: tuple[str, ...]


def label(source: Artefact, how: Labelling) -> tuple[Artefact, tuple[str, ...]]:
    """Return the labels of a recording as a new table with provenance, and notes on it, one line each.

    A label is the residual wrench of a row, which the known physics does not explain.

    Args:
        source: Raw table.
        how: Settings of the labels.

    Raises:
        DataError: As for `core.distillation.labels.labels`.
    """
    known, raw, sparse = vehicle.parse(how.vehicle), source.frame, has_nulls(source.frame)
    parameters = _parameters(how) | {"subtracted": subtracted(known, how.subtract)}
    if sparse or how.of_samples:
        parameters |= {
            "max_sd_velocity": how.limits.velocity,
            "max_sd_acceleration": how.limits.acceleration,
        }
    if how.of_samples and not sparse:
        frame = labels_of_samples(known, raw, noise=how.noise, subtract=how.subtract, limits=how.limits)
    else:
        frame = labels(
            known,
            raw,
            acceleration=how.acceleration,
            noise=how.noise,
            design=how.design,
            subtract=how.subtract,
            limits=how.limits,
        )
    notes = gaps(frame), unlabelled(frame, how.limits) if sparse else ""
    made = table.make(
        "labels", frame, stage="labels", parameters=parameters, inputs=[source], vehicle_text=how.vehicle
    )
    return made, tuple(filter(None, notes))


def _parameters(how: Labelling) -> dict[str, Any]:
    """Return the settings that the footer of the labels records."""
    found: dict[str, Any] = {"acceleration": how.acceleration, "subtract": how.subtract}
    if how.noise is not None:
        found["noise"] = list(how.noise)
    if how.design is not None:
        found["filter"] = {"dt": how.design.dt, "ratio": list(how.design.ratio)}
    return found


def shared(dataset: Dataset, how: Labelling) -> Labelling:
    """Return a copy of label settings, completed by the filter that all sessions of a data set must share.

    If a session has nulls, all are labelled from samples; otherwise all share one filter.  Memory holds the
    times or velocities of one session at a time.

    Args:
        dataset: The data set, one file per session.
        how: Settings of the labels.

    Raises:
        DataError: As for `core.recording.segments.segments` of a session; or the sample rates of sessions
            differ; or a session has nulls and the smoother is not `rts`.
    """
    sparse = [part for part in dataset.parts if part.nulls.intersection(MOTION)]
    if sparse:
        if how.acceleration != "rts":
            raise DataError(
                f"{name_of(sparse[0].path)}: a recording with nulls needs its smoother, so --acceleration "
                "rts; for another import the log with `hydro import --fill`"
            )
        return replace(how, of_samples=True)
    clocks = dict[str, Clock]()
    for part in dataset.parts:
        try:
            clocks[part.session] = clock(_columns(part, "session", "t"))
        except DataError as error:
            raise DataError(f"{name_of(part.path)}: {error}") from error
    paths = {part.session: part for part in dataset.parts}
    design = filter_design_of_sessions(clocks, lambda session: _columns(paths[session], *VELOCITY), how.noise)
    memory.give_back()
    return replace(how, design=design)


def _columns(part: Part, *names: str) -> pl.DataFrame:
    """Read some columns of a session."""
    try:
        return partitions.scan(part.path).select(names).collect()
    except (pl.exceptions.PolarsError, OSError) as error:
        reason = str(error).partition("\n")[0]
        raise DataError(
            f"{name_of(part.path)}: this Parquet file is damaged ({reason}): write or copy it again"
        ) from error


def label_part(part: Part, folder: Path, how: Labelling) -> Labelled:
    """Read one session of a data set, label it, and write the labels into `folder`; return name and notes.

    Args:
        part: File of the session.
        folder: Folder of the labels, which gets a folder for the session.
        how: Settings of the labels.

    Raises:
        DataError: As for `label`, with the name of the file in front.
    """
    target = partitions.place(folder, part.session)
    notes = _written(part, target, how)
    memory.give_back()
    return Labelled(part.session, notes)


def warm(part: Part, how: Labelling) -> None:
    """Compile the kernels for labels with the first rows of a session; nothing is written.

    Args:
        part: File of the session.
        how: Settings of the labels.
    """
    head = partitions.scan(part.path).head(WARM).collect()
    rows = table.make(part.kind, head, stage="warm")
    with contextlib.suppress(DataError):  # labelling the whole session reports such an error
        label(rows, how)


def _written(part: Part, target: Path, how: Labelling) -> tuple[str, ...]:
    """Write the labels of a session to `target` and return notes; all tables are released on return."""
    source = table.read_part(part)
    try:
        voltage = unknown_voltage(vehicle.parse(how.vehicle), source.frame)
        made, notes = label(source, how)
    except DataError as error:
        raise DataError(f"{name_of(part.path)}: {error}") from error
    target.parent.mkdir(parents=True, exist_ok=True)
    table.write(made, target)
    return tuple(filter(None, (voltage, *notes)))
