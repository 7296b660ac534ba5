"""Ballast that slides: relaxation in closed form, the free-surface effect, and energy."""

from __future__ import annotations

import numpy as np
import pytest
from bench import ADDED, BARE, DAMPED, R, equipped
from hypothesis import given
from scipy.integrate import solve_ivp
from strategies import numbers, states

from hydro.core.effects import assemble, effect_wrenches, inertia_matrix
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle import rigid_body

MASS, TRAVEL = (6.0, 4.0), (0.2, 0.1)  # of two weights on their rails


def ballast(tilt=0.2, lag=1.5):
    return {
        "name": "drifting_ballast",
        "S": [MASS[0] * TRAVEL[0], MASS[1] * TRAVEL[1]],
        "tilt": tilt,
        "T": lag,
    }


def moments(effect, eta, dt=0.01):
    """Moment along a motion through attitudes (N, 3)."""
    pose = np.hstack([np.zeros((len(eta), 3)), eta])
    tau = effect_wrenches(
        equipped(effect), pose, np.zeros((len(eta), 6)), [[0, len(eta)]], dt * np.arange(len(eta))
    )
    assert not tau[:, :3].any(), "its weight is in the vehicle's"
    return tau[:, 3:]


@given(numbers(-0.6, 0.6), numbers(-0.6, 0.6), numbers(0.05, 0.8))
def test_held_long_enough_each_weight_lies_where_it_would_on_its_rail(phi, theta, tilt):
    """Two weights at their places less the same at the middle, each down in the world."""
    attitude = np.array([phi, theta, 0.4])
    down = R(np.array([0, 0, 0, *attitude])).T @ [0.0, 0.0, 9.81]
    expected = np.zeros(3)
    for axis in range(2):
        place = np.zeros(3)
        place[axis] = TRAVEL[axis] * np.tanh(down[axis] / 9.81 / tilt)
        expected += np.cross(place, MASS[axis] * down)
    np.testing.assert_allclose(moments(ballast(tilt), attitude[None])[0], expected, atol=1e-10)


@given(numbers(0.3, 5.0), numbers(-0.4, 0.4))
def test_it_slides_after_a_turn_as_an_exponential(lag, phi):
    """From upright to a roll between two rows: at any later one the rest of the way is exp(-t/T)."""
    rows, dt = 300, 0.01
    attitude = np.zeros((rows, 3))
    attitude[1:, 0] = phi
    roll = moments(ballast(lag=lag), attitude, dt)[1:, 0]
    settled = moments(ballast(lag=lag), np.array([[phi, 0.0, 0.0]]))[0, 0]
    left = (
        (settled - roll) / (settled - roll[0])
        if settled != roll[0]
        else np.exp(-np.arange(rows - 1) * dt / lag)
    )
    np.testing.assert_allclose(left, np.exp(-np.arange(rows - 1) * dt / lag), atol=1e-6)


def test_small_and_slow_tilts_feel_a_free_surface():
    """A righting moment as if the centre of gravity stood S/(m tilt) higher, in roll as in pitch."""
    effect = ballast(tilt=1.0)
    for axis, static in ((0, effect["S"][1]), (1, effect["S"][0])):
        attitude = np.zeros((1, 3))
        attitude[0, axis] = 1e-3
        assert moments(effect, attitude)[0, axis] == pytest.approx(9.81 * static * 1e-3, rel=1e-5)
        assert np.sign(moments(effect, attitude)[0, axis]) > 0, "away from upright"


def test_the_lag_makes_damping_of_it():
    """Rolled to and fro at w, the moment is G/(1 + i w T) of the roll: its part behind it brakes."""
    lag, w, size = 0.8, 2.0, 1e-3
    t = np.arange(4000) * 0.01
    attitude = np.zeros((t.size, 3))
    attitude[:, 0] = size * np.sin(w * t)
    roll = moments(ballast(tilt=0.5, lag=lag), attitude)[2000:, 0]
    G = 9.81 * MASS[1] * TRAVEL[1] / 0.5
    answer = G * size * np.imag(np.exp(1j * w * t[2000:]) / (1 + 1j * w * lag))
    np.testing.assert_allclose(roll, answer, atol=2e-4 * G * size)
    assert np.sum(roll * np.cos(w * t[2000:])) < 0.0


@given(states(), numbers(0.05, 0.6), numbers(0.1, 10.0))
def test_energy_never_rises(state, tilt, lag):
    """Of the vehicle, and of the weights in their bowls whose steepness is artanh(x/S)."""
    eta, nu = state
    vehicle = equipped(ADDED, *DAMPED, ballast(tilt, lag))
    t = np.arange(150) * 0.02
    motion = trajectory(assemble(vehicle), np.zeros((150, 2)), t, eta=eta, nu=0.5 * nu)
    down = np.array([R(row)[2, :2] for row in motion[:, :6]])
    S = np.array(ballast()["S"])

    # where the weights are, integrated anew along the motion
    def rate(at, x):
        here = np.array([np.interp(at, t, column) for column in down.T])
        return (S * np.tanh(here / tilt) - x) / lag

    x = solve_ivp(rate, (0.0, t[-1]), S * np.tanh(down[0] / tilt), t_eval=t, max_step=0.02, rtol=1e-8).y.T
    share = np.clip(x / S, -1 + 1e-12, 1 - 1e-12)
    bowl = 9.81 * (tilt * (x * np.arctanh(share) + 0.5 * S * np.log(1.0 - share**2)) - x * down).sum(axis=1)
    mass = rigid_body.mass_matrix(vehicle) + inertia_matrix(vehicle)
    energy = (
        0.5 * np.einsum("ki,ij,kj->k", motion[:, 6:], mass, motion[:, 6:])
        + rigid_body.potential(vehicle, motion[:, 2], motion[:, 3], motion[:, 4])
        + bowl
    )
    assert np.diff(energy).max() <= 2e-3 * 9.81 * S.sum() + 1e-7 * (1.0 + 0.5 * nu @ mass @ nu)
    assert vehicle.buoyancy == BARE.buoyancy
