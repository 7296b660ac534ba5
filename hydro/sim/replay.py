"""Fly recorded commands again in MuJoCo, open loop, and measure how far every variant strays from the recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.allocation import substep_thrusts
from hydro.core.errors import DataError, UsageError
from hydro.core.segments import resumes, sample_time, segments
from hydro.core.smoothing import Design
from hydro.core.vehicle import Vehicle
from hydro.sim.network import TrainedModel
from hydro.sim.student import Physics, Student, multiple

Array = NDArray[np.float64]
Bounds = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

POSE = ("x", "y", "z", "phi", "theta", "psi")
VELOCITY = ("u", "v", "w", "p", "q", "r")
UNITS = ("m/s",) * 3 + ("rad/s",) * 3
MEASURED = "measured"

PAPER_NAMES = {"mlp": "MJ1", "resmlp": "MJ2", "multihead": "MJ3", "physfeat": "MJ4"}
"""The paper's names of its plug-in variants (section V-B), by model."""


@dataclass(frozen=True)
class Variant:
    """One way to fly.

    Attributes:
        name: Name in the tables.
        model: Name of the residual model, or `none`.
        network: The residual model itself.
        added_mass: Whether M_A is there where no network is; with one it always is.
    """

    name: str
    model: str = "none"
    network: TrainedModel | None = None
    added_mass: bool = False


BASELINES = (Variant("MJ0"), Variant("MJ0+M_A", added_mass=True))
"""MuJoCo with restoring forces and thrusters alone (C_RB is native), and with M_A in its mass matrix besides.

C_A belongs to what a residual model brings (paper eq. 6), so the second baseline is what flies where its network is silent."""


def variants(models: Sequence[TrainedModel] = (), names: Sequence[str] | None = None) -> list[Variant]:
    """The two baselines and one variant per model, under the paper's name where it has one.

    Args:
        models: Trained models.
        names: Which variants, in this order; all by default.

    Raises:
        UsageError: Two models would have one name, or a name has no variant.
    """
    flying = [Variant(PAPER_NAMES.get(model.name, model.name), model.name, model) for model in models]
    known = {variant.name: variant for variant in (*BASELINES, *flying)}
    if len(known) < len(BASELINES) + len(flying):
        raise UsageError("two models of one kind cannot be told apart in one replay; replay them one by one")
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise UsageError(
            f"no variant is called {unknown[0]!r}: there are {', '.join(known)}; MJ1 to MJ4 need a model"
        )
    return [known[name] for name in names or known]


def replay(
    raw: pl.DataFrame,
    vehicle: Vehicle,
    flown: Sequence[Variant] = BASELINES,
    *,
    design: Design | None = None,
    physics: Physics | None = None,
    dataset: str = "recording",
    threads: int = 1,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Replay every session, and after every gap anew, from its first row's state under its recorded commands.

    Args:
        raw: Raw table.
        vehicle: The vehicle file it was recorded with.
        flown: What to fly, see `variants`.
        design: Filter for the online acceleration; by default one that trusts every sample.
        physics: Steps and integrator; the paper's 500 Hz and 25 Hz by default.
        dataset: Name of the recording in the metrics.
        threads: Threads that share the segments.
        folder: Folder of the vehicle file, where a hull mesh is looked for.
        progress: Called with a variant's name, rows flown and rows in all.

    Returns:
        Series (the columns of `schemas/replay.json`, the recording as variant `measured`; a diverged flight ends where it
        does) and metrics (those of `schemas/metrics.json`): `rmse` of every axis, and `diverged`, the time
        in the first segment that diverged, where one did.

    Raises:
        DataError: The table does not fit the vehicle.
        UsageError: The log's sample time is no multiple of the physics step.
    """
    physics = physics or Physics()
    commands = _commands(raw, vehicle)
    bounds, dt = segments(raw), sample_time(raw)
    substeps = multiple(dt, physics.timestep, "the log's sample time")
    thrusts = [
        substep_thrusts(vehicle, commands[start:stop], dt, substeps, settled=bool(settled))
        for (start, stop), settled in zip(bounds, resumes(raw, bounds), strict=True)
    ]
    measured = raw.select(pl.col(*POSE, *VELOCITY).cast(pl.Float64)).to_numpy()
    series, metrics = [_series(raw, MEASURED, measured, np.ones(len(measured), dtype=bool))], []
    for variant in flown:
        student = Student(
            vehicle,
            count=len(bounds),
            network=variant.network,
            added_mass=variant.added_mass,
            design=design,
            physics=physics,
            threads=threads,
            folder=folder,
        )
        motion, valid = _fly(student, measured, bounds, thrusts, variant.name, progress)
        series.append(_series(raw, variant.name, motion, valid))
        metrics.append(_metrics(variant, dataset, raw, measured, motion, valid))
    return pl.concat(series), pl.concat(metrics)


def _commands(raw: pl.DataFrame, vehicle: Vehicle) -> Array:
    """Commands (N, n) of the vehicle's thrusters."""
    names = [f"cmd_{i + 1}" for i in range(len(vehicle.thruster))]
    extra = sorted(name for name in raw.columns if name.startswith("cmd_") and name not in names)
    missing = [name for name in names if name not in raw.columns]
    if missing or extra:
        raise DataError(
            f"vehicle {vehicle.name} has {len(names)} thrusters, and the table "
            f"{'lacks ' + missing[0] if missing else 'also has ' + extra[0]}; give the vehicle file of this recording"
        )
    return np.ascontiguousarray(raw.select(pl.col(names).cast(pl.Float64)).to_numpy())


def _fly(
    student: Student,
    measured: Array,
    bounds: Bounds,
    thrusts: Sequence[Array],
    name: str,
    progress: Progress | None,
) -> tuple[Array, NDArray[np.bool_]]:
    """Fly all segments together; motion (N, 12) at every row, and where it is valid."""
    motion, valid = np.full(measured.shape, np.nan), np.zeros(len(measured), dtype=bool)
    first, lengths = bounds[:, 0], bounds[:, 1] - bounds[:, 0]
    motion[first], valid[first] = measured[first], True
    student.start(measured[first, :6], measured[first, 6:])
    flying = lengths > 1
    flown = len(first)
    for row in range(1, lengths.max()):
        ids = np.flatnonzero(flying)
        if not len(ids):
            break
        student.advance(np.stack([thrusts[i][row - 1] for i in ids]), ids)
        eta, nu = student.state()
        here = np.hstack([eta, nu])
        well = ~student.diverged() & np.isfinite(here).all(axis=1)
        kept = ids[well[ids]]
        motion[first[kept] + row], valid[first[kept] + row] = here[kept], True
        flying &= well & (lengths > row + 1)
        flown += len(ids)
        if progress is not None:
            progress(name, flown, len(measured))
    return motion, valid


def _series(raw: pl.DataFrame, name: str, motion: Array, valid: NDArray[np.bool_]) -> pl.DataFrame:
    """Rows of the series table for one variant."""
    return pl.concat(
        [
            raw.select("session", pl.lit(name).alias("variant"), pl.col("t").cast(pl.Float64)),
            pl.DataFrame(motion, schema=[*POSE, *VELOCITY]),
        ],
        how="horizontal",
    ).filter(pl.Series(valid))


def _metrics(
    variant: Variant,
    dataset: str,
    raw: pl.DataFrame,
    measured: Array,
    motion: Array,
    valid: NDArray[np.bool_],
) -> pl.DataFrame:
    """Root mean square error of every velocity over the rows flown, and when a flight diverged if one did.

    Where one diverged the errors are called `rmse_before_divergence`: nobody should compare them with those of a whole flight.
    """
    errors = np.sqrt(((motion - measured)[valid, 6:] ** 2).mean(axis=0))
    name = "rmse" if valid.all() else "rmse_before_divergence"
    rows = [(axis, name, error, unit) for axis, error, unit in zip(VELOCITY, errors, UNITS, strict=True)]
    if not valid.all():
        rows.append(("all", "diverged", float(raw["t"][int(np.argmin(valid))]), "s"))
    return pl.DataFrame(
        {
            "model": variant.model,
            "variant": variant.name,
            "dataset": dataset,
            "axis": [row[0] for row in rows],
            "metric": [row[1] for row in rows],
            "value": [row[2] for row in rows],
            "low": pl.Series([None] * len(rows), dtype=pl.Float64),
            "high": pl.Series([None] * len(rows), dtype=pl.Float64),
            "unit": [row[3] for row in rows],
        }
    )
