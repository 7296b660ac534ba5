"""How long a diagnosis takes: what was measured, to a factor of two; and more of anything takes longer."""

from __future__ import annotations

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.recording.extent import above_surface, diagnosis_seconds

MEASURED = (
    (2_000, 0, 23.4),
    (4_500, 0, 41.2),
    (12_000, 0, 26.5),
    (30_000, 0, 108.9),
    (59_914, 0, 88.4),
    (4_500, 12, 21.8),
    (12_000, 12, 32.0),
    (36_000, 12, 64.4),
    (12_000, 42, 63.3),
)
"""Rows, values of the file that are fitted anew, and seconds of a processor."""


@pytest.mark.parametrize(("rows", "values", "seconds"), MEASURED)
def test_what_was_measured_is_met_to_a_factor_of_two(rows: int, values: int, seconds: float) -> None:
    assert 0.5 <= diagnosis_seconds(rows, values, 1) / seconds <= 2.0


@given(rows=st.integers(1, 10**8), values=st.integers(0, 200), processors=st.integers(1, 256))
def test_more_takes_longer_and_more_processors_never_do(rows: int, values: int, processors: int) -> None:
    seconds = diagnosis_seconds(rows, values, processors)
    assert diagnosis_seconds(2 * rows, values, processors) > seconds
    assert diagnosis_seconds(rows, values + 1, processors) > seconds
    assert diagnosis_seconds(rows, values, 2 * processors) < seconds
    assert diagnosis_seconds(rows, values, 1) / seconds <= 3.0


def test_a_simulated_vehicle_that_leaves_the_water_is_told():
    z = pl.DataFrame({"session": ["a", "a", "b"], "t": [0.0, 0.1, 0.0], "z": [0.0, -0.3, 2.0]})
    assert above_surface(z) == ""
    told = above_surface(z.with_columns(pl.col("z") - 2.5))
    assert told.startswith("the vehicle leaves the water in session a at 0 s, and rises 2.8 m")
