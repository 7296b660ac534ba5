"""Selection of rows: by part, with validation blocks chosen by content."""

from __future__ import annotations

import hashlib

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.learn import rows


def blocks(count: int, salt: int = 0) -> list[str]:
    return [hashlib.sha256(f"{salt}/{number}".encode()).hexdigest() for number in range(count)]


@given(count=st.integers(2, 60), salt=st.integers(0, 1000), length=st.integers(1, 5), data=st.data())
def test_validation_takes_whole_blocks_and_leaves_some_in_any_order(count, salt, length, data):
    ids = [block for block in blocks(count, salt) for _ in range(length)]
    frame = pl.DataFrame({"block": ids})
    chosen = rows.validation(frame)
    of_block = chosen.reshape(count, length)
    assert (of_block == of_block[:, :1]).all()
    assert 0 < chosen.sum() < len(ids)
    order = np.array(data.draw(st.permutations(range(len(ids)))))
    np.testing.assert_array_equal(rows.validation(frame[order]), chosen[order])


def test_validation_takes_about_a_tenth_of_many_blocks():
    assert rows.validation(pl.DataFrame({"block": blocks(5000)})).mean() == pytest.approx(0.1, abs=0.015)


def test_more_blocks_never_move_a_block():
    few, many = pl.DataFrame({"block": blocks(300)}), pl.DataFrame({"block": blocks(900)})
    np.testing.assert_array_equal(rows.validation(few), rows.validation(many)[:300])


def test_validation_needs_blocks():
    with pytest.raises(DataError, match="column block is missing"):
        rows.validation(pl.DataFrame({"part": ["train"]}))


@pytest.mark.parametrize("part", ["train", "test"])
def test_parts_are_disjoint_and_guard_rows_in_neither(table, part):
    assert rows.of_part(table(400), part)["part"].unique().to_list() == [part]
    assert rows.of_part(table(400), "all").height == 400


@pytest.mark.parametrize("dtype", [pl.Float32, pl.Float64])
def test_arrays_are_float64_rows_of_the_named_columns(table, dtype):
    split = table(100).with_columns(pl.col(pl.Float64).cast(dtype))
    states = rows.states(split)
    assert states.dtype == np.float64
    assert states.shape == (100, 12)
    assert states.flags.c_contiguous
    np.testing.assert_array_equal(states[:, 7], split["v_dot"].to_numpy())
    np.testing.assert_array_equal(rows.wrenches(split)[:, 5], split["N_res"].to_numpy())
