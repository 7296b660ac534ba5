"""A held-out recording and one from before a change, from the files to the study and the shown commands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import polars as pl
import pytest

from hydro.app import jobs, opening, shown_commands
from hydro.app.opening import Craft, Opened
from hydro.app.session import Session
from hydro.core.errors import DataError
from hydro.core.explanation.explain import BEST
from hydro.io import table


def opened_with(folder: Path, craft: Craft, **further: str) -> Opened:
    return opening.open_recording([str(folder / "short.parquet")], "", craft, quiet, **further)


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions of the sample at 25 Hz, 80 s: enough for a hull-force model."""
    path = tmp_path_factory.mktemp("earlier") / "earlier.parquet"
    raw = table.read(opening.sample()[1], "raw").frame
    kept = raw.filter(pl.col("session").is_in(["run-3", "run-4"]), pl.col("t") < 40.0).gather_every(2)
    table.write(table.make("raw", kept, stage="test"), path)
    return path


@pytest.fixture(scope="module")
def session(folder: Path, earlier: Path, craft: Craft) -> Session:
    made = Session()
    made.open(craft, opened_with(folder, craft, holdout=str(folder / "other.parquet"), before=str(earlier)))
    return made


def test_a_study_uses_both_and_the_page_says_so(session: Session, craft: Craft) -> None:
    opened = session.opened
    assert opened is not None
    assert opened.lines[1:3] == (
        "held-out recording: 400 rows at 25 Hz in 1 session",
        "recording before a change: 2,000 rows at 25 Hz in 2 sessions",
    )
    recordings = jobs._recordings(opened, craft, quiet)
    assert recordings.holdout is not None
    assert recordings.holdout.raw.height == 400
    assert recordings.hull is not None
    told = jobs._told_beside(opened, recordings)["before"]
    assert told["recording"] == "earlier"
    assert told["given"] > told["left"] > 0.0


def test_the_shown_commands_name_both(session: Session, folder: Path, earlier: Path) -> None:
    step: Any = SimpleNamespace(number=1)
    added = replace(session.rung, kind="added", label="added", wanted=("ocean_current", BEST), steps=(step,))
    session = replace(session, history=[session.rung, added], at=1)
    other = folder / "other.parquet"
    assert f"--holdout {other} --before {earlier} --add ocean_current" in shown_commands.shell(session)
    python = shown_commands.python(session)
    assert f"holdout = hydro.read({str(other)!r})" in python
    assert "hydro.explain(vehicle, raw, holdout=holdout, before=before, add=" in python


def test_the_recording_itself_is_refused(folder: Path, craft: Craft) -> None:
    with pytest.raises(DataError, match="the same rows as the recording; choose another one as held-out"):
        opened_with(folder, craft, holdout=str(folder / "short.parquet"))


def test_a_log_needs_the_map_of_the_recording(folder: Path, craft: Craft, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t\n0\n")
    with pytest.raises(DataError, match=r"log\.csv: a log needs a map"):
        opened_with(folder, craft, before=str(log))


def quiet(*told: Any) -> None:
    """Ignore progress."""
