"""Errors 5 s ahead where a vehicle file, or a recording, is the truth."""

from __future__ import annotations

import msgspec
import pytest
from sim.effects import preset, with_effect

from hydro.core.difference.ahead import Errors, flights
from hydro.core.errors import DataError


@pytest.fixture(scope="module")
def craft(datasets):
    return preset(datasets, "remus100")


@pytest.fixture(scope="module")
def errors(craft):
    return Errors(craft)


def test_the_true_vehicle_is_off_by_smoothing_alone(craft, errors):
    assert errors.own == errors.of(craft) < 1e-3


def test_an_error_grows_with_the_difference(craft, errors):
    """A current is a shift of velocity: twice of it is twice as wrong, and no prediction is off by more."""
    found = []
    for speed in (0.05, 0.1):
        drift = {"name": "ocean_current", "v_N": speed, "v_E": 0.0, "v_D": 0.0}
        found.append(errors.of(msgspec.structs.replace(craft, effect=(*craft.effect, drift))))
    assert 0.0 < found[0] < 0.05
    assert found[1] == pytest.approx(2.0 * found[0], rel=0.3)


def test_errors_of_the_velocity_log_are_no_motion(craft, errors):
    assert errors.of(with_effect_of_the_log(craft)) == errors.own


def with_effect_of_the_log(craft):
    bias = {"name": "sensor_bias", "b": [0.1, 0.0, 0.0]}
    return msgspec.structs.replace(craft, effect=(*craft.effect, bias))


def test_on_a_recording_they_stand_beside_the_vehicles_own(craft):
    other = with_effect(craft, "net_buoyancy")
    raw = flights(other).head(3000)
    recorded = Errors(craft, raw)
    assert recorded.own > 0.01
    assert recorded.of(other) < 0.1 * recorded.own
    assert recorded.of(with_effect_of_the_log(other)) > 2.0 * recorded.of(other), "which was logged"


def test_a_vehicle_without_thrusters_cannot_fly(craft):
    with pytest.raises(DataError, match="cannot run a manoeuvre"):
        flights(msgspec.structs.replace(craft, thruster=()))
