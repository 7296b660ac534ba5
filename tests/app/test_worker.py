from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path
from typing import Any

import pytest

from hydro.app.desk import Choice, Desk
from hydro.app.places import Places
from hydro.app.worker import Cancelled, Report, Worker
from hydro.core.errors import DataError, HydroNotice


def double(number: int, report: Report) -> int:
    report("progress", ("doubling", 0.5))
    return 2 * number


def compile_first(report: Report) -> None:
    warnings.warn("compiling kernels: 3 compiled", HydroNotice, stacklevel=1)


def fail(report: Report) -> None:
    raise DataError("the log is empty")


def bug(report: Report) -> None:
    raise ValueError("two\nlines")


def die(report: Report) -> None:
    os._exit(3)


def wait(report: Report) -> None:
    report("progress", ("waiting", 0.0))
    time.sleep(60.0)


def test_work_reports_progress_fails_in_one_line_and_is_cancelled() -> None:
    worker, told = Worker(), list[Any]()
    try:
        assert worker.run(double, 21, report=lambda kind, content: told.append((kind, content))) == 42
        assert told == [("progress", ("doubling", 0.5))]
        worker.run(compile_first, report=lambda kind, content: told.append((kind, content)))
        assert told[1:] == [("notice", "compiling kernels: 3 compiled")]
        with pytest.raises(DataError, match="the log is empty"):
            worker.run(fail)
        with pytest.raises(DataError, match="ValueError: two lines; this is a bug"):
            worker.run(bug)
        begun = time.monotonic()

        def cancel(kind: str, content: Any) -> None:
            threading.Thread(target=worker.cancel).start()

        with pytest.raises(Cancelled):
            worker.run(wait, report=cancel)
        assert time.monotonic() - begun < 30.0
    finally:
        worker.close()


class Noted(Worker):
    """Worker that notes what is asked of it."""

    def __init__(self) -> None:
        super().__init__()
        self.started = self.closed = False

    def start(self) -> None:
        self.started = True

    def close(self) -> None:
        self.closed = True


def test_the_first_tab_takes_the_worker_that_was_started_ahead(tmp_path: Path) -> None:
    desk = Desk(Places.of([tmp_path]), worker=Noted)
    desk.prepare()
    ahead = desk.spare
    assert isinstance(ahead, Noted)
    assert ahead.started
    assert desk.tab("").worker is ahead
    assert desk.tab("").worker is not ahead
    desk.prepare()
    every = [desk.spare, *(tab.worker for tab in desk.tabs.values())]
    desk.close()
    assert all(isinstance(one, Noted) and one.closed for one in every)


def test_the_server_answers_before_the_physics_is_loaded() -> None:
    """What is loaded is counted, for timing depends on the machine."""
    script = (
        "import sys; from hydro.app import server; from hydro.app.desk import Desk; "
        "from hydro.app.places import Places; "
        "desk = Desk(Places.of(['.'])); server.application(desk, server.Address('127.0.0.1', 1, 'token')); "
        "print(*sys.modules); desk.close()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert "nicegui" in loaded
    assert not loaded & {"numpy", "scipy", "polars", "numba"}


def test_another_recording_takes_the_place_of_a_raw_table_and_of_a_guessed_vehicle() -> None:
    sample = "sample.toml"
    choice = Choice(sample, ("sample.parquet",), correct=True)
    choice.choose(("sample.parquet", "dive.csv"), sample)
    assert (choice.logs, choice.vehicle, choice.correct) == (("dive.csv",), "", False)
    choice.vehicle, choice.guess, choice.map = "rov.toml", "guessed from 8 commands", "map.toml"
    choice.choose(("dive.csv",), sample)
    assert choice.vehicle == "rov.toml"
    choice.choose(("dive.csv", "table.parquet"), sample)
    assert (choice.logs, choice.vehicle) == (("table.parquet",), "")
    assert (choice.guess, choice.map) == ("", "")
    choice.vehicle = "own.toml"
    choice.choose(("dive.csv", "second.csv"), sample)
    assert (choice.logs, choice.vehicle) == (("dive.csv", "second.csv"), "own.toml")
