"""Attitude sensor that is turned against the vehicle: the log is turned back, and the map can say so."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import log

from hydro.core.columns import MOTION
from hydro.core.diagnosis import mounting
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.mounting import turned_back, with_mounting
from hydro.core.logs import conventions
from hydro.core.logs.logmap import Attitude, Mount
from hydro.core.preprocessing.sensor_tests import KinematicTest
from hydro.core.vehicle.frames import euler_from_rotation, rotation

PITCHED = np.array([0.0, -np.radians(8.0), 0.0])  # DVL against an attitude sensor that is pitched up
TEST = KinematicTest("sensor_misalignment", PITCHED, 1e-6 * np.eye(3), 40, 0.005, 1e3)


@pytest.fixture(scope="module")
def right() -> pl.DataFrame:
    return log()


@pytest.fixture(scope="module")
def turned(right) -> pl.DataFrame:
    """The same recording with attitude and rates of the pitched sensor."""
    angles, rates = (right.select(names).to_numpy() for names in (MOTION[3:6], MOTION[9:12]))
    back = rotation(*PITCHED)
    euler = euler_from_rotation(rotation(*angles.T) @ back.T)
    columns = zip((*MOTION[3:6], *MOTION[9:12]), np.hstack([euler, rates @ back.T]).T, strict=True)
    return right.with_columns(pl.Series(name, values) for name, values in columns)


def test_a_turned_recording_is_turned_back(right, turned):
    found = turned_back(turned, PITCHED)
    there, back = (rotation(*one.select(MOTION[3:6]).to_numpy().T) for one in (right, found))
    np.testing.assert_allclose(back, there, atol=1e-9)
    rates = [one.select(MOTION[9:12]).to_numpy() for one in (right, found)]
    np.testing.assert_allclose(rates[1], rates[0], atol=1e-12)


def test_missing_samples_stay_missing(turned):
    gaps = turned.with_columns(pl.when(pl.int_range(pl.len()) % 2 == 0).then("theta").alias("theta"))
    assert turned_back(gaps, PITCHED)["theta"].null_count() == gaps["theta"].null_count()


@pytest.mark.parametrize(("back", "dvl"), [(1.0, 3.0), (3.0, 1.0)])
def test_the_sensor_is_turned_whose_correction_predicts_better(monkeypatch, turned, back, dvl):
    given = Preprocessed(turned, SimpleNamespace(), ())
    monkeypatch.setattr(mounting, "preprocess", lambda vehicle, raw, hull: Preprocessed(raw, None, ()))

    def misfit(vehicle, of):
        return dvl if vehicle.effects("sensor_misalignment") else back

    found = with_mounting(synthetic.vehicle(), given, [TEST], misfit)
    if dvl < back:
        assert found is given
        return
    (fault,) = found.faults
    assert "pitch 8 ± 0.057°" in fault.advice
    assert "pitch = 8.00" in fault.advice


def test_a_map_turns_the_attitude_of_a_mounted_sensor_to_the_body(turned, right):
    sensor = rotation(*turned.select(MOTION[3:6]).to_numpy().T)
    block = Attitude(columns=("a", "b", "c"), mount=Mount(pitch=8.0))
    body = rotation(*right.select(MOTION[3:6]).to_numpy().T)
    np.testing.assert_allclose(conventions.in_frames(block, sensor), body, atol=1e-9)
