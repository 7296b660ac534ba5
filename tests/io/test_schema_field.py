"""The rules of one column."""

from __future__ import annotations

import polars as pl
import pytest

from hydro.io.schema_field import Constraints, Field, broken


@pytest.mark.parametrize(
    ("values", "repeated"), [(["a", "b", "a", "c", "a"], [2, 4]), ([1, 2, 2], [2]), (["a", "b"], None)]
)
def test_of_a_unique_column_all_rows_but_the_first_of_each_value_are_told(values, repeated):
    series = pl.Series("one", values)
    plain, unique = (
        Field("one", "string", ("string",), "Any.", constraints=Constraints(unique=only))
        for only in (False, True)
    )
    assert list(broken(plain, series)) == []
    found = [(rule, rows.tolist()) for rule, rows in broken(unique, series)]
    assert found == ([] if repeated is None else [("unique", repeated)])
