"""The hull that is learnt from a recording before; `tests/test_before_command.py` names changes beside it."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from recordings import WEAK, damped, flown

from hydro.core.diagnosis.diagnose import diagnose, hull_of
from hydro.core.diagnosis.findings import SURE
from hydro.core.errors import DataError
from hydro.core.vehicle.description import told_apart

FIN = {
    "name": "control_surface",
    "area": 0.4,
    "position": [-0.5, 0.0, 0.0],
    "roll": 0.0,
    "deflection": 0.0,
    "stall": 0.3,
}


@pytest.fixture(scope="module")
def before():
    return flown(seed=10)


def test_the_hull_is_learnt(before):
    hull = hull_of(damped(), before)
    assert hull.left < 0.5 * hull.given, "the library takes most of the file's error away"


def test_a_recording_before_that_is_too_short(before):
    with pytest.raises(DataError, match=r"too short|too few"):
        hull_of(damped(), before.head(1000))


def test_a_change_of_what_the_file_has_and_is_not_linear_is_named():
    late = {"name": "command_delay", "d": 0.02}
    later = late | {"d": 0.2}
    found = diagnose(damped(late), flown(later, seed=40), before=flown(late, seed=10)).findings[0]
    assert (found.verdict, found.effect) == ("retune", "command_delay")
    assert found.confidence >= SURE
    assert found.parameters["d"] == pytest.approx(0.2, abs=4.0 * found.standard_errors["d"] + 1e-3)


def test_of_two_fins_the_one_that_was_turned_is_named():
    stern, rudder = FIN | {"label": "stern"}, FIN | {"label": "rudder", "roll": np.pi / 2}
    file = told_apart(damped(stern, rudder))
    earlier, later = flown(stern, rudder, seed=10), flown(stern, rudder | {"deflection": 0.2}, seed=40)
    found = diagnose(file, later, before=earlier).findings[0]
    assert (found.verdict, found.effect) == ("retune", "control_surface:rudder")
    assert found.confidence >= SURE


def test_a_velocity_log_that_was_turned_is_told_by_kinematics(before):
    """Far below what the model of the hull leaves, and whatever else has changed."""
    raw, yaw = flown(WEAK, seed=40), 0.06
    u, v = pl.col("u"), pl.col("v")
    turned = raw.with_columns(u * np.cos(yaw) + v * np.sin(yaw), v * np.cos(yaw) - u * np.sin(yaw))
    log, thruster = diagnose(damped(), turned, before=before).findings[:2]
    assert (log.verdict, log.effect) == ("missing", "sensor_misalignment")
    assert log.confidence >= SURE
    assert log.parameters["alpha"] == pytest.approx([0.0, 0.0, yaw], abs=0.005)
    assert "or the heading is off by -0.0" in log.advice
    assert (thruster.verdict, thruster.effect) == ("missing", "thruster_gain")
