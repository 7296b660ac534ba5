"""Models of a case: each is made once, and its errors are kept in the results file."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl

import hydro
from benchmarks.future_work.predictions import Windows, by_least_squares, in_mujoco, standing
from benchmarks.future_work.recordings import Case, Recordings
from benchmarks.work import Results
from hydro.core.columns import VELOCITY, WRENCH, Array
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
EPOCHS = 24
"""Passes over the training data: 6,144 weight updates for 20 minutes, a quarter of the default of `hydro
train`, for the processor time."""
BLOCK = 150
"""Rows of a block of wrench errors for the bootstrap, as in `hydro evaluate`."""
ZERO, LEAST_SQUARES, BARE, GIVEN = "zero velocity", "least squares", "no water forces", "file as given"
"""Baselines; `no water forces` has the added mass of the file and nothing else."""
EXPLAINED = "hydro explain"
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
        self.labels = hydro.labels(self.vehicle, self.labelled)

    def motion(self, predict: Any) -> Rows:
        """Return the errors of predicted velocities; `predict` takes windows and returns (S, K, 6)."""
        rows = [*of_blocks(AHEAD, VELOCITY, *self.ahead.errors(predict(self.ahead)))]
        if self.sequence is not None:
            rows += of_blocks(SEQUENCE, VELOCITY, *self.sequence.errors(predict(self.sequence)))
        return rows

    def wrench(self, remaining: pl.DataFrame | None = None, predicted: Array | None = None) -> Rows:
        """Return the errors of a wrench.

        Args:
            remaining: Labels that a model leaves, its error; by default the labels with the file's inertia.
            predicted: A network's prediction of these labels, (N, 6).
        """
        table = self.labels if remaining is None else remaining
        error = table.select(f"{axis}_res" for axis in WRENCH).drop_nulls().to_numpy().astype(float)
        error = error - (0.0 if predicted is None else predicted)
        block = consecutive(len(error), BLOCK)
        count = np.bincount(block)
        squares, absolute = (
            np.stack([np.bincount(block, column) for column in values.T], axis=1)
            for values in (error**2, np.abs(error))
        )
        return list(of_blocks(WRENCHES, WRENCH, squares, np.tile(count[:, None], 6), absolute))


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


def of_network(on: Measured, name: str, seed: int, split: pl.DataFrame) -> Rows:
    """Train a network, and return its errors."""
    model = train(split, model=name, seed=seed, epochs=EPOCHS, accelerations=trusted_accelerations(split))
    (variant,) = simulation.variants([model], [simulation.PAPER_NAMES.get(name, name)])
    predicted = predict_rows(model, on.labels, "all")[1]
    return on.wrench(predicted=predicted) + on.motion(lambda windows: in_mujoco(on.vehicle, variant, windows))


def models(case: Case, on: Measured) -> Iterator[tuple[str, int, Any]]:
    """Yield name, seed (-1 for none) and the function that returns the errors of every model of a case."""
    bare = simulation.Variant(BARE, water="inertia")
    yield ZERO, -1, lambda: on.motion(standing)
    yield LEAST_SQUARES, -1, lambda: on.motion(lambda at: by_least_squares(on.vehicle, on.train, at))
    yield BARE, -1, lambda: on.wrench() + on.motion(lambda at: in_mujoco(on.vehicle, bare, at))
    yield GIVEN, -1, lambda: of_vehicle(on, on.vehicle)
    for name, effects in case.fits.items():
        yield name, -1, lambda effects=effects: of_vehicle(on, fitted(on, effects))
    if case.explained is not None:
        yield EXPLAINED, -1, lambda: of_vehicle(on, vehicles.read(case.explained)[0])
    split: list[pl.DataFrame] = []
    for seed in range(SEEDS):
        for name in NETWORKS:

            def errors(name: str = name, seed: int = seed) -> Rows:
                split[:] = split or [hydro.split(hydro.labels(on.vehicle, on.label_train), test=0.0)[0]]
                return of_network(on, name, seed, split[0])

            yield name, seed, errors


def fitted(on: Measured, effects: Any) -> Vehicle:
    """Fit effects to the training recording, and print their values."""
    found = fit(on.vehicle, on.train, effects)
    for table in found.tables():
        print("   ", table, flush=True)
    return found.vehicle


def run(case: Case, results: Results) -> None:
    """Measure the models of a case that the results file does not have yet."""
    known = set(results.table.filter(part=case.part, case=case.name).select("method", "seed").unique().rows())
    on = Measured(case.load())
    for name, seed, errors in models(case, on):
        if (name, seed) in known:
            continue
        begun = time.process_time()
        found = errors()
        key = {"part": case.part, "case": case.name, "method": name, "seed": seed}
        cpu = time.process_time() - begun
        results.add(*(key | row | {"cpu": cpu} for row in found))
        print(f"{case.name}, {name}, seed {seed}: {cpu:.1f} s", flush=True)
