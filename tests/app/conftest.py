from __future__ import annotations

from pathlib import Path
from typing import Any

import polars as pl
import pytest

pytest.importorskip("nicegui")

from hydro.app import opening
from hydro.app.opening import Craft, Opened
from hydro.io import table
from hydro.io.table import Artefact


def part(*sessions: str) -> Artefact:
    """Return the first 16 s of some sessions of the sample, at 25 Hz."""
    _, raw = opening.sample()
    found = table.read(raw, "raw").frame
    kept = found.filter(pl.col("session").is_in(sessions), pl.col("t") < 16.0).gather_every(2)
    return table.make("raw", kept, stage="test")


@pytest.fixture(scope="session")
def short() -> Artefact:
    """Two sessions of the sample, 16 s at 25 Hz each."""
    return part("run-1", "run-2")


@pytest.fixture(scope="session")
def other() -> Artefact:
    """A third session of the sample, 16 s at 25 Hz."""
    return part("run-3")


@pytest.fixture(scope="session")
def folder(short: Artefact, other: Artefact, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the two recordings and the vehicle of the sample."""
    made = tmp_path_factory.mktemp("bench")
    table.write(short, made / "short.parquet")
    table.write(other, made / "other.parquet")
    (made / "vehicle.toml").write_text(Path(opening.sample()[0]).read_text())
    return made


@pytest.fixture(scope="session")
def craft(folder: Path) -> Craft:
    return Craft.read(folder / "vehicle.toml")


@pytest.fixture(scope="session")
def opened(folder: Path, craft: Craft) -> Opened:
    return opening.open_recording([str(folder / "short.parquet")], "", craft, quiet)


def quiet(*told: Any) -> None:
    """Ignore progress."""
