"""Where rates alone are measured, weak thrusters and a wrong inertia cannot be told apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis.doubts import doubted_gain
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.settings import DOUBTFUL
from hydro.core.recording.arrays import recording

GAIN = Finding("missing", "thruster_gain", ("thruster_gain",), 0.7, confidence=0.95)


@pytest.mark.parametrize(
    ("sampled", "verdict"),
    [
        ("z p q r", "suspect"),
        ("z phi theta psi p q r", "suspect"),
        ("x z p q r", "suspect"),
        ("x y z p q r", "missing"),
        ("u v p q r", "missing"),
    ],
)
def test_a_gain_is_stated_only_if_sensors_show_both_force_and_moment(sampled, verdict):
    vehicle = damped()
    record = recording(vehicle, moved(vehicle, seed=3, rows=200))
    seen = np.tile(np.isin(POSE + VELOCITY, sampled.split()), (record.rows, 1))
    found = doubted_gain(GAIN, replace(record, seen=seen))
    assert found.verdict == verdict
    assert found.confidence == (DOUBTFUL if verdict == "suspect" else 0.95)
    other = replace(GAIN, effect="ocean_current")
    assert doubted_gain(other, replace(record, seen=seen)) == other
    assert doubted_gain(GAIN, record) == GAIN


def test_an_unconfirmed_gain_is_no_more_likely_than_a_confirmed_one_that_is_doubted():
    vehicle = damped()
    record = recording(vehicle, moved(vehicle, seed=3, rows=200))
    rates = replace(record, seen=np.tile(np.isin(POSE + VELOCITY, ["z", "p", "q", "r"]), (record.rows, 1)))
    for before, after in ((0.71, DOUBTFUL), (0.2, 0.2)):
        found = doubted_gain(replace(GAIN, verdict="suspect", confidence=before), rates)
        assert (found.verdict, found.confidence) == ("suspect", after)
        assert found.advice.startswith("rates alone show thrust only relative to the inertia")
