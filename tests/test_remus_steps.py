"""The preset with fins, held to the equations and coefficients of Prestero's thesis (2001)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks import remus_steps
from hydro.core.effects import effect_wrenches
from hydro.core.effects.steering import servo_wrenches

CRUISE, FULL = 1.54, math.radians(13.6)
RUDDER, PLANES = 1, 2


@pytest.fixture(scope="module")
def preset():
    return remus_steps.preset()


def commanded(preset, nu, *commands):
    row = np.zeros((1, 6)), np.atleast_2d(np.asarray(nu, float)), [[0, 1]], [0.0]
    return effect_wrenches(preset, *row, np.array([[0.0, *commands]]))[0]


def turned(preset, nu, *commands):
    """Return the change of the wrench by commands of the two fins."""
    return commanded(preset, nu, *commands) - commanded(preset, nu, 0.0, 0.0)


@pytest.mark.parametrize(
    ("commands", "axes", "coefficients"),
    [((0.1, 0.0), (1, 5), (9.64, -6.15)), ((0.0, 0.1), (2, 4), (-9.64, -6.15))],
    ids=["rudder", "stern planes"],
)
def test_a_fin_has_the_force_and_the_moment_of_the_thesis(preset, commands, axes, coefficients):
    """Y_uudr and N_uudr, Z_uuds and M_uuds: the sign, the size and the lever of each fin."""
    found = turned(preset, [CRUISE, 0, 0, 0, 0, 0], *commands)
    expected = np.array(coefficients) * CRUISE**2 * 0.1 * FULL
    np.testing.assert_allclose(found[list(axes)], expected, rtol=0.01)
    others = np.delete(found, [0, *axes])
    np.testing.assert_allclose(others, 0.0, atol=1e-9)


def test_without_flow_a_fin_has_no_force(preset):
    np.testing.assert_array_equal(turned(preset, np.zeros(6), 1.0, -1.0), np.zeros(6))


def test_a_command_beyond_full_turns_a_fin_no_further(preset):
    nu = [CRUISE, 0, 0, 0, 0, 0]
    np.testing.assert_array_equal(turned(preset, nu, 1.4, -3.0), turned(preset, nu, 1.0, -1.0))


def test_servos_steer_by_the_moments_of_their_fins(preset):
    found = servo_wrenches(preset, CRUISE)
    np.testing.assert_array_equal(found[:, 0], np.zeros(6))
    most = 6.15 * CRUISE**2 * FULL
    assert found[5, RUDDER] == pytest.approx(-most, rel=0.05)
    assert found[4, PLANES] == pytest.approx(-most, rel=0.05)
    assert np.abs(found[3]).max() < 1e-9


def test_the_propeller_turns_the_hull_by_the_torque_of_the_thesis(preset):
    from hydro.core.effects.catalogue import thruster_table
    from hydro.core.vehicle.thrusters import UNIT_WRENCH

    np.testing.assert_allclose(3.86 * thruster_table(preset)[0, UNIT_WRENCH][3], -0.543, rtol=1e-3)


def test_a_turn_and_a_dive_follow_the_equations_of_the_thesis(preset):
    thesis = remus_steps.Thesis(remus_steps.COEFFICIENTS)
    start, angle = thesis.trimmed(), math.radians(4.0)
    turn = [thesis.fly(start, angle, 0.0, 4.0), remus_steps.flown(preset, start, angle, 0.0, 4.0)]
    assert turn[0][-1, 11] < -0.1
    np.testing.assert_allclose(turn[1][-1, [5, 11]], turn[0][-1, [5, 11]], rtol=0.02)
    dive = [thesis.fly(start, 0.0, angle, 4.0), remus_steps.flown(preset, start, 0.0, angle, 4.0)]
    assert dive[0][-1, 4] < math.radians(-15.0)
    np.testing.assert_allclose(dive[1][-1, [2, 4]], dive[0][-1, [2, 4]], rtol=0.02)
