"""Parquet with the types that dataframes have: durations, lists, structs."""

from __future__ import annotations

import io
from datetime import timedelta

import numpy as np
import polars as pl
import pytest

from hydro.core.errors import DataError
from hydro.io import log, logmap
from hydro.io.sessions import sessions

MAP = """
[time]
column = "t"
[position]
columns = ["pose.position[0]", "pose.position[1]", "pose.position[2]"]
[commands]
columns = ["cmd[0]", "cmd[1]"]
"""


def read(frame: pl.DataFrame) -> log.Log:
    sink = io.BytesIO()
    frame.write_parquet(sink)
    return log.read(io.BytesIO(sink.getvalue()))


def nested() -> pl.DataFrame:
    return pl.DataFrame(
        {
            "t": [timedelta(milliseconds=50 * i) for i in range(4)],
            "pose": [{"position": [1.0 * i, 2.0 * i, 3.0], "ok": True} for i in range(4)],
            "cmd": pl.Series([[0.1 * i, -0.1] for i in range(4)], dtype=pl.Array(pl.Float64, 2)),
            "wait": [timedelta(seconds=i) for i in range(4)],
        }
    )


def test_durations_lists_and_structs_are_columns():
    (found,) = sessions(read(nested()), logmap.parse(MAP))
    np.testing.assert_allclose(found.t, [0.0, 0.05, 0.1, 0.15], atol=1e-12)
    np.testing.assert_array_equal(found.columns["pose.position[1]"], [0.0, 2.0, 4.0, 6.0])
    np.testing.assert_array_equal(found.columns["cmd[0]"], [0.1 * i for i in range(4)])


def test_a_duration_is_a_number_of_seconds():
    assert log.numbers(read(nested()), "wait", "rates").tolist() == [0.0, 1.0, 2.0, 3.0]


def test_lists_of_several_lengths_are_empty_where_they_end_and_long_ones_are_told():
    found = read(pl.DataFrame({"t": [0.0, 1.0], "a": [[1.0], [2.0, 3.0]], "image": [[0] * 500, [1] * 500]}))
    np.testing.assert_array_equal(log.numbers(found, "a[1]", "rates"), [np.nan, 3.0])
    assert found.table.columns == ["t", "a[0]", "a[1]"]
    assert found.notes == ("image holds up to 500 elements a row and is not read (at most 64)",)


def test_text_where_numbers_belong_is_still_refused():
    with pytest.raises(DataError, match="column a must be numbers, but is Binary"):
        log.numbers(read(pl.DataFrame({"t": [0.0], "a": [b"x"]})), "a", "rates")
