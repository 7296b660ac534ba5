"""What kinematics says of the rates of a body that turns over and over."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import found, log, spoilt

from hydro.core.recording.arrays import Recording, recording
from hydro.core.recording.dead_reckoning import pose_error, rate_bias
from hydro.core.recording.sensor_faults import without_faults
from hydro.core.simulation.sensor_noise import PROFILES, Noise


def read(raw: pl.DataFrame) -> Recording:
    return recording(synthetic.vehicle(), raw)


def test_without_noise_pose_and_velocities_go_the_same_way():
    record = read(log(Noise()))
    for error in pose_error(record, record.nu):
        assert np.abs(error - error[0]).max() < 2e-3


@pytest.mark.parametrize("noise", [Noise(), *PROFILES.values()])
def test_rates_without_a_bias_have_none_whatever_their_scale_is(noise):
    raw = log(noise)
    assert not rate_bias(read(raw)).any()
    assert not rate_bias(read(raw.with_columns(pl.col("p", "r") * 1.05))).any()
    assert not rate_bias(read(raw.head(500))).any()


@pytest.mark.parametrize("noise", list(PROFILES.values()))
def test_a_gyro_s_bias_is_found_reported_and_taken_off(noise):
    raw = log(noise)
    wrong = spoilt(raw, p=raw["p"].to_numpy() + 0.02, r=raw["r"].to_numpy() - 0.01)
    assert rate_bias(read(wrong)) == pytest.approx([0.02, 0.0, -0.01], abs=1e-3)
    corrected = without_faults(synthetic.vehicle(), wrong)
    kept, (fault,) = corrected.raw, corrected.faults
    assert fault.columns == ("p", "r")
    assert fault.message.startswith("p reads +0.0")
    np.testing.assert_allclose(kept["p"], raw["p"], atol=1e-3)
    np.testing.assert_array_equal(kept["q"], raw["q"])
    assert not found(kept).all.any()
