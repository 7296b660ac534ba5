"""Past velocities: the columns of training and the kernel of a flight remember the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.distillation import history
from hydro.core.errors import DataError


@given(window=st.integers(1, 5), rows=st.integers(1, 12))
def test_columns_are_what_a_flight_remembers(window, rows):
    nu = np.random.default_rng(rows).normal(size=(rows, 6))
    columns = history.past(nu, [(0, rows)], window, 1)
    memory = np.empty(history.memory_size(window))
    history.begin(nu[0], memory)
    for row in range(rows):
        np.testing.assert_array_equal(columns[row], memory)
        history.remember(nu[row], memory)


def test_newest_first_a_stride_apart_and_never_across_a_gap():
    nu = np.arange(8.0)[:, None] * np.ones(6)
    columns = history.past(nu, [(0, 5), (5, 8)], 3, 2)
    assert history.names(3)[:2] == ("u-1", "v-1")
    assert history.names(3)[6] == "u-2"
    np.testing.assert_array_equal(columns[:, 0], [0, 0, 0, 1, 2, 5, 5, 5])
    np.testing.assert_array_equal(columns[:, 6], [0, 0, 0, 0, 0, 5, 5, 5])


def test_period_and_sample_time():
    assert history.stride(0.04, 0.02) == 2
    assert history.stride(0.04, 0.04) == 1
    for dt in (0.03, 0.1):
        with pytest.raises(DataError, match=r"0\.04 s apart, which is not a multiple"):
            history.stride(0.04, dt)
