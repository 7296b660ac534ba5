"""Sessions of a long recording: whole ones, as many as fit, evenly spread."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
import synthetic
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.diagnosis import pipeline
from hydro.core.errors import DataError
from hydro.core.recording.spread_sessions import spread_sessions

DT = 0.1


def table(rows: list[int]) -> pl.DataFrame:
    parts = [
        pl.DataFrame({"session": [f"s{number}"] * count, "t": np.arange(count) * DT})
        for number, count in enumerate(rows)
    ]
    return pl.concat(parts).with_row_index("row")


@given(st.lists(st.integers(2, 40), min_size=1, max_size=30), st.integers(2, 300))
def test_sessions_are_whole_as_many_as_fit_and_in_order(rows: list[int], most: int):
    whole = table(rows)
    part = spread_sessions(whole, (most + 0.5) * DT)
    assert part.height <= most or part.equals(whole)
    assert part["row"].is_sorted()
    counts = dict(part.group_by("session").len().iter_rows())
    if len(counts) > 1:
        assert all(counts[name] == rows[int(name[1:])] for name in counts)
    if sum(rows) <= most:
        assert part.equals(whole)
    if len(set(rows)) == 1 and sum(rows) > most >= rows[0]:
        assert len(counts) == most // rows[0]


def test_sessions_are_evenly_spread():
    part = spread_sessions(table([10] * 58), 120 * DT)
    places = np.array([int(name[1:]) for name in part["session"].unique(maintain_order=True)])
    assert len(places) == 12
    assert set(np.diff(places)) <= {4, 5}


def test_one_session_that_is_too_long_is_cut_at_its_end():
    part = spread_sessions(table([1000]), 99.5 * DT)
    assert part["row"].to_list() == list(range(99))


def test_a_clock_with_errors_is_refused():
    with pytest.raises(DataError):
        spread_sessions(table([10]).with_columns(t=pl.lit(0.0)), 0.5)


@pytest.mark.parametrize("column", ["session", "t"])
def test_an_earlier_table_without_a_column_is_refused(column: str):
    vehicle, commands = synthetic.vehicle(), {f"cmd_{number}": pl.lit(0.0) for number in range(1, 9)}
    with pytest.raises(DataError, match=f"no column {column}"):
        pipeline.hull_of(vehicle, table([100]).drop(column).with_columns(**commands))


def test_an_hour_of_an_earlier_recording_is_used(monkeypatch):
    """The rest is not even cleaned."""
    used = list[pl.DataFrame]()

    def stop(_, frame: pl.DataFrame) -> None:
        used.append(frame)
        raise DataError("enough")

    monkeypatch.setattr(pipeline, "preprocess", stop)
    monkeypatch.setattr(pipeline, "recording", lambda *_: None)
    with pytest.raises(DataError, match="enough"):
        pipeline.hull_of(None, table([6000] * 20))  # type: ignore[arg-type]
    assert used[0].height * DT == pipeline.LONGEST_EARLIER == 3600.0
