"""Numbers that mark missing values are refused with the line of the map that leaves them out."""

from __future__ import annotations

import io

import logs
import numpy as np
import pytest

from hydro.core.errors import DataError
from hydro.core.logs.importing import raw_table
from hydro.core.logs.missing_marks import refuse_marks
from hydro.io import log, logmap
from hydro.io.sessions import sessions


def imported(column: str, mark: float, valid: str = ""):
    frame = logs.raw(10.0).drop("session")
    values = frame[column].to_numpy().copy()
    values[20:120:4] = mark
    source = log.read(io.BytesIO(frame.with_columns(**{column: values}).write_csv().encode()))
    meaning = logmap.parse(logs.PLAIN_TEXT.replace("[rates]", f"{valid}\n[rates]"))
    return raw_table(sessions(source, meaning), meaning)


@pytest.mark.parametrize(
    ("column", "mark", "where"),
    [("w", -9999.0, "velocity"), ("psi", -32.768, "attitude"), ("z", 65535.0, "position")],
)
def test_a_mark_is_refused_with_the_line_that_leaves_it_out(column, mark, where):
    with pytest.raises(DataError) as caught:
        imported(column, mark)
    told = f"column {column} is {mark:.8g} in 25 of "
    assert told in str(caught.value)
    assert f"set {where}.valid = {{not = {mark:.8g}}}" in str(caught.value)


def test_the_line_of_the_map_leaves_it_out():
    found = imported("w", -9999.0, "valid = {not = -9999}")
    assert found.frame["w"].min() > -50.0
    assert "25 samples are not valid" in found.notes[0]


@pytest.mark.parametrize(
    "values",
    [
        [0.1, 0.2, -9999.0, 0.3],  # one alone
        [0.1, 0.2, -9998.0, -9998.0],  # no mark
        [998.9, 999.0, 999.0, 999.1],  # a position on its way
        [99.0, 99.0, np.nan, 99.0],  # nothing else
        [np.nan, np.nan],
        [],
    ],
)
def test_what_is_no_mark_passes(values):
    refuse_marks("velocity", [{"u": np.array(values)}, {"u": np.array(values[:1])}], ["u"])


def test_marks_of_several_sessions_are_counted_together():
    parts = [{"u": np.array([0.1, 999.0])}, {"u": np.array([999.0, -0.2])}]
    with pytest.raises(DataError, match="column u is 999 in 2 of 4 samples"):
        refuse_marks("velocity", parts, ["u"])
