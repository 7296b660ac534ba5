"""Advice in words: what to record, and what is a convention of the log."""

from __future__ import annotations

import numpy as np

from hydro.core.effects import CATALOGUE
from hydro.core.experiment import advice
from hydro.core.experiment.library import Manoeuvre
from hydro.core.experiment.manoeuvres import Flight


def test_advice_names_the_manoeuvre_its_duration_and_the_expected_difference():
    sweep = Manoeuvre("x", "turn slowly", np.zeros((10, 1)))
    clear = advice.separating(["ocean_current", "tether"], Flight(sweep, 42.0))
    assert clear == (
        "to separate them: turn slowly (predicted difference in 30 s: 42 times the sensor noise)"
    )
    assert "turn slowly, for 12 min or more" in advice.separating(["ocean_current"], Flight(sweep, 2.0))
    assert "too little" in advice.separating(["ocean_current"], Flight(sweep, 0.1))
    assert "turn slowly" in advice.exciting("body_lift", [], Flight(sweep, 42.0))
    assert CATALOGUE["body_lift"].excitation in advice.exciting("body_lift", [], Flight(sweep, 1.0))


def test_commands_logged_a_row_late_look_like_quick_thrusters():
    assert "shift the command columns" in advice.adding("thruster_lag", {"dT": -0.0218}, 0.02)
    assert "Euler" in advice.adding("thruster_lag", {"dT": -0.0104}, 0.02)
    assert "hydro add" in advice.adding("thruster_lag", {"dT": -0.08}, 0.02)
    assert "hydro add" in advice.adding("thruster_lag", {"dT": 0.0218}, 0.02)


def test_a_curve_that_a_file_can_name_is_named():
    assert 'curve = "quadratic"' in advice.adding("thruster_curve", {"da": 0.98}, 0.02)
    assert 'curve = "linear"' in advice.adding("thruster_curve", {"da": -1.02}, 0.02)
    assert "[[thruster]]" not in advice.adding("thruster_curve", {"da": 0.5}, 0.02)
