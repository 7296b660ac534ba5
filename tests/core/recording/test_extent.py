"""Range of the duration of a diagnosis, which contains the measured durations."""

from __future__ import annotations

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.recording.extent import above_surface, diagnosis_seconds

MEASURED = (
    ("a file without damping", 2_000, 23.4),
    ("a file without damping", 4_500, 41.2),
    ("a file without damping", 30_000, 108.9),
    ("a file without damping", 59_914, 88.4),
    ("damping 25 % wrong", 12_000, 32.0),
    ("damping 25 % wrong", 36_000, 64.4),
    ("42 values of the file", 12_000, 63.3),
    ("a weak thruster and a current", 5_809, 32.0),
    ("one effect", 15_000, 13.6),
    ("damping up to 25 % wrong", 15_000, 6.8),
    ("one change, hull of panels", 15_000, 64.1),
    ("nothing, hull of panels", 15_000, 39.5),
)
"""Missing effects, rows, and processor time of `hydro diagnose` [s]."""
WIDEST = 20.0
"""Ratio of the ends of the range; a wider one says nothing."""


@pytest.mark.parametrize(("missing", "rows", "seconds"), MEASURED)
def test_the_range_contains_measured_durations(missing: str, rows: int, seconds: float) -> None:
    expected = diagnosis_seconds(rows, 1)
    assert expected.shortest <= seconds <= expected.longest
    assert expected.shortest < expected.middle < expected.longest <= WIDEST * expected.shortest


@given(rows=st.integers(1, 10**8), processors=st.integers(1, 256))
def test_more_takes_longer_and_more_processors_never_do(rows: int, processors: int) -> None:
    expected = diagnosis_seconds(rows, processors)
    assert min(diagnosis_seconds(2 * rows, processors)) > expected.shortest
    assert diagnosis_seconds(2 * rows, processors).longest > expected.longest
    assert diagnosis_seconds(rows, 2 * processors).longest < expected.longest
    assert diagnosis_seconds(rows, 1).longest / expected.longest <= 3.0 + 1e-9


def test_the_range_is_said_in_words() -> None:
    assert str(diagnosis_seconds(15_000, 1)) == "6 s to 82 s"


def test_a_simulated_vehicle_that_leaves_the_water_is_told():
    z = pl.DataFrame({"session": ["a", "a", "b"], "t": [0.0, 0.1, 0.0], "z": [0.0, -0.3, 2.0]})
    assert above_surface(z) == ""
    told = above_surface(z.with_columns(pl.col("z") - 2.5))
    assert told.startswith("the vehicle leaves the water in session a at 0 s, and rises 2.8 m")
