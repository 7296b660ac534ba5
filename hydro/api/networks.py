"""From recordings to residual networks, and their replays in MuJoCo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal

from hydro.api.order import Progress, vehicle_first
from hydro.api.threads import one_thread

if TYPE_CHECKING:
    import polars as pl

    from hydro.core.vehicle.description import Vehicle
    from hydro.io.model import Model
    from hydro.learn.train import Epoch

Acceleration = Literal["rts", "kalman", "kalman-difference"]
Subtract = Literal["inertia", "effects"]
Conditioning = Literal[
    "off", "paper", "paper-old", "paper-new", "low-pass-old", "low-pass-new", "clipping", "dead-band"
]


@vehicle_first
@one_thread
def labels(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    acceleration: Acceleration = "rts",
    noise: Sequence[float] | None = None,
    subtract: Subtract = "inertia",
    max_sd_velocity: float = 0.05,
    max_sd_acceleration: float = 0.25,
) -> pl.DataFrame:
    """Compute the residual wrench tau_res = tau_prop - M nu_dot - g of every row, the label of a network.

    In a recording with sparse sensors (nulls between samples), only rows whose samples determine the label
    have one, with its standard deviation; other rows have null.

    Args:
        vehicle: vehicle that was recorded, from `hydro.vehicle`.
        raw: recording as a raw table, from `hydro.import_log` or `hydro.read`.
        acceleration: how accelerations are computed: `rts`, a two-sided smoother; `kalman`, a causal filter;
            `kalman-difference`, differences of filtered velocity as in Wu et al.
        noise: six standard deviations: of u, v, w [m/s] and p, q, r [rad/s]; by default estimated from the
            recording.
        subtract: effects of the vehicle that the label excludes: `inertia`, its added mass, or all `effects`.
        max_sd_velocity: greatest standard deviation of a smoothed velocity [m/s, rad/s] of a row with a
            label, in a recording with nulls.
        max_sd_acceleration: greatest standard deviation of an acceleration [m/s^2, rad/s^2], likewise.

    Returns:
        Labels table: the raw columns, smoothed velocity, acceleration, thrusts [N], tau_prop and tau_res
        [N, N m] about the body origin in body axes (FRD). tau_res opposes motion: the force on the vehicle is
        -tau_res.

    Raises:
        hydro.core.errors.DataError: the table does not fit the vehicle, or the time step is not constant.
    """
    from hydro.core.distillation.labels import labels as compute
    from hydro.core.distillation.labels_of_samples import Bounds
    from hydro.io.table import conform

    limits = Bounds(max_sd_velocity, max_sd_acceleration)
    found = compute(vehicle, raw, acceleration=acceleration, noise=noise, subtract=subtract, limits=limits)
    return conform("labels", found)


def split(
    labels: pl.DataFrame, *, block: int = 150, test: float = 0.2, salt: str = ""
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Divide labels into training and test blocks, by a hash of each block's content.

    Args:
        labels: labels table, from `hydro.labels`.
        block: number of rows of a block.
        test: share of the blocks that are test data, 0 to 1.
        salt: text that is hashed with each block; another text gives another split.

    Returns:
        Split table: the rows with a label, with the columns `block` and `part` (`train`, `test`, or `guard`
        for rows between both, which are not used). And a table with one row per block.

    Raises:
        hydro.core.errors.DataError: an argument is out of range, or the time step is not constant.
    """
    from hydro.core.distillation.split import split as divide
    from hydro.io.table import conform

    divided, blocks = divide(labels, block=block, test=test, salt=salt)
    return conform("split", divided), conform("blocks", blocks)


def features(labels: pl.DataFrame, set: Literal["raw", "physfeat"] = "physfeat") -> pl.DataFrame:
    """Compute the inputs and the targets of a residual network.

    Args:
        labels: labels or split table, from `hydro.labels` or `hydro.split`.
        set: `raw`, the six velocities and six accelerations; or `physfeat`, 45 physical features of them.

    Returns:
        One row for each row with a label: `session`, `t` [s], the features, the six targets tau_res
        [N, N m], and `block` and `part` of a split table.
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
    centre: Sequence[float] | None = None,
    progress: Callable[[Epoch], None] | None = None,
) -> Model:
    """Train a residual network on the training part of a split table, with early stopping.

    Args:
        split: split table, from `hydro.split`.
        model: architecture: `mlp`, `resmlp`, `multihead`, `moe`, `physfeat`, `structured`, `temporal` or, for
            minutes of data, `gp`.
        seed: seed of the initial weights and of the order of rows; the same seed gives the same weights on
            one machine.
        epochs: maximum number of passes over the data; by default as many as give 25,000 updates, at most 60.
        minutes: minutes of data to train on, in whole blocks; by default all of the training part.
        device: device that trains.
        subtract: `subtract` of the labels; a replay then applies these effects in addition to the network.
        centre: only for `gp`: centre of gravity (3,) [m], FRD from the body origin CO; by default it is
            fitted to the labels.
        progress: called after every epoch with a `hydro.Epoch`: its number, the maximum number, the training
            loss, the validation error, and whether it is the best so far. For `gp`: after every step, without
            errors.

    Returns:
        The model; `hydro.write_model` stores it.

    Raises:
        hydro.core.errors.DataError: the table has not been split, or has too few rows.
        hydro.core.errors.UsageError: there is no such model or device.
    """
    from dataclasses import replace

    from hydro.learn.rows import for_minutes
    from hydro.learn.train import train as fit

    rows = split if minutes is None else for_minutes(split, minutes)
    trained = fit(
        rows, model=model, seed=seed, epochs=epochs, device=device, centre=centre, progress=progress
    )
    return replace(trained, subtract=subtract)


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
        models: trained models with different names, from `hydro.train` or `hydro.read_model`.
        labels: split table; or a labels table, if `part` is `all`.
        part: part of the split table to measure on.
        by: divisions of the rows by motion, each measured in addition to all rows: by `speed`; by `drift`,
            the angle between velocity and bow; or by `reach`, the greatest deviation of the six velocities
            from the means of the training data, in standard deviations. () measures all rows together only.
        dataset: name of the data in the result.

    Returns:
        Metrics table: `rmse`, `mae` [N, N m] and `r2`, for each axis and over all, with 95 % intervals. The
        column `variant` names the regime; it is empty for all rows together.

    Raises:
        hydro.core.errors.DataError: the table has no rows of the part, or a model is broken.
    """
    from hydro.io.table import conform
    from hydro.learn.evaluate import evaluate as measure

    return conform("metrics", measure(models, labels, part=part, dataset=dataset, by=by))


@vehicle_first
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
    """Replay the commands of a recording in MuJoCo, open loop, with several models of the water.

    Args:
        vehicle: vehicle that was recorded, from `hydro.vehicle`.
        raw: recording as a raw table, from `hydro.import_log` or `hydro.read`.
        models: trained models; each is one variant of the simulation. Variants without a network are always
            there, such as MJ0 (no water forces) and MJ0+M_A (added mass alone).
        variants: names of the variants to simulate; by default all.
        conditioning: filter of a network's wrench before it acts: `off`; `paper`, which is low-pass, clipping
            and dead band; or one of these three alone. See `hydro replay --help`.
        piece: length of pieces [s] whose errors are measured as well, such as 10 s; by default only the whole
            recording is measured.
        dataset: name of the recording in the metrics.
        progress: called as `progress(variant, share)`: the variant that is simulated, and the share of all
            variants that is done, 0 to 1.

    Returns:
        The motion of every variant and of the recording (variant `measured`): pose in the world (NED)
        [m, rad], velocity in body axes (FRD) [m/s, rad/s]. And a metrics table with the root mean square
        error of every velocity.

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
