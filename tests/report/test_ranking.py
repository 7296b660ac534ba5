"""Agreement of two rankings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kendalltau

from hydro.core.errors import DataError
from hydro.report.ranking import agreement, no_better


def test_tau_is_1_for_equal_and_minus_1_for_reversed_orders():
    ranks = [[1.0], [2.0], [3.0], [4.0]]
    assert agreement(ranks, ranks).tau == pytest.approx(1.0)
    assert agreement(ranks, ranks[::-1]).tau == pytest.approx(-1.0)
    # one of six pairs is turned round: (5 - 1) / 6
    found = agreement(ranks, [[1.0], [3.0], [2.0], [4.0]])
    assert found.tau == pytest.approx(4 / 6)
    assert -1.0 <= found.low < 0.5
    assert found.high == pytest.approx(1.0)
    assert found.p_value == pytest.approx(2 * 4 / 24)  # 4 of 24 orders agree at least so well


def test_means_over_seeds_are_ranked_and_the_interval_is_of_models_and_seeds():
    rng = np.random.default_rng(0)
    apart = [10.0 * k + rng.normal(size=5) for k in range(5)]
    sure = agreement(apart, [2.0 * values for values in apart])
    assert (sure.tau, sure.low, sure.high) == pytest.approx((1.0, 1.0, 1.0))
    mixed = [1.0 + rng.normal(size=5) for _ in range(5)]
    unsure = agreement(apart, mixed)
    assert unsure.low < 0.9
    assert unsure.low <= unsure.tau <= unsure.high
    assert agreement(apart, mixed) == unsure, "the same draws every time"
    certain = [np.full(5, value) for value in (1.0, 3.0, 2.0, 4.0)]
    few = agreement([np.full(5, float(k)) for k in range(4)], certain)
    assert few.low < few.tau < few.high, "seeds agree, and yet there are only four models"


def test_a_diverged_replay_ranks_last():
    found = agreement([[1.0], [2.0], [3.0]], [[0.1], [0.2], [np.inf]])
    assert found.tau == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("first", "second"), [([[1.0], [2.0]], [[1.0], [2.0]]), ([[1.0]] * 3, [[1.0], [1.0], [1.0, 2.0]])]
)
def test_orders_that_cannot_be_compared_are_refused(first, second):
    with pytest.raises(DataError, match="three models or more"):
        agreement(first, second)


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=3, max_size=9))
def test_tau_with_ties_equals_that_of_scipy(pairs):
    first, second = zip(*pairs, strict=True)
    found = agreement([[float(one)] for one in first], [[float(one)] for one in second])
    expected = kendalltau(first, second).statistic
    assert found.tau == pytest.approx(expected, nan_ok=True)


def test_the_chance_of_being_behind_counts_all_orders_of_the_networks():
    assert no_better([4.0, 5.0, np.inf], [1.0, 2.0, 3.0]) == pytest.approx(1 / 20), "the worst of 20 orders"
    assert no_better([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]) == pytest.approx(1.0)
    assert no_better([2.0], [1.0]) == pytest.approx(0.5), "one seed shows nothing"
