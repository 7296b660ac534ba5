"""Noise of velocities that lasts, put into the log of a body that turns over and over."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import DT, tumbling
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from hydro.core.columns import POSE, VELOCITY
from hydro.core.prediction.normal_equations import Normal
from hydro.core.preprocessing.coloured import POSE_CHANNELS, coloured, velocity_noise
from hydro.core.preprocessing.sensor_tests import kinematic_tests
from hydro.core.recording.arrays import noise, recording
from hydro.core.simulation.sensor_noise import PROFILES, Noise, disturb

LASTS = 1.0  # s
SIZE = np.repeat([0.01, 0.004], 3)
CLOSE = Noise(velocity=0.01, rate=0.002, position=0.002, attitude=0.001)


def logged(
    white: Noise = PROFILES["ordinary"],
    size: np.ndarray | None = None,
    walk: float = 0.0,
    seconds: float = 80.0,
):
    """So much of a recording; with noise of the velocities as an Ornstein-Uhlenbeck process, or a pose that
    wanders.
    """
    t, x, R, v, omega = tumbling()
    rng, keep = np.random.default_rng(3), np.exp(-DT / LASTS)
    motion = disturb(np.hstack([x, Rotation.from_matrix(R).as_euler("ZYX")[:, ::-1], v, omega]), white, rng)
    if size is not None:
        draws = rng.standard_normal((len(t), 6)) * size * np.sqrt(1.0 - keep**2)
        motion[:, POSE_CHANNELS:] += lfilter([1.0], [1.0, -keep], draws, axis=0)
    motion[:, :3] += walk * np.sqrt(DT) * rng.standard_normal((len(t), 3)).cumsum(axis=0)
    table = pl.DataFrame(np.column_stack([t, motion]), schema=["t", *POSE, *VELOCITY])
    still = [pl.lit(0.0).alias(f"cmd_{i + 1}") for i in range(8)]
    return recording(
        synthetic.vehicle(),
        table.head(round(seconds / DT)).with_columns(pl.lit("a").alias("session"), *still),
    )


def weighed(record, left: np.ndarray) -> np.ndarray:
    """Deviations where a model leaves so much of each channel, in units of the white noise, (12,)."""
    channels, rows = left[None] ** 2 * 100.0, 100 * len(left)
    normal = Normal(np.full((1, 1, 1), channels.sum()), rows, channels, np.zeros((1, 0, 1)))
    return coloured(noise(record), normal, record, kinematic_tests(record))


@pytest.mark.parametrize("white", [PROFILES["ordinary"], PROFILES["dvl"]])
def test_white_noise_is_no_more_than_it_is(white):
    record = logged(white)
    np.testing.assert_array_equal(
        velocity_noise(record, kinematic_tests(record)), noise(record)[POSE_CHANNELS:]
    )
    assert (weighed(record, np.full(12, 5.0)) == noise(record)).all()


def test_noise_that_lasts_weighs_as_the_white_noise_that_errs_as_much_over_two_seconds():
    """The mean of an OU process over T against white noise: 2 tau / dt (1 - tau / T (1 - exp(-T / tau)))."""
    record = logged(CLOSE, SIZE)
    found = velocity_noise(record, kinematic_tests(record))
    longest = 2.0 * LASTS / DT * (1.0 - LASTS / 2.0 * (1.0 - np.exp(-2.0 / LASTS)))
    expected = np.sqrt(SIZE**2 * longest + noise(record)[POSE_CHANNELS:] ** 2)
    np.testing.assert_allclose(found, expected, rtol=0.4)


def test_noise_that_lasts_shows_in_less_than_half_a_minute():
    """There are slopes enough of half a second each, and too few of longer ones."""
    record = logged(CLOSE, 3.0 * SIZE, seconds=24.0)
    assert (velocity_noise(record, kinematic_tests(record)) > 3.0 * noise(record)[POSE_CHANNELS:]).all()


def test_velocities_weigh_less_only_where_a_model_leaves_what_their_noise_leaves():
    record = logged(CLOSE, SIZE)
    left = np.ones(12)
    assert (weighed(record, left) == noise(record)).all()
    left[6:] = 3.0
    sigma = weighed(record, left)
    np.testing.assert_allclose(sigma[:POSE_CHANNELS], noise(record)[:POSE_CHANNELS] * np.sqrt(0.5))
    assert (sigma[POSE_CHANNELS:] > 3.0 * noise(record)[POSE_CHANNELS:]).all()


def test_a_position_that_wanders_is_no_noise_of_the_velocities():
    record = logged(walk=0.1)
    left = np.repeat([3.0, 1.0, 1.0, 1.0], 3)
    assert (weighed(record, left) == noise(record)).all()


def test_a_pose_without_noise_says_nothing():
    record = logged(Noise(velocity=0.01, rate=0.002), size=SIZE)
    assert (weighed(record, np.full(12, 5.0)) == noise(record)).all()
