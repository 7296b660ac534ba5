from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.core.recording.segments import gaps, resumes, sample_time, segments, sessions


def table(*sessions: tuple[str, np.ndarray | list[float]]) -> pl.DataFrame:
    return pl.concat(
        [pl.DataFrame({"session": [name] * len(t), "t": np.asarray(t, float)}) for name, t in sessions]
    )


def clock(rows: int, dt: float = 0.02, start: float = 0.0) -> np.ndarray:
    return start + np.arange(rows) * dt


def test_one_segment_per_session():
    frame = table(("a", clock(3)), ("b", clock(4, start=7.0)), ("c", clock(1)))
    assert segments(frame).tolist() == [[0, 3], [3, 7], [7, 8]]
    assert segments(frame).dtype == np.int64
    assert sample_time(frame) == 0.02
    assert resumes(frame, segments(frame)).tolist() == [False, False, False]


def test_a_gap_starts_a_segment_that_resumes_its_session():
    frame = table(("a", [0.0, 0.02, 0.04, 0.08, 0.10]), ("b", clock(2)))
    bounds = segments(frame)
    assert bounds.tolist() == [[0, 3], [3, 5], [5, 7]]
    assert resumes(frame, bounds).tolist() == [False, True, False]


def test_two_sessions_of_one_name_far_apart_are_an_error():
    with pytest.raises(DataError, match=r"session a is not one run of rows.*sort the table"):
        segments(table(("a", clock(3)), ("b", clock(3)), ("a", clock(3, start=1.0))))


@pytest.mark.parametrize("t", [[0.0, 0.02, 0.02, 0.04], [0.0, 0.02, 0.01, 0.03]])
def test_time_that_does_not_rise(t):
    frame = table(("early", clock(4)), ("late", t))
    with pytest.raises(
        DataError, match=r"t \[s\] must rise within a session: 1 of 8 rows.*row 6, session late"
    ):
        segments(frame)


def test_a_step_that_is_neither_sample_nor_gap():
    frame = table(("a", [0.0, 0.02, 0.04, 0.065, 0.085]))
    with pytest.raises(DataError, match=r"row 3, session a, step 0.025 s\); resample"):
        segments(frame)


def test_sessions_of_two_rates_are_an_error():
    with pytest.raises(DataError, match="one constant rate"):
        segments(table(("slow", clock(5, 0.025)), ("fast", clock(9))))


def test_no_rows_and_single_rows():
    with pytest.raises(DataError, match="no rows"):
        segments(table(("a", clock(2))).clear())
    with pytest.raises(DataError, match="no session has two rows"):
        sample_time(table(("a", clock(1)), ("b", clock(1))))


@given(
    st.sampled_from([0.01, 0.02, 0.04, 0.1]),
    st.lists(st.lists(st.integers(2, 30), min_size=1, max_size=4), min_size=1, max_size=5),
    st.integers(0, 2**32 - 1),
)
def test_every_row_is_in_exactly_one_segment(dt, sessions, seed):
    """Sessions of runs separated by gaps, with 0.45 % jitter on each stamp (0.9 % on a step)."""
    rng = np.random.default_rng(seed)
    parts, lengths = [], []
    for k, runs in enumerate(sessions):
        t = np.concatenate([clock(rows, dt, start=1000.0 * i) for i, rows in enumerate(runs)])
        parts.append((f"s{k}", t + rng.uniform(-0.0045, 0.0045, t.size) * dt))
        lengths += runs
    frame = table(*parts)
    bounds = segments(frame)
    assert (bounds[:, 1] - bounds[:, 0]).tolist() == lengths
    assert bounds[0, 0] == 0
    assert bounds[-1, 1] == frame.height
    np.testing.assert_array_equal(bounds[1:, 0], bounds[:-1, 1])
    assert sample_time(frame) == pytest.approx(dt, rel=0.01)
    assert resumes(frame, bounds).tolist() == [i > 0 for runs in sessions for i in range(len(runs))]


def test_gaps_are_counted_and_the_first_is_placed():
    whole = np.arange(10) * 0.02
    broken = np.concatenate([whole, whole + 5.0, whole + 9.0])
    assert gaps(table(("a", whole), ("b", whole + 7.0))) == "", "another session is no gap"
    assert gaps(table(("a", whole), ("b", broken))) == (
        "2 gaps in t, each begins a new segment (first: row 20, session b, from 0.18 to 5 s)"
    )
    assert gaps(table(("a", broken[:20]))).startswith("1 gap in t, ")


def test_sessions_are_listed_in_the_order_of_the_rows():
    rows = np.random.default_rng(0).permutation(np.arange(2, 202))
    listed = sessions(table(*((f"of {count}", clock(count)) for count in rows)))
    assert listed["session"].to_list() == [f"of {count}" for count in rows]
    assert listed["rows"].to_list() == rows.tolist()
    assert set(listed["sample_time"]) == {0.02}
