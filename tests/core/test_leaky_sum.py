"""The leaky sum equals the recursion of scipy's filter."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from hydro.core.leaky_sum import leaky_sum


def test_it_is_a_filter_of_first_order_and_leaves_its_input_alone() -> None:
    values = np.random.default_rng(1).standard_normal((50, 2))
    before = values.copy()
    assert np.array_equal(leaky_sum(values, 0.9), lfilter([1.0], [1.0, -0.9], values, axis=0))
    assert np.array_equal(values, before)
