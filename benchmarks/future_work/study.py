"""Models of a case: each is made once, and its errors are kept in the results file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl

import hydro
from benchmarks.future_work.predictions import Windows, by_least_squares, in_mujoco, standing
from benchmarks.future_work.recordings import OWN, Case, Recordings
from benchmarks.work import Results
from hydro.core.columns import VELOCITY, WRENCH, Array
from hydro.core.effects import CATALOGUE
from hydro.core.evaluation.metrics import consecutive
from hydro.core.identification.fit import fit
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as vehicles
from hydro.learn.evaluate import predict_rows
from hydro.learn.train import train, trusted_accelerations
from hydro.sim import replay as simulation

NETWORKS = ("mlp", "physfeat", "temporal")
"""The paper's first and best network, which know the present motion only, and one that knows the past."""
SEEDS = 3
"""Trainings of each network."""
EPOCHS = {"memory": 12, "vehicles": 12, "recorded": 24}
"""Passes over the training data of each part: about 3,000 weight updates in each, an eighth of the default of
`hydro train`, for the processor time."""
SHOTS = {"memory": 300, "vehicles": 300, "recorded": 1_000}
"""Shots of each fit: nine of the 20 minutes of a simulated recording, and the default for the real one."""
BLOCK = 150
"""Rows of a block of wrench errors for the bootstrap, as in `hydro evaluate`."""
ZERO, LEAST_SQUARES, BARE, GIVEN = "zero velocity", "least squares", "no water forces", "file as given"
"""Baselines; `no water forces` has the added mass of the file and nothing else."""
EXPLAINED, AS_GIVEN = "hydro explain", ", added mass as given"
WRENCHES, AHEAD, SEQUENCE = "wrench", "5 s", "90 s"
"""Measures: wrench error, and velocity errors of predictions."""
SCHEMA: dict[str, Any] = {
    "part": pl.String,
    "case": pl.String,
    "method": pl.String,
    "seed": pl.Int64,
    "measure": pl.String,
    "block": pl.Int64,
    "axis": pl.String,
    "number": pl.Int64,
    "squares": pl.Float64,
    "absolute": pl.Float64,
    "cpu": pl.Float64,
}
"""One row per block of time and axis: compared values, and sums of squared and of absolute errors."""
Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Chosen:
    """Options of a run.

    Attributes:
        folder: Folder of the results and of the fitted vehicle files.
        seeds: Trainings of each network.
        as_given: Train networks with the added mass of the file as given, not with the fitted one.
    """

    folder: Path
    seeds: int = SEEDS
    as_given: bool = False


class Measured:
    """Recordings of a case, and what every model is measured on."""

    def __init__(self, recordings: Recordings) -> None:
        self.vehicle = recordings.vehicle
        self.train = recordings.train
        self.label_train, self.labelled = recordings.labels
        self.ahead = Windows.of(recordings.held_out, recordings.truth, recordings.seen)
        self.sequence: Windows | None = None
        if (whole := recordings.replay) is not None:
            truth = whole.select(VELOCITY).to_numpy().astype(float)
            self.sequence = Windows.of(whole, truth, np.ones(truth.shape, bool), None)

    def motion(self, predict: Callable[[Windows], Array]) -> Rows:
        """Return the errors of predicted velocities; `predict` takes windows and returns (S, K, 6)."""
        rows = [*of_blocks(AHEAD, VELOCITY, *self.ahead.errors(predict(self.ahead)))]
        if self.sequence is not None:
            rows += of_blocks(SEQUENCE, VELOCITY, *self.sequence.errors(predict(self.sequence)))
        return rows

    def wrench(self, labels: pl.DataFrame, predicted: Array | None = None) -> Rows:
        """Return the errors of a wrench.

        Args:
            labels: Labels of the held-out sessions, or the residual wrench of a model.
            predicted: A network's prediction of these labels, (N, 6); None for a residual.
        """
        error = labels.select(f"{axis}_res" for axis in WRENCH).drop_nulls().to_numpy().astype(float)
        error = error - (0.0 if predicted is None else predicted)
        block = consecutive(len(error), BLOCK)
        count = np.bincount(block)
        squares, absolute = (
            np.stack([np.bincount(block, column) for column in values.T], axis=1)
            for values in (error**2, np.abs(error))
        )
        return list(of_blocks(WRENCHES, WRENCH, squares, np.tile(count[:, None], 6), absolute))


class Labels:
    """Labels of the training and the held-out sessions, made with the inertia of one vehicle file."""

    def __init__(self, on: Measured, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.split = hydro.split(hydro.labels(vehicle, on.label_train), test=0.0)[0]
        self.held_out = hydro.labels(vehicle, on.labelled)


def of_blocks(
    measure: str, axes: tuple[str, ...], squares: Array, numbers: Any, absolute: Array | None = None
) -> Iterator[dict[str, Any]]:
    """Yield a row per block and axis from sums of errors, (B, 6)."""
    for block, axis in np.ndindex(squares.shape):
        yield {
            "measure": measure,
            "block": block,
            "axis": axes[axis],
            "number": int(numbers[block, axis]),
            "squares": float(squares[block, axis]),
            "absolute": None if absolute is None else float(absolute[block, axis]),
        }


def of_vehicle(on: Measured, vehicle: Vehicle) -> Rows:
    """Return the errors of a vehicle file with all its effects."""
    remaining = hydro.labels(vehicle, on.labelled, subtract="effects")
    return on.wrench(remaining) + on.motion(lambda windows: in_mujoco(vehicle, simulation.EFFECTS, windows))


def of_network(on: Measured, labels: Labels, name: str, seed: int, epochs: int) -> Rows:
    """Train a network, and return its errors.

    Args:
        on: Recordings of the case.
        labels: What it learns, and the vehicle file whose inertia it flies with.
        name: Name of the network.
        seed: Seed of the training.
        epochs: Passes over the training data.
    """
    trusted = trusted_accelerations(labels.split)
    model = train(labels.split, model=name, seed=seed, epochs=epochs, accelerations=trusted)
    (variant,) = simulation.variants([model], [simulation.PAPER_NAMES.get(name, name)])
    predicted = predict_rows(model, labels.held_out, "all")[1]
    return on.wrench(labels.held_out, predicted) + on.motion(
        lambda windows: in_mujoco(labels.vehicle, variant, windows)
    )


def with_inertia(vehicle: Vehicle, other: Vehicle) -> Vehicle:
    """Return a vehicle with the added mass of another one, and its own other effects."""

    def of_inertia(table: Mapping[str, Any]) -> bool:
        return CATALOGUE[str(table["name"])].inertia is not None

    added = [table for table in other.effect if of_inertia(table)]
    kept = [table for table in vehicle.effect if not of_inertia(table)]
    return msgspec.structs.replace(vehicle, effect=(*added, *kept))


def models(case: Case, on: Measured, chosen: Chosen) -> Iterator[tuple[str, int, Callable[[], Rows]]]:
    """Yield name, seed (-1 for none) and the function that returns the errors of every model of a case."""
    bare = simulation.Variant(BARE, water="inertia")
    yield ZERO, -1, lambda: on.motion(standing)
    yield LEAST_SQUARES, -1, lambda: on.motion(lambda at: by_least_squares(on.vehicle, on.train, at))
    yield (
        *(BARE, -1),
        lambda: (
            on.wrench(hydro.labels(on.vehicle, on.labelled))
            + on.motion(lambda at: in_mujoco(on.vehicle, bare, at))
        ),
    )
    yield GIVEN, -1, lambda: of_vehicle(on, on.vehicle)

    def fit_of(name: str) -> Vehicle:
        words = (case.part, case.name, *map(called, case.fits[name]))
        place = chosen.folder / f"{'-'.join(words).replace(' ', '-')}.toml"
        if not place.exists():
            hydro.write_vehicle(
                fit(on.vehicle, on.train, case.fits[name], most=SHOTS[case.part]).vehicle, place
            )
        return vehicles.read(place)[0]

    made: dict[bool, Labels] = {}

    def trained(name: str, seed: int) -> Rows:
        if chosen.as_given not in made:
            vehicle = on.vehicle if chosen.as_given else with_inertia(on.vehicle, fit_of(OWN))
            made[chosen.as_given] = Labels(on, vehicle)
        return of_network(on, made[chosen.as_given], name, seed, EPOCHS[case.part])

    for seed in range(chosen.seeds):
        for name in NETWORKS:
            yield f"{name}{AS_GIVEN if chosen.as_given else ''}", seed, partial(trained, name, seed)
    for name in case.fits:
        yield name, -1, lambda name=name: of_vehicle(on, fit_of(name))
    if case.explained is not None:
        yield EXPLAINED, -1, lambda: of_vehicle(on, vehicles.read(case.explained)[0])


def called(effect: str | dict[str, Any]) -> str:
    """Return the name of an effect that is fitted."""
    return effect if isinstance(effect, str) else str(effect["name"])


def run(case: Case, results: Results, chosen: Chosen) -> None:
    """Measure the models of a case that the results file does not have yet."""
    known = set(results.table.filter(part=case.part, case=case.name).select("method", "seed").unique().rows())
    on = Measured(case.load())
    for name, seed, errors in models(case, on, chosen):
        if (name, seed) in known:
            continue
        begun = time.process_time()
        found = errors()
        key = {"part": case.part, "case": case.name, "method": name, "seed": seed}
        cpu = time.process_time() - begun
        results.add(*(key | row | {"cpu": cpu} for row in found))
        print(f"{case.name}, {name}, seed {seed}: {cpu:.1f} s", flush=True)
