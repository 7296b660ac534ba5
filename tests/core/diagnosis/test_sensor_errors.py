"""Errors of a DVL that are new in a recording."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import damped

from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.sensor_errors import (
    by_kinematics,
    new_sensor_errors,
    sensor_finding,
    sure_by_kinematics,
)
from hydro.core.preprocessing.sensor_tests import KinematicTest

FILE = damped()


def late(d, error=1e-3):
    return {"sensor_delay": KinematicTest("sensor_delay", np.array([d]), np.array([[error**2]]), 100, 5e-3)}


def names(after, before, vehicle=FILE):
    return [one.effect for one in new_sensor_errors(after, before, vehicle)]


def test_a_sensor_error_only_in_the_later_recording_is_new():
    assert names(late(0.1), late(0.0)) == ["sensor_delay"]


@pytest.mark.parametrize(
    ("after", "before"),
    [
        (late(0.0), late(0.0)),
        (late(0.1), late(0.1)),  # it is no change
        (late(0.1), late(0.08, error=0.02)),  # nor can this be told from none
        (late(0.008), late(0.004)),  # nor does it matter
        (late(0.1), {}),  # the one before was not to be asked
        ({}, late(0.1)),
    ],
)
def test_sensor_errors_without_a_significant_change_are_not_new(after, before):
    assert names(after, before) == []


def test_a_changed_sensor_error_is_new():
    assert names(late(0.2), late(0.1)) == ["sensor_delay"]


def test_a_sensor_error_in_the_file_is_not_new():
    assert names(late(0.1), late(0.0), damped({"name": "sensor_delay", "d": 0.1})) == []
    assert names(late(0.2), late(0.0), damped({"name": "sensor_delay", "d": 0.1})) == ["sensor_delay"]


def test_a_sensor_finding_has_the_values_of_kinematics():
    (test,) = late(0.1).values()
    found = sensor_finding(test, 0.4, 0.02, FILE)
    assert (found.verdict, found.effect, found.share) == ("missing", "sensor_delay", 0.4)
    assert found.parameters == {"d": 0.1}
    assert found.standard_errors == pytest.approx({"d": 1e-3})
    assert sensor_finding(test, 0.4, 0.02, damped({"name": "sensor_delay", "d": 0.02})).verdict == "retune"


def test_values_count_as_kinematic_only_if_they_equal_the_kinematic_ones():
    tests = late(0.1)
    assert by_kinematics({"name": "sensor_delay", "d": 0.1, "standard_error": {"d": 1e-3}}, tests)
    assert not by_kinematics({"name": "sensor_delay", "d": 0.12}, tests)
    assert not by_kinematics({"name": "command_delay", "d": 0.1}, tests)
    assert not by_kinematics({"name": "sensor_delay", "d": 0.0}, late(0.0)), "nothing is shown"


def test_kinematics_alone_gives_the_confidence_in_a_sensor_error():
    """Error that no force explains does not lower it."""
    found = Finding("missing", "sensor_delay", ("sensor_delay",), 0.26, confidence=0.6, advice="shift it")
    named = sure_by_kinematics(found, late(0.1))
    assert named is not None
    assert (named.verdict, named.share) == ("missing", 0.26)
    assert named.confidence > 0.99
    assert "whatever forces act" in named.advice
    assert sure_by_kinematics(found, late(0.0)) is None, "kinematics shows nothing"
    assert sure_by_kinematics(found, {}) is None, "kinematics could not be asked"
    unsure = Finding("cannot_tell_apart", "sensor_delay", ("sensor_delay", "command_delay"), confidence=0.6)
    assert sure_by_kinematics(unsure, late(0.1)) is None
