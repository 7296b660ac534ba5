"""Noise of the sizes that its specification says."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.errors import DataError
from hydro.core.simulation.sensor_noise import PROFILES, Noise, disturb


@pytest.mark.parametrize("name", PROFILES)
def test_each_column_has_its_standard_deviation(name):
    noise = PROFILES[name]
    motion = np.full((40_000, 12), 0.3)
    deviation = (disturb(motion, noise, np.random.default_rng(0)) - motion).std(axis=0)
    expected = np.repeat([noise.position, noise.attitude, noise.velocity, noise.rate], 3)
    np.testing.assert_allclose(deviation, expected, rtol=0.02, atol=1e-15)


def test_the_profiles_of_the_design():
    assert PROFILES["none"] == Noise(0, 0, 0, 0)
    assert PROFILES["ordinary"] == Noise(velocity=0.01, rate=0.002, position=0.02, attitude=0.001)
    assert PROFILES["dvl"] == Noise(velocity=0.05, rate=0.01, position=0.02, attitude=0.002)


def test_noise_is_white_and_columns_are_independent():
    noisy = disturb(np.zeros((20_000, 12)), Noise(1, 1, 1, 0.3), np.random.default_rng(1))
    correlation = np.corrcoef(np.hstack([noisy[:-1], noisy[1:]]).T)
    assert np.abs(correlation - np.eye(24)).max() < 0.04


def test_angles_stay_angles():
    motion = np.zeros((1000, 12))
    motion[:, 3], motion[:, 4], motion[:, 5] = np.pi, np.pi / 2, -np.pi
    noisy = disturb(motion, Noise(attitude=0.1), np.random.default_rng(0))
    assert np.abs(noisy[:, [3, 5]]).max() <= np.pi
    assert np.abs(noisy[:, 4]).max() <= np.pi / 2
    assert (noisy[:, 3] < 0).any()
    assert (noisy[:, 3] > 0).any()


@pytest.mark.parametrize("wrong", [-0.1, np.nan, np.inf, "big", True, None])
def test_what_is_no_standard_deviation(wrong):
    with pytest.raises(DataError, match="velocity must be a finite number of at least 0"):
        Noise(velocity=wrong)
