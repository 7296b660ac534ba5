"""Frames of the Python API: columns, order and types are those of the same table read back from a file."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import hydro
from hydro.core.columns import MOTION, command_columns
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.vehicle.description import Vehicle


@pytest.fixture(scope="module")
def known(datasets: Path) -> Vehicle:
    return hydro.vehicle(datasets / "vehicles" / "auv151.toml")


@pytest.fixture(scope="module")
def raw(known: Vehicle) -> pl.DataFrame:
    """Twice 18 s of sines on all thrusters, with ordinary noise of the sensors."""
    rng, t = np.random.default_rng(5), np.arange(900) * 0.02
    sessions = []
    for session in ("a", "b"):
        sines = [
            0.6 * np.sin(2.0 * np.pi * rng.uniform(0.1, 0.6) * t + rng.uniform(0.0, 6.0)) for _ in range(8)
        ]
        given = {"session": [session] * t.size, "t": t} | dict(zip(command_columns(8), sines, strict=True))
        moved = hydro.simulate(pl.DataFrame(given), known)
        logged = disturb(moved.select(MOTION).to_numpy(), PROFILES["ordinary"], rng)
        sessions.append(moved.with_columns(pl.DataFrame(logged, schema=[*MOTION])))
    return pl.concat(sessions)


MADE: dict[str, Callable[[pl.DataFrame, Vehicle], pl.DataFrame | hydro.Diagnosis | hydro.Comparison]] = {
    "raw": hydro.simulate,
    "comparison": hydro.compare,
    "comparison with an earlier one": lambda raw, known: hydro.compare(
        known, raw, against=hydro.compare(known, raw)
    ),
    "diagnosis": hydro.diagnose,
    "labels": hydro.labels,
    "split": lambda raw, known: hydro.split(hydro.labels(known, raw), block=100)[0],
    "blocks": lambda raw, known: hydro.split(hydro.labels(known, raw), block=100)[1],
    "features": lambda raw, known: hydro.features(hydro.labels(known, raw)),
    "replay": lambda raw, known: hydro.replay(known, raw)[0],
    "metrics": lambda raw, known: hydro.replay(known, raw)[1],
}


def read_back(frame: pl.DataFrame, kind: str) -> pl.DataFrame:
    stream = io.BytesIO()
    hydro.write(frame, stream, kind)
    stream.seek(0)
    return hydro.read(stream, kind)


def columns(frame: pl.DataFrame) -> list[tuple[str, pl.DataType]]:
    """Names and types, in order: a polars schema is equal to another in any order."""
    return list(frame.schema.items())


@pytest.mark.parametrize("name", MADE)
def test_a_frame_is_as_its_file_reads(name: str, raw: pl.DataFrame, known: Vehicle) -> None:
    made = MADE[name](raw, known)
    frame = made if isinstance(made, pl.DataFrame) else made.table
    back = read_back(frame, name.split()[0])
    assert columns(back) == columns(frame)
    assert back.equals(frame)


def test_steps_are_as_their_files_read(raw: pl.DataFrame, known: Vehicle) -> None:
    for step in hydro.explain(known, raw):
        frames = {
            "comparison": step.comparison.table,
            "diagnosis": step.diagnosis.table,
            "ladder": step.ladder,
        }
        for kind, frame in frames.items():
            assert columns(read_back(frame, kind)) == columns(frame)
