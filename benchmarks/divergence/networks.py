"""Networks of the study, from recordings with or without noise; each is kept in a file."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import polars as pl

from benchmarks.divergence.cells import Data
from benchmarks.full_recordings import folder_of
from hydro.core.columns import POSE, VELOCITY
from hydro.core.distillation.labels import labels
from hydro.core.distillation.split import split
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.vehicle.description import Vehicle
from hydro.io import table
from hydro.io import vehicle as vehicles
from hydro.io.model import Model, from_artefact, to_artefact
from hydro.learn.rows import for_minutes, of_part
from hydro.learn.train import BATCH_LIMITS, BATCHES_PER_EPOCH, train

STONEFISH = Path(__file__).resolve().parents[2] / "datasets" / "stonefish"
UPDATES = 6_000
"""Weight updates of every network, a quarter of the default of `hydro train`, to save processor time."""
SAMPLE = 20
"""Minutes of the bundled sample."""


@dataclass(frozen=True)
class Source:
    """Recordings of the study.

    Attributes:
        file: Vehicle file that they were made with.
        sample: Path of the recording of 20 minutes.
        full: Folder of the full recordings, with `nominal.parquet`; by default the installed one.
        updates: Weight updates of every network.
    """

    file: Path = STONEFISH / "vehicle.toml"
    sample: Path = STONEFISH / "sample.parquet"
    full: Path | None = None
    updates: int = UPDATES

    @property
    def vehicle(self) -> Vehicle:
        """Vehicle of the recordings."""
        return vehicles.read(self.file)[0]

    def recording(self, data: Data) -> Path:
        """Return the path of the recording from which a network learns."""
        return self.sample if data.minutes <= SAMPLE else folder_of(self.full) / "nominal.parquet"


@lru_cache(maxsize=1)
def training_rows(source: Source, data: Data, seed: int) -> pl.DataFrame:
    """Return the training part of the labels, with the noise of a seed."""
    raw = table.read(source.recording(data), "raw").frame
    if data.noise != "none":
        motion = raw.select(*POSE, *VELOCITY).to_numpy().astype(np.float64)
        logged = disturb(motion, PROFILES[data.noise], np.random.default_rng(seed))
        raw = raw.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))
    parts = split(labels(source.vehicle, raw))[0]
    if data.minutes != SAMPLE:
        parts = for_minutes(parts, data.minutes)
    return of_part(parts, "train")


def network(source: Source, data: Data, model: str, seed: int, folder: Path) -> Model:
    """Return a network from its file in a folder; train it first if there is none.

    Args:
        source: Recordings.
        data: Data and protocol.
        model: Architecture.
        seed: Seed of the noise and of the weights.
        folder: Folder of the networks.
    """
    path = folder / f"{model}-{data.name}-{seed}.parquet"
    if not path.is_file():
        rows = training_rows(source, data, seed if data.noise != "none" else 0)
        trained = train(
            rows,
            model=model,
            seed=seed,
            epochs=_epochs(rows.height, source.updates),
            accelerations=data.accelerations,
            protocol="paper" if data.accelerations else "annealed",
        )
        folder.mkdir(parents=True, exist_ok=True)
        table.write(to_artefact(replace(trained, name=model), stage="benchmark", seed=seed), path)
    return from_artefact(table.read(path, "model"))


def _epochs(rows: int, updates: int) -> int:
    """Return the epochs that make about as many updates, with the batches of `hydro.learn.train`."""
    batch = float(np.clip(rows // BATCHES_PER_EPOCH, *BATCH_LIMITS))
    return max(1, round(updates / math.ceil(rows / batch)))
