"""A sample that jumps, beside a step of the motion."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.recording.jumps import jumping

STEP, JUMP = 1.0, 1.2


@pytest.mark.parametrize(("spacing", "told"), [(0.1, True), (0.16, True), (0.18, False), (0.3, False)])
def test_only_where_seven_samples_lie_within_a_second_a_jump_need_not_exceed_what_the_motion_does(
    spacing, told
):
    """Between samples that are farther apart the vehicle may turn back as it does elsewhere."""
    rng = np.random.default_rng(0)
    series = 0.01 * rng.standard_normal(400)
    series[200:] += STEP
    series[100] += JUMP
    (found,) = jumping([series], [1], spacing)
    assert np.flatnonzero(found).tolist() == ([100] if told else [])


def test_a_jump_beyond_all_that_the_motion_does_is_told_however_far_samples_are_apart():
    series = 0.01 * np.random.default_rng(0).standard_normal(400)
    series[200:] += STEP
    series[100] += 2.0 * STEP
    (found,) = jumping([series], [1], 1.0)
    assert np.flatnonzero(found).tolist() == [100]
