"""Replay of recorded commands in MuJoCo, open loop, and the errors of each model variant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import POSE, VELOCITY, WRENCH, Array, Rows
from hydro.core.effects import sensor, velocity_log
from hydro.core.errors import UsageError
from hydro.core.evaluation.metrics import Subject, consecutive, measure, rows_of
from hydro.core.recording.segments import require_samples, resumes, sample_time, segments
from hydro.core.recording.smoothing import Design
from hydro.core.recording.supply import recorded_commands
from hydro.core.residual.lowering import TrainedModel
from hydro.core.residual.network import Network
from hydro.core.vehicle.description import Vehicle
from hydro.sim.bridge.water import Water, dry, residual, wet
from hydro.sim.residual.beside import beside
from hydro.sim.residual.conditioning import OFF, Conditioning
from hydro.sim.residual.control import Control
from hydro.sim.student import Physics, Student

Progress = Callable[[str, int, int], None]

MEASURED = "measured"
"""Name of the recording in the series."""
CHUNK = 100  # number of rows per call of MuJoCo
BLOCK = 10.0  # length of the blocks of the error bootstrap [s]

PAPER_NAMES = {"mlp": "MJ1", "resmlp": "MJ2", "multihead": "MJ3", "physfeat": "MJ4"}
"""The paper's names of its plug-in variants (section V-B), by model."""


@dataclass(frozen=True)
class Variant:
    """Model variant of a replay.

    Attributes:
        name: Name in the tables.
        model: Name of the residual model, or `none`.
        network: Residual model; None without one.
        water: Water forces without a residual model: `none`, added mass in the mass matrix (`inertia`),
            MuJoCo's `ellipsoid` fluid model, or all `effects` of the vehicle file.
    """

    name: str
    model: str = "none"
    network: TrainedModel | None = None
    water: Literal["none", "inertia", "ellipsoid", "effects"] = "none"


BASELINES = (
    Variant("MJ0"),
    Variant("MJ0+M_A", water="inertia"),
    Variant("MJ0+ellipsoid", water="ellipsoid"),
)
"""Baselines of MuJoCo, all with restoring forces, thrusters and the native C_RB.

The first has nothing else, the second has M_A in the mass matrix, and the third has MuJoCo's fluid model on
an ellipsoid of the hull's size.  C_A is part of a residual model (paper eq. 6), so the second baseline does
not have it.
"""
EFFECTS = Variant("effects", water="effects")
"""Variant with all effects of the vehicle file, without a residual model."""


def variants(models: Sequence[TrainedModel] = (), names: Sequence[str] | None = None) -> list[Variant]:
    """Return the model variants of a replay: baselines, one per residual model, and all effects.

    A model has the name that Wu et al. give it, if any.  A model whose labels excluded all effects runs with
    them, as `effects+` and its name.

    Args:
        models: Trained models.
        names: Variants to return, in this order; by default all, but `effects` only together with a model
            that needs them.

    Raises:
        UsageError: Two models would have the same name, or there is no variant of a name.
    """
    flying = [Variant(_name(model), model.name, model) for model in models]
    known = {variant.name: variant for variant in (*BASELINES, *flying, EFFECTS)}
    if len(known) < len(BASELINES) + len(flying) + 1:
        raise UsageError("two models of one kind have the same name in one replay; replay them one by one")
    unknown = [name for name in names or () if name not in known]
    if unknown:
        raise UsageError(
            f"no variant is called {unknown[0]!r}: there are {', '.join(known)}; MJ1 to MJ4 need a model"
        )
    if names:
        return [known[name] for name in names]
    return [*BASELINES, *([EFFECTS] if any(map(_needs_effects, models)) else []), *flying]


def _name(model: TrainedModel) -> str:
    """Return the name of a model's variant."""
    name = PAPER_NAMES.get(model.name, model.name)
    return f"effects+{name}" if _needs_effects(model) else name


def _needs_effects(model: TrainedModel) -> bool:
    """Check whether the model's labels exclude all effects, not only added mass."""
    return model.subtract == "effects"


@dataclass(frozen=True)
class Setup:
    """Settings of a replay.

    Attributes:
        conditioning: Filter and limits of a network's wrench (Wu et al., III-B); none by default.
        design: Filter for the online acceleration; by default one that trusts every sample.
        control_step: Time for which a network's wrench is held [s]; by default 25 Hz as in Wu et al..
        lead: Time by which a network is evaluated ahead, as a share of the control step, see
            `sim.residual.control`.
        physics: Step and integrator; by default 500 Hz as in Wu et al..
        threads: Number of threads that share the segments.
        folder: Folder of the vehicle file, which has its hull mesh.
    """

    conditioning: Conditioning = OFF
    design: Design | None = None
    control_step: float = 0.04
    lead: float = 0.5
    physics: Physics = field(default_factory=Physics)
    threads: int = 1
    folder: Path | None = None

    def student(self, variant: Variant, vehicle: Vehicle, count: int) -> Student:
        """Return a new MuJoCo simulation of `count` equal vehicles with the water forces of a variant."""
        water = _water(variant, vehicle, self._control)
        return Student(
            vehicle, water, count=count, physics=self.physics, threads=self.threads, folder=self.folder
        )

    def _control(self, network: Network) -> Control:
        return Control(network, self.control_step, self.design, self.conditioning, self.lead)


def replay(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    flown: Sequence[Variant] = BASELINES,
    *,
    setup: Setup | None = None,
    dataset: str = "recording",
    piece: float | None = None,
    progress: Progress | None = None,
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Simulate the recorded commands of every session in MuJoCo, and return the motions and their errors.

    A new flight starts at each session and after each gap.  If the vehicle's DVL has errors (effects of kind
    `sensor`), a flight starts at the corrected velocity, and its velocities are output with the same errors.
    So predictions and measurements are comparable.  Readings of a late DVL from before the start of a flight
    stay as recorded.

    Args:
        vehicle: Vehicle file of the recording.
        raw: Raw table.
        flown: Variants of the water model, from `variants`.
        setup: Settings; by default those of Wu et al., except the lead.
        dataset: Name of the recording in the metrics.
        piece: Also measure the errors of every piece of this length [s] of each session, such as the segments
            of a sequence of commands; its dataset is called `recording 10-20 s`.
        progress: Called with the name of a variant, the rows done of the longest segment, and its total.

    Returns:
        A pair of frames, series and metrics.  The series, one row per variant and time, have the columns of
        `schemas/replay.json`, with the recording as variant `measured`; a diverged flight ends where it
        diverges.  The metrics have root mean square error, mean absolute error and R^2 of each velocity, with
        95 % intervals, and fractions of the control steps in which the conditioning acted: `clipped` by axis,
        and `held_back` by the dead band.  If a flight diverged, `diverged` is the time in the first such
        segment.

    Raises:
        DataError: The table does not fit the vehicle, or a model cannot run with its effects.
        UsageError: The log's sample time is not a multiple of the physics step.
    """
    setup, record = setup or Setup(), _Recorded.of(raw, vehicle)
    steps, measured = setup.physics.steps(sample_time(raw), "the log's sample time"), record.measured
    series, metrics = [_series(raw, MEASURED, measured, np.ones(len(measured), dtype=bool))], []
    for variant in flown:
        student = setup.student(variant, vehicle, len(record.bounds))
        report = partial(progress, variant.name) if progress is not None else None
        motion = _logged_motion(record, student, steps, report)
        valid: NDArray[np.bool_] = np.asarray(np.isfinite(motion).all(axis=1))
        series.append(_series(raw, variant.name, motion, valid))
        metrics.append(_metrics(variant, dataset, raw, measured, motion, valid))
        if piece is not None:
            metrics += _by_piece(variant, dataset, raw, measured, motion, valid, piece)
        if variant.network is not None:
            metrics.append(_conditioning_metrics(variant, dataset, student, valid[record.bounds[:, 1] - 1]))
    return pl.concat(series), pl.concat(metrics, how="vertical_relaxed")  # some may be empty


@dataclass(frozen=True)
class _Recorded:
    """Recording of N rows and S gap-free segments, prepared for a replay.

    Attributes:
        measured: Pose and velocity as logged, (N, 12).
        begun: Velocity corrected for the errors of the DVL, (N, 6).
        commands: Effective commands of the n thrusters (`recording.supply`), (N, n).
        clock: Times [s], (N,).
        bounds: First row, and row after the last, of each segment, (S, 2).
        resumed: Segments that follow a gap, (S,).
        log: Parameters of the DVL's errors.
    """

    measured: Array
    begun: Array
    commands: Array
    clock: Array
    bounds: Rows
    resumed: NDArray[np.bool_]
    log: Array

    @classmethod
    def of(cls, raw: pl.DataFrame, vehicle: Vehicle) -> _Recorded:
        """Return a raw table as arrays for the replay, with the velocity corrected for DVL errors."""
        require_samples(raw, (*POSE, *VELOCITY))
        commands, bounds = recorded_commands(vehicle, raw), segments(raw)
        measured = raw.select(pl.col(*POSE, *VELOCITY).cast(pl.Float64)).to_numpy()
        log, clock = velocity_log(vehicle), raw["t"].cast(pl.Float64).to_numpy()
        begun = _through_dvl(sensor.corrected, log, clock, measured[:, 6:], bounds)
        return cls(measured, begun, commands, clock, bounds, resumes(raw, bounds), log)


def _logged_motion(
    record: _Recorded, student: Student, steps: int, report: Callable[[int, int], None] | None
) -> Array:
    """Return the motion of a replay as the sensors would log it, (N, 12), NaN after a divergence.

    Args:
        record: The recording.
        student: MuJoCo models, one per segment.
        steps: Physics steps per row.
        report: Called with the rows done of the longest segment, and its total.
    """
    measured, begun, bounds = record.measured, record.begun, record.bounds
    first = bounds[:, 0]
    settled = np.where(record.resumed[:, None], record.commands[first], np.nan)
    pose = sensor.true_pose(record.log, measured[:, :6])
    student.start(pose[first], begun[first], settled=settled, t=record.clock[first])
    known = np.hstack([pose, begun])
    motion = _fly(student, known, record.commands, bounds, steps, report)
    motion[:, :6] = sensor.logged_pose(record.log, motion[:, :6])
    motion[:, 6:] = _through_dvl(sensor.measured, record.log, record.clock, motion[:, 6:], bounds)
    before = _before_start(record.log, record.clock, bounds)
    motion[before, 6:9] = measured[before, 6:9]
    return motion


def _through_dvl(
    through: Callable[[Array, Array, Array], Array], log: Array, t: Array, nu: Array, bounds: Rows
) -> Array:
    """Apply the errors of a DVL to velocities (N, 6), or correct them, segment by segment.

    Velocities after the first that is not finite stay as they are.

    Args:
        through: Function of parameters, times and velocities that applies or corrects the errors.
        log: Parameters of the DVL's errors.
        t: Times (N,) [s].
        nu: Velocities (N, 6) [m/s, rad/s].
        bounds: First row, and row after the last, of each segment (S, 2).
    """
    out = nu.copy()
    for start, stop in bounds if log.any() else ():
        end = start + int(np.isfinite(nu[start:stop]).all(axis=1).sum())
        out[start:end] = through(log, t[start:end], nu[start:end])
    return out


def _before_start(log: Array, t: Array, bounds: Rows) -> NDArray[np.bool_]:
    """Return the rows (N,) whose delayed DVL reading is older than the start of the segment."""
    begun = np.repeat(t[bounds[:, 0]], np.diff(bounds, axis=1)[:, 0])
    return np.asarray(t < begun + log[sensor.DELAY] - 1e-9)


def _water(variant: Variant, vehicle: Vehicle, controlled: Callable[[Network], Control]) -> Water:
    """Return the water forces of a variant.

    Args:
        variant: The model variant.
        vehicle: Vehicle file.
        controlled: Function that makes the control of a residual network.
    """
    if variant.network is not None:
        network, whole = controlled(Network.of(variant.network)), _needs_effects(variant.network)
        added = () if whole else beside(vehicle, variant.network.labelled)
        return residual(vehicle, network, effects=whole, beside=added)
    if variant.water == "effects":
        return wet(vehicle)
    return dry(vehicle, added_mass=variant.water == "inertia", ellipsoid=variant.water == "ellipsoid")


def _fly(
    student: Student,
    measured: Array,
    commands: Array,
    bounds: Rows,
    steps: int,
    report: Callable[[int, int], None] | None,
) -> Array:
    """Simulate all segments in parallel; return the motion (N, 12) of all rows, NaN after a divergence."""
    motion = np.full(measured.shape, np.nan)
    first, last = bounds[:, 0], bounds[:, 1] - 1
    motion[first] = measured[first]
    flying, row = np.flatnonzero(last > first), 0
    while len(flying):
        # The shortest remaining flight limits the rows of a call, so that all have the same length.
        rows = min(CHUNK, int((last[flying] - first[flying]).min()) - row)
        begin = first[flying] + row
        held = np.stack([commands[at : at + rows] for at in begin])
        for at, part in zip(begin, student.fly(held, steps, flying), strict=True):
            motion[at + 1 : at + 1 + rows] = part
        row += rows
        alive = np.isfinite(motion[first[flying] + row]).all(axis=1)
        flying = flying[alive & (last[flying] > first[flying] + row)]
        if report is not None:
            report(min(row, len(motion)), int((last - first).max()))
    return motion


def _series(raw: pl.DataFrame, name: str, motion: Array, valid: NDArray[np.bool_]) -> pl.DataFrame:
    """Return the rows of one variant in the series table."""
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
    """Return the errors of all velocities, and the time of a divergence if there is one.

    After a divergence the errors are called `rmse_before_divergence` and so on, because they must not be
    compared with those of a complete flight.
    """
    block = max(1, round(BLOCK / sample_time(raw)))
    errors = measure(
        measured[valid, 6:],
        motion[valid, 6:],
        consecutive(len(motion), block)[valid],
        Subject(variant.model, dataset, variant.name),
        axes=VELOCITY,
    )
    if valid.all():
        return errors
    diverged = _rows(variant, dataset, [("all", "diverged", float(raw["t"][int(np.argmin(valid))]), "s")])
    return pl.concat([errors.with_columns(pl.col("metric") + "_before_divergence"), diverged])


def _by_piece(
    variant: Variant,
    dataset: str,
    raw: pl.DataFrame,
    measured: Array,
    motion: Array,
    valid: NDArray[np.bool_],
    piece: float,
) -> list[pl.DataFrame]:
    """Return the errors of every piece of `piece` [s] of the sessions, except pieces with a divergence.

    Args:
        variant: The model variant.
        dataset: Name of the recording.
        raw: Raw table.
        measured: Pose and velocity as logged (N, 12).
        motion: Pose and velocity of the replay (N, 12).
        valid: Rows (N,) before any divergence.
        piece: Length of a piece [s].
    """
    since = raw.select(pl.col("t") - pl.col("t").min().over("session")).to_series().to_numpy()
    number = np.floor(since / piece + 1e-6).astype(np.int64)
    found = []
    for k in range(int(number.max()) + 1):
        chosen = number == k
        if chosen.sum() < 2 or not valid[chosen].all():
            continue
        named = f"{dataset} {k * piece:g}-{(k + 1) * piece:g} s"
        found.append(
            measure(
                measured[chosen, 6:],
                motion[chosen, 6:],
                np.zeros(int(chosen.sum())),
                Subject(variant.model, named, variant.name),
                axes=VELOCITY,
            )
        )
    return found


def _conditioning_metrics(
    variant: Variant, dataset: str, student: Student, whole: NDArray[np.bool_]
) -> pl.DataFrame:
    """Return the shares of control steps in which the conditioning clipped an axis or its dead band acted.

    Diverged flights are excluded, because MuJoCo has reset their counts.  If all diverged, there are no rows.
    """
    counts = list(compress(student.conditioning_counts(), whole))
    steps = sum(count.steps for count in counts)
    if steps == 0:
        return _rows(variant, dataset, [])
    clipped = np.sum([count.clipped for count in counts], axis=0) / steps
    rows = [(axis, "clipped", float(share), "1") for axis, share in zip(WRENCH, clipped, strict=True)]
    rows.append(("all", "held_back", sum(count.held_back for count in counts) / steps, "1"))
    return _rows(variant, dataset, rows)


def _rows(variant: Variant, dataset: str, rows: Sequence[tuple[str, str, float, str]]) -> pl.DataFrame:
    """Return rows of the metrics table, given axis, metric, value and unit of each, without intervals."""
    subject = Subject(variant.model, dataset, variant.name)
    lines = ((axis, metric, value, np.nan, np.nan, unit) for axis, metric, value, unit in rows)
    return rows_of(subject, lines)
