from __future__ import annotations

import os
import threading
import time
from typing import Any

import pytest

from hydro.app.worker import Cancelled, Tell, Worker
from hydro.core.errors import DataError


def double(number: int, tell: Tell) -> int:
    tell("progress", ("doubling", 0.5))
    return 2 * number


def fail(tell: Tell) -> None:
    raise DataError("the log is empty")


def bug(tell: Tell) -> None:
    raise ValueError("two\nlines")


def die(tell: Tell) -> None:
    os._exit(3)


def wait(tell: Tell) -> None:
    tell("progress", ("waiting", 0.0))
    time.sleep(60.0)


def test_work_reports_progress_fails_in_one_line_and_is_cancelled() -> None:
    worker, told = Worker(), list[Any]()
    try:
        assert worker.run(double, 21, tell=lambda kind, content: told.append((kind, content))) == 42
        assert told == [("progress", ("doubling", 0.5))]
        with pytest.raises(DataError, match="the log is empty"):
            worker.run(fail)
        with pytest.raises(DataError, match="ValueError: two lines; this is a bug"):
            worker.run(bug)
        begun = time.monotonic()

        def cancel(kind: str, content: Any) -> None:
            threading.Thread(target=worker.cancel).start()

        with pytest.raises(Cancelled):
            worker.run(wait, tell=cancel)
        assert time.monotonic() - begun < 30.0
    finally:
        worker.close()
