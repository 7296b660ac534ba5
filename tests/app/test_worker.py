from __future__ import annotations

import os
import threading
import time
from typing import Any

import pytest

from hydro.app.worker import Cancelled, Report, Worker
from hydro.core.errors import DataError


def double(number: int, report: Report) -> int:
    report("progress", ("doubling", 0.5))
    return 2 * number


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
