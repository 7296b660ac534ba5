"""The estimate of the remaining time: from the pace and from an estimate beforehand."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from hydro.report import waiting
from hydro.report.waiting import Remaining


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


@given(st.floats(1.0, 1e4), st.sampled_from([None, 0.3, 1.0, 3.0]), st.floats(0.5, 0.95))
def test_an_even_pace_is_estimated_within_a_factor_of_two(total, factor, share):
    clock = Clock()
    remaining = Remaining(None if factor is None else factor * total, now=clock)
    for step in range(1, 101):
        if step / 100 > share:
            break
        clock.now = total * step / 100
        remaining.update(step / 100)
    left = total - clock.now
    assert left / 2.0 < remaining.seconds < 2.0 * left


def test_the_remaining_time_counts_down_and_grows_if_a_report_is_overdue():
    clock = Clock()
    remaining = Remaining(100.0, now=clock)
    told = []
    for clock.now in (0.0, 30.0, 60.0, 200.0):
        told.append(remaining.seconds)
    assert told[:3] == [100.0, 70.0, 60.0]
    assert told[3] == 200.0, "nothing was done for 200 s"


def test_the_next_part_starts_with_the_duration_of_the_last():
    clock = Clock()
    remaining = Remaining(now=clock)
    assert remaining.seconds is None
    remaining.update(0.5)
    clock.now = 40.0
    remaining.update(1.0)
    assert remaining.seconds is None, "it is done"
    remaining.update(0.0)
    assert remaining.seconds == pytest.approx(40.0)
    remaining.update(None)
    assert remaining.seconds is None, "nobody knows"


def test_printed_lines_are_above_the_bar(monkeypatch):
    """A line on stderr and the bar never share a row."""
    shown = io.StringIO()
    console = Console(file=shown, force_terminal=True, width=80, legacy_windows=False)
    monkeypatch.setattr(waiting, "Console", lambda **_: console)
    with waiting.shown("explain", 30.0) as update:
        update(10, 100, "words " * 20)
        print("step 1, done")
    text = shown.getvalue()
    (line,) = (one for one in text.split("\n") if "step 1, done" in one)
    assert line.split("\x1b[2K")[-1].strip("\r") == "step 1, done"
    assert "…" in text, "long words are cut off at the end of the row"
