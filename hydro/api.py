"""The public functions of hydro, on polars frames; each loads what it needs when it is called.

The vehicle comes first, then the data.  `progress` is called while a function works, with a few words on what
it is at and the share of the work that is done, from 0 to 1; `train` and `replay` say what they call it with.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, ParamSpec, TypeVar

if TYPE_CHECKING:
    from pathlib import Path

    import polars as pl

    from hydro.core.diagnosis.explain import Step
    from hydro.core.identification.fit import Fit
    from hydro.core.logs.logmap import LogMap
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.log_import import ImportReport
    from hydro.io.model import Model
    from hydro.learn.train import Epoch

P = ParamSpec("P")
R = TypeVar("R")

Progress = Callable[[str, float], None]
"""Called with a few words and the share of the work done, from 0 to 1."""
Acceleration = Literal["rts", "kalman", "kalman-difference"]
Subtract = Literal["inertia", "effects"]
Conditioning = Literal[
    "off", "paper", "paper-old", "paper-new", "low-pass-old", "low-pass-new", "clipping", "dead-band"
]


def _vehicle_first(function: Callable[P, R]) -> Callable[P, R]:
    """Accept a frame before the vehicle, the order of version 0.1, for one more version; with a warning."""

    @functools.wraps(function)
    def ordered(*given: P.args, **named: P.kwargs) -> R:
        arguments: tuple[Any, ...] = given
        if arguments and type(arguments[0]).__name__ == "DataFrame":
            warnings.warn(
                f"hydro.{function.__name__} takes the vehicle first, then the frame; the old order goes with "
                "the next version",
                DeprecationWarning,
                stacklevel=2,
            )
            if "vehicle" in named:
                arguments = (named.pop("vehicle"), *arguments)
            else:
                arguments = (*arguments[1::-1], *arguments[2:])
        return function(*arguments, **named)

    return ordered


def read(source: str | Path | BinaryIO, kind: str | None = None) -> pl.DataFrame:
    """Read an artefact and hold it to its schema.

    Args:
        source: path of a Parquet file, or a binary stream.
        kind: `raw`, `labels`, `split`, `blocks`, `features`, `metrics`, `replay`, `commands`, `comparison`,
            `diagnosis` or `ladder`; any by default.

    Returns:
        The table. `hydro.io.table.read` gives its provenance beside it.

    Raises:
        hydro.core.errors.DataError: the file is broken, of another kind, or breaks its schema.
    """
    from hydro.io import table

    return table.read(source, kind).frame


def write(
    frame: pl.DataFrame,
    destination: str | Path | BinaryIO,
    kind: str,
    *,
    vehicle_file: str | Path | None = None,
) -> None:
    """Write a table as an artefact of `kind`, whole or not at all, once it has passed its schema.

    Args:
        frame: the table.
        destination: path, or a binary stream.
        kind: kind of table, as for `read`.
        vehicle_file: vehicle file to put into the footer, so that later commands need no `--vehicle`.

    Raises:
        hydro.core.errors.DataError: the table breaks its schema, or the file cannot be written.
    """
    from hydro.io import table
    from hydro.io import vehicle as vehicles

    text = vehicles.read(vehicle_file)[1] if vehicle_file is not None else None
    table.write(table.make(kind, frame, stage="python", vehicle_text=text), destination)


def vehicle(path: str | Path) -> Vehicle:
    """Read and check a vehicle file.

    Raises:
        hydro.core.errors.DataError: the file is not a vehicle; the line names the path in the file.
    """
    from hydro.core import effects
    from hydro.io import vehicle as vehicles

    known, _ = vehicles.read(path)
    effects.validate(known)
    return known


def write_vehicle(vehicle: Vehicle, destination: str | Path, *, source: str | Path | None = None) -> None:
    """Write a vehicle file, whole or not at all.

    Args:
        vehicle: the vehicle, such as `hydro.add` or `hydro.fit` returns it.
        destination: path of the file.
        source: vehicle file whose comments and layout are kept where it says the same; may be the same path.

    Raises:
        hydro.core.errors.DataError: `source` or the vehicle breaks a rule of vehicle files, or the file
            cannot be written.
    """
    from hydro.io import rewrite
    from hydro.io import vehicle as vehicles

    text = vehicles.read(source)[1] if source is not None else ""
    vehicles.write(rewrite.rewritten(vehicle, text), destination)


def import_log(
    log: str | Path | BinaryIO,
    map: str | Path | LogMap | None = None,
    *,
    rate: float | None = None,
    strict: bool = False,
    fill: bool = False,
) -> tuple[pl.DataFrame, ImportReport]:
    """Turn a log into a raw table: one clock, NED and FRD, SI units, commands from -1 to 1.

    Args:
        log: CSV or Parquet file, or a binary stream.
        map: what the columns mean: a map file (`hydro import --write-map` begins one) or a `LogMap`; by
            default guessed from the columns' names.
        rate: rows per second; by default the median of the channels' own rates, or the fastest of them
            where it is plainly faster.
        strict: refuse a log whose motion contradicts the map.
        fill: values in every row, on lines between the samples of a sensor slower than the rows; by default
            such a column is null between its samples.

    Returns:
        The raw table, and a report: `report.verdict.contradictions` are the frames, units and signs that the
        kinematics contradict, `report.map` is what the columns were taken for, and `report.lines()` says all
        that `hydro import` prints.

    Raises:
        hydro.core.errors.DataError: the log or the map is broken, or they do not fit each other.
    """
    from pathlib import Path

    from hydro.io import log as logs
    from hydro.io import log_import

    source = logs.read(log)
    name = Path(log).stem if isinstance(log, str | Path) else "log"
    meaning = log_import.declared(source, map, name)
    report = log_import.import_log(source, meaning, rate=rate, strict=strict, fill=fill)
    return report.imported.frame, report


@_vehicle_first
def simulate(vehicle: Vehicle, commands: pl.DataFrame) -> pl.DataFrame:
    """Move a vehicle by commands, with every effect of its file.

    Args:
        vehicle: the vehicle.
        commands: `session`, `t` [s] and `cmd_1 ... cmd_n` in [-1, 1], each row held until the next: every
            session starts at rest at the origin. Or a raw table, whose own rows give the initial states.

    Returns:
        The raw table of what it would have logged, without noise.

    Raises:
        hydro.core.errors.DataError: the commands do not fit the vehicle, or the motion diverges.
    """
    from hydro.core.simulation.simulate import simulate as move
    from hydro.io.table import conform

    return conform("raw", move(vehicle, commands))


@_vehicle_first
def fit(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    effects: Sequence[str | Mapping[str, Any]],
    *,
    method: Literal["output", "equation"] = "output",
    noise: Sequence[float] | None = None,
    shots: int = 1000,
    progress: Progress | None = None,
) -> Fit:
    """Estimate the parameters of named effects from a recording, with standard errors.

    Args:
        vehicle: the vehicle; effects that it has start from their values, others from zero.
        raw: raw table.
        effects: names in the catalogue, see `hydro effects`: `linear_damping`, or `linear_damping.matrix`
            where there are several forms; or tables with values to start from.
        method: output error over shots of two seconds, or equation error along the smoothed motion, which is
            quicker and biased by noise.
        noise: standard deviation of position [m] (3), attitude [rad] (3), velocity [m/s] (3) and rates
            [rad/s] (3); by default found from the data.
        shots: shots, or windows, at most; they are spread evenly over a longer recording.
        progress: called with a few words and the share of the work done.

    Returns:
        A `hydro.core.identification.fit.Fit`: `vehicle` with the estimates, `frame()` with a row per
        parameter (value, standard error, unit, whether the data determine it), `covariance`, `chi2` and
        `warnings`.
        `hydro.add` writes it into a vehicle with its standard errors.

    Raises:
        hydro.core.errors.DataError: an effect or the recording is at fault, or the motion diverges.
    """
    import numpy as np

    from hydro.core.identification.fit import fit as estimate

    sigma = None if noise is None else np.asarray(noise, dtype=float)
    return estimate(vehicle, raw, effects, method=method, noise=sigma, most=shots, progress=progress)


@_vehicle_first
def compare(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    against: pl.DataFrame | None = None,
    progress: Progress | None = None,
) -> pl.DataFrame:
    """Compare a vehicle with a recording: how large are its errors, and where do they lie?

    Args:
        vehicle: the vehicle.
        raw: raw table.
        against: an earlier comparison with the same recording, whose errors are to stand beside the new ones.
        progress: called with a few words and the share of the work done.

    Returns:
        The comparison table: errors of force [N, N m] and of predictions [m, rad, m/s, rad/s] by axis,
        horizon and place, each beside what noise alone would leave.

    Raises:
        hydro.core.errors.DataError: the table does not fit the vehicle.
    """
    from hydro.core.evaluation.compare import compare as measure
    from hydro.io.table import conform

    return conform("comparison", measure(vehicle, raw, against=against, progress=progress))


@_vehicle_first
def diagnose(vehicle: Vehicle, raw: pl.DataFrame, *, progress: Progress | None = None) -> pl.DataFrame:
    """Find which physical effects are missing in a vehicle, and how sure that is.

    Args:
        vehicle: the vehicle.
        raw: raw table.
        progress: called with a few words and the share of the work done.

    Returns:
        The diagnosis table: one finding per row, the most telling first, with verdict, values and advice.

    Raises:
        hydro.core.errors.DataError: the table does not fit the vehicle, or is too short.
    """
    from hydro.core.diagnosis.diagnose import diagnose as find
    from hydro.io.table import conform

    return conform("diagnosis", find(vehicle, raw, progress=progress).frame())


def add(vehicle: Vehicle, diagnosis: pl.DataFrame | Fit, effects: Sequence[str] | None = None) -> Vehicle:
    """Add what a diagnosis or a fit found to a vehicle, with its standard errors.

    Args:
        vehicle: the vehicle that was diagnosed or fitted.
        diagnosis: diagnosis table, or what `hydro.fit` returns.
        effects: names of the effects to add; by default all that were fitted, or that a diagnosis found
            missing or with other values. What it only suspects is added by name alone.

    Returns:
        The vehicle with them.

    Raises:
        hydro.core.errors.DataError: there is nothing to add, or not what is named.
    """
    from hydro.core.diagnosis.findings import extended, tables
    from hydro.core.errors import DataError
    from hydro.core.identification.fit import Fit

    if not isinstance(diagnosis, Fit):
        return extended(vehicle, tables(diagnosis, effects))
    fitted = {table["name"]: table for table in diagnosis.tables()}
    wanted = list(effects or fitted)
    if unknown := [name for name in wanted if name not in fitted]:
        raise DataError(f"the fit has no effect {unknown[0]} to add; it has {', '.join(fitted)}")
    return extended(vehicle, [fitted[name] for name in wanted])


@_vehicle_first
def explain(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    holdout: pl.DataFrame | None = None,
    progress: Progress | None = None,
) -> Iterator[Step]:
    """Add what a vehicle lacks, step by step, until nothing more is found.

    Args:
        vehicle: the vehicle.
        raw: raw table.
        holdout: raw table that nothing is fitted to; a step that predicts it worse is the last.
        progress: called with a few words and the share of the present step that is done.

    Yields:
        Each step as it is done, the vehicle as given first: a `hydro.core.diagnosis.explain.Step` with the
        vehicle, its comparison and diagnosis, and its errors as rows of the ladder table.

    Raises:
        hydro.core.errors.DataError: a table does not fit the vehicle, or is too short.
    """
    from dataclasses import replace

    from hydro.core.diagnosis.explain import explain as steps
    from hydro.io.table import conform

    for step in steps(vehicle, raw, holdout=holdout, progress=progress):
        yield replace(
            step,
            comparison=conform("comparison", step.comparison),
            diagnosis=conform("diagnosis", step.diagnosis),
            ladder=conform("ladder", step.ladder),
        )


@_vehicle_first
def labels(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    acceleration: Acceleration = "rts",
    noise: Sequence[float] | None = None,
    subtract: Subtract = "inertia",
) -> pl.DataFrame:
    """Compute the residual wrench tau_res = tau_prop - M nu_dot - g of every row.

    Args:
        vehicle: the vehicle that the data were recorded with.
        raw: raw table.
        acceleration: two-sided smoother, filter, or the paper's differences of filtered velocity.
        noise: standard deviation of u, v, w [m/s] and p, q, r [rad/s]; by default found from the data.
        subtract: effects taken away: `inertia`, the vehicle's added mass, or all `effects`.

    Returns:
        The raw columns, and smoothed velocity, acceleration, thrusts [N], tau_prop and tau_res [N, N m] about
        the body origin in body axes (FRD). tau_res opposes motion: the vehicle feels -tau_res.

    Raises:
        hydro.core.errors.DataError: the table does not fit the vehicle, or time does not rise at one rate.
    """
    from hydro.core.distillation.labels import labels as compute
    from hydro.io.table import conform

    found = compute(vehicle, raw, acceleration=acceleration, noise=noise, subtract=subtract)
    return conform("labels", found)


def split(
    labels: pl.DataFrame, *, block: int = 150, test: float = 0.2, salt: str = ""
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Divide labels into training and test blocks by the hash of their content.

    Args:
        labels: labels table.
        block: rows of a block.
        test: share of the blocks that are test data.
        salt: another salt, another split.

    Returns:
        The table with `block` and `part` (train, test, guard), and the small table of its blocks.

    Raises:
        hydro.core.errors.DataError: an argument is out of range, or time does not rise at one rate.
    """
    from hydro.core.distillation.split import split as divide
    from hydro.io.table import conform

    divided, blocks = divide(labels, block=block, test=test, salt=salt)
    return conform("split", divided), conform("blocks", blocks)


def features(labels: pl.DataFrame, set: Literal["raw", "physfeat"] = "physfeat") -> pl.DataFrame:
    """Compute the inputs of a residual network beside its targets.

    Args:
        labels: labels or split table.
        set: the twelve states alone, or the 45 physical features.

    Returns:
        `session`, `t`, the features, the six targets [N, N m], and `block` and `part` where they were there.
    """
    from hydro.core.distillation.features import table
    from hydro.io.table import conform

    return conform("features", table(labels, set))


def train(
    split: pl.DataFrame,
    *,
    model: str = "physfeat",
    seed: int = 0,
    epochs: int | None = None,
    minutes: float | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
    subtract: Subtract = "inertia",
    progress: Callable[[Epoch], None] | None = None,
) -> Model:
    """Train a residual network on the training part of a split table, after the paper's protocol.

    Args:
        split: split table.
        model: architecture: `mlp`, `resmlp`, `multihead`, `moe`, `physfeat`, `structured` or `temporal`.
        seed: of the first weights and the order of rows; the same seed gives the same weights on one machine.
        epochs: passes over the data at most; by default as many as make 25,000 updates, 60 at most.
        minutes: train on whole blocks of so many minutes alone; on all of the training part by default.
        device: where to train.
        subtract: what `labels` subtracted: a replay must bring it.
        progress: called after every epoch with a `hydro.learn.train.Epoch`: its number, how many there are
            at most, the loss in training, the error in validation, and whether it is the best so far.

    Returns:
        The model; `write_model` stores it.

    Raises:
        hydro.core.errors.DataError: the table has not been split, or has too few rows.
        hydro.core.errors.UsageError: there is no such model or device.
    """
    from dataclasses import replace

    from hydro.learn.rows import for_minutes
    from hydro.learn.train import train as fit

    rows = split if minutes is None else for_minutes(split, minutes)
    trained = fit(rows, model=model, seed=seed, epochs=epochs, device=device, progress=progress)
    return replace(trained, subtract=subtract)


def read_model(source: str | Path | BinaryIO) -> Model:
    """Read a trained model.

    Raises:
        hydro.core.errors.DataError: the file is broken or is not a model.
    """
    from hydro.io import model, table

    return model.from_artefact(table.read(source, "model"))


def write_model(model: Model, destination: str | Path | BinaryIO) -> None:
    """Write a trained model as a table of tensors with its architecture and scalers in the footer.

    Raises:
        hydro.core.errors.DataError: a tensor is not finite, or the file cannot be written.
    """
    from hydro.io import model as models
    from hydro.io import table

    table.write(models.to_artefact(model, stage="python"), destination)


def evaluate(
    models: Sequence[Model],
    labels: pl.DataFrame,
    *,
    part: Literal["test", "train", "all"] = "test",
    by: Sequence[Literal["speed", "drift", "reach"]] = (),
    dataset: str = "labels",
) -> pl.DataFrame:
    """Measure how well models predict the residual wrench.

    Args:
        models: trained models, of different names.
        labels: split table, or a labels table for part `all`.
        part: which side of the split.
        by: ways to divide the rows, each regime of which is measured besides; see `hydro evaluate --help`.
        dataset: name of the data in the result.

    Returns:
        A metrics table: `rmse`, `mae` [N, N m] and `r2` per axis and over all, with 95 % intervals. Column
        `variant` names the regime, and is empty for all rows together.

    Raises:
        hydro.core.errors.DataError: the rows are not there, or a model is broken.
    """
    from hydro.io.table import conform
    from hydro.learn.evaluate import evaluate as measure

    return conform("metrics", measure(models, labels, part=part, dataset=dataset, by=by))


@_vehicle_first
def replay(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    models: Sequence[Model] = (),
    variants: Sequence[str] | None = None,
    conditioning: Conditioning = "off",
    piece: float | None = None,
    dataset: str = "recording",
    progress: Progress | None = None,
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Replay a recording's commands in MuJoCo, open loop.

    Args:
        vehicle: the vehicle that the data were recorded with.
        raw: raw table.
        models: trained models, one variant each, beside MJ0 and MJ0+M_A.
        variants: names of the variants to fly; all by default.
        conditioning: what is done to a learned wrench: nothing, as the paper does, or one piece of that; see
            `hydro replay --help`.
        piece: also measure every piece of so many seconds, such as the 10 s segments of the replay sequence.
        dataset: name of the recording in the metrics.
        progress: called with the variant that is replayed and the share of all variants that is done.

    Returns:
        The motion of every variant and of the recording (variant `measured`): pose in NED [m, rad], velocity
        in body axes [m/s, rad/s]; and a metrics table with the root mean square error of every velocity.

    Raises:
        hydro.core.errors.DataError: the table does not fit the vehicle.
        hydro.core.errors.UsageError: there is no such variant.
    """
    from hydro.io.table import conform
    from hydro.sim import replay as sim
    from hydro.sim.residual.conditioning import preset

    flown = sim.variants(models, variants)
    names = [variant.name for variant in flown]
    motion, errors = sim.replay(
        vehicle,
        raw,
        flown,
        setup=sim.Setup(conditioning=preset(conditioning, vehicle)),
        piece=piece,
        dataset=dataset,
        progress=progress
        and (lambda name, done, rows: progress(name, (names.index(name) + done / rows) / len(names))),
    )
    return conform("replay", motion), conform("metrics", errors)
