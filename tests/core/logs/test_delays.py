"""Clocks that disagree: when an offset is plain, and which delays are looked for."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.logs.delays import DELAY_STEP, DELAYS, EARLIEST, LONGEST_DELAY, Offset, _profiled


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("low", "high", "plain"), [(0.19, 0.21, True), (0.05, 0.25, False), (0.15, 0.35, False)]
)
def test_an_offset_is_plain_where_it_is_far_from_zero_by_its_interval(sign, low, high, plain):
    """By the wider side of the interval, and alike for a sensor that is early."""
    ends = sorted((sign * low, sign * high))
    assert Offset("velocity", sign * 0.2, *ends, 0.02).plain is plain


def test_delays_are_looked_for_from_the_earliest_to_the_longest():
    assert DELAYS[0] == EARLIEST
    assert DELAYS[-1] == pytest.approx(LONGEST_DELAY)
    np.testing.assert_allclose(np.diff(DELAYS), DELAY_STEP)


@pytest.mark.parametrize(("noise", "told"), [(0.8, True), (2.0, False)])
def test_a_delay_is_told_only_where_it_is_known_to_half_a_second(noise, told):
    """Nine axes that say the same narrow the interval of one to a third."""
    t, rng = np.arange(200) * 0.25, np.random.default_rng(0)

    def drive(k):
        return np.sin(0.7 * (t - DELAYS[k]))[:, None]

    accelerations = np.sin(0.7 * (t - 0.4)) + noise * rng.standard_normal(len(t))
    alone, all_axes = (
        _profiled(np.tile(accelerations, (axes, 1)).T, np.ones((len(t), 1)), drive, DELAYS, 0.25)
        for axes in (1, 9)
    )
    assert all_axes is not None
    half = 3.0 * (all_axes.high - all_axes.seconds)
    assert all_axes.low < 0.4 < all_axes.high
    assert (half < 0.5) is told
    assert (alone is not None) is told
