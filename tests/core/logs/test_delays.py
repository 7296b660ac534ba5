"""Clocks that disagree: when an offset is plain, and which delays are looked for."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.logs.delays import DELAY_STEP, DELAYS, EARLIEST, LONGEST_DELAY, Offset


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
