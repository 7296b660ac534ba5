"""Shares and their intervals."""

from __future__ import annotations

import pytest
from scipy.stats import binomtest

from benchmarks.shares import interval, rate


@pytest.mark.parametrize(("hits", "count"), [(0, 10), (3, 10), (10, 10), (498, 500)])
def test_intervals_are_clopper_and_pearsons(hits, count):
    exact = binomtest(hits, count).proportion_ci(method="exact")
    assert interval(hits, count) == pytest.approx((exact.low, exact.high))


def test_a_share_in_words():
    assert rate([True] * 38 + [False] * 2) == "95.0 % [83.1, 99.4] (38 of 40)"
    assert rate([]) == "-"
