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
    """Compute the residual wrench tau_res = tau_prop - M nu_dot - g of every row.

    Of a recording with nulls, of the rows that its samples determine, with standard deviations; the others
    have null.

    Args:
        vehicle: the vehicle that the data were recorded with.
        raw: raw table.
        acceleration: two-sided smoother, filter, or the paper's differences of filtered velocity.
        noise: standard deviation of u, v, w [m/s] and p, q, r [rad/s]; by default found from the data.
        subtract: effects taken away: `inertia`, the vehicle's added mass, or all `effects`.
        max_sd_velocity: standard deviation of a smoothed velocity [m/s, rad/s] above which a row of a
            recording with nulls has no label.
        max_sd_acceleration: the same of an acceleration [m/s^2, rad/s^2].

    Returns:
        The raw columns, and smoothed velocity, acceleration, thrusts [N], tau_prop and tau_res [N, N m] about
        the body origin in body axes (FRD). tau_res opposes motion: the vehicle feels -tau_res.

    Raises:
        hydro.core.errors.DataError: the table does not fit the vehicle, or time does not rise at one rate.
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
    """Divide labels into training and test blocks by the hash of their content.

    Args:
        labels: labels table.
        block: rows of a block.
        test: share of the blocks that are test data.
        salt: another salt, another split.

    Returns:
        The rows that have a label, with `block` and `part` (train, test, guard); the small table of blocks.

    Raises:
        hydro.core.errors.DataError: an argument is out of range, or time does not rise at one rate.
    """
    from hydro.core.distillation.split import split as divide
    from hydro.io.table import conform

    divided, blocks = divide(labels, block=block, test=test, salt=salt)
    return conform("split", divided), conform("blocks", blocks)


def features(labels: pl.DataFrame, set: Literal["raw", "physfeat"] = "physfeat") -> pl.DataFrame:
    """Compute the inputs and the targets of a residual network.

    Args:
        labels: labels or split table.
        set: the twelve states alone, or the 45 physical features.

    Returns:
        `session`, `t`, the features, the six targets [N, N m], and `block` and `part` where they were there,
        of the rows that have a label.
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
    """Train a residual network on the training part of a split table, after the paper's protocol.

    Args:
        split: split table.
        model: architecture: `mlp`, `resmlp`, `multihead`, `moe`, `physfeat`, `structured`, `temporal` or, for
            minutes of data, `gp`.
        seed: of the first weights and the order of rows; the same seed gives the same weights on one machine.
        epochs: passes over the data at most; by default as many as make 25,000 updates, 60 at most.
        minutes: train on whole blocks of so many minutes alone; on all of the training part by default.
        device: where to train.
        subtract: what `labels` subtracted: a replay must bring it.
        centre: centre of gravity [m], FRD from CO, for `gp`; by default it is found from the labels.
        progress: called after every epoch with a `hydro.learn.train.Epoch`: its number, how many there are
            at most, the loss in training, the error in validation, and whether it is the best so far; of `gp`
            the steps, without errors.

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
    """Replay a recording's commands in MuJoCo, open loop.

    Args:
        vehicle: the vehicle that the data were recorded with.
        raw: raw table.
        models: trained models, one variant each, in addition to MJ0 and MJ0+M_A.
        variants: names of the variants to simulate; all by default.
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
