"""Attitudes near the vertical are smoothed as turns about body axes; the turns are those of scipy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from hydro.core.evaluation.smoothed_motion import _turned_back, turned
from hydro.core.vehicle.frames import euler_from_quaternion

RNG = np.random.default_rng(1)
ATTITUDE = np.cumsum(0.2 * RNG.normal(size=(300, 3)), axis=0)
ROTATION = Rotation.from_euler("ZYX", ATTITUDE[:, ::-1])


def test_the_turn_up_to_a_row_is_the_sum_of_turns_from_row_to_row() -> None:
    steps = (ROTATION[:-1].inv() * ROTATION[1:]).as_rotvec()
    expected = np.concatenate([np.zeros((1, 3)), steps.cumsum(axis=0)])
    np.testing.assert_allclose(turned(ATTITUDE), expected, atol=1e-12)


def test_angles_after_a_small_turn_are_those_of_the_turned_attitude() -> None:
    turn = 0.1 * RNG.normal(size=ATTITUDE.shape)
    turn[0] = 0.0
    expected = (ROTATION * Rotation.from_rotvec(turn)).as_quat(scalar_first=True)
    np.testing.assert_allclose(_turned_back(ATTITUDE, turn), euler_from_quaternion(expected), atol=1e-12)
