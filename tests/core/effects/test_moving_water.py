"""Currents that vary with depth and time: against balances of momentum in the world frame, and labels."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest
from bench import BARE, DAMPED, R, equipped, neutral
from hypothesis import given, settings
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from strategies import numbers, spd_matrices, states, vectors

from hydro.core.columns import Array
from hydro.core.effects import assemble, effect_forces, effect_wrenches, inertia_matrix
from hydro.core.effects.catalogue import current
from hydro.core.effects.columns import through_water
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle import rigid_body

G = np.array([0.12, -0.07])
SHEAR = {"name": "current_shear", "g_N": 0.12, "g_E": -0.07, "z_0": 4.0}
TURN = np.array([0.05, -0.03])
TREND = {"name": "current_trend", "a_N": 0.05, "a_E": -0.03, "t_0": 101.0}
BEGIN = 100.0  # no time of TREND's
STREAM = {"name": "ocean_current", "v_N": 0.2, "v_E": 0.1, "v_D": 0.0}


def water(z: float, t: float | None = None) -> Array:
    """Velocity of the water of SHEAR and STREAM at a depth, and of TREND at a time since BEGIN."""
    there = np.array([0.2 + 0.12 * (z - 4.0), 0.1 - 0.07 * (z - 4.0), 0.0])
    return there if t is None else there + np.append(TURN * (t + BEGIN - 101.0), 0.0)


def moved(vehicle: Any, t: Array, eta: Array, nu: Array) -> Array:
    """Motion without commands."""
    return trajectory(assemble(vehicle), np.zeros((t.size, len(vehicle.thruster))), t, eta=eta, nu=nu)


def test_a_light_sphere_sinks_through_shear_as_newton_says_in_the_world():
    """A sphere turns freely, so its balance stands in the world alone: m a = W + m_A (v_c_dot - a) - d v_r.

    Its centres are at CO and it is heavier than water; v_c_dot = G z_dot acts through the added mass alone.
    """
    mass, added, drag, heavy = 50.0, 27.0, 18.0, 15.0
    vehicle = equipped(
        {"name": "added_mass", "diagonal": [added] * 3 + [0.0] * 3},
        {"name": "linear_damping", "diagonal": [drag] * 3 + [0.0] * 3},
        {"name": "net_buoyancy", "dB": -heavy},
        SHEAR,
        STREAM,
        bare=neutral(mass, (3.0, 3.0, 3.0)),
    )
    eta, nu, t = (
        np.array([0.0, 0, 2.0, 0.4, -0.3, 1.1]),
        np.array([0.5, -0.2, 0.1, 0.3, 0.2, -0.4]),
        np.linspace(0, 10, 501),
    )

    def rate(_: float, y: Array) -> Array:
        stirred = np.array([G[0] * y[5], G[1] * y[5], 0.0])
        force = np.array([0.0, 0.0, heavy]) - drag * (y[3:] - water(y[2])) + added * stirred
        return np.concatenate([y[3:], force / (mass + added)])

    first = np.concatenate([eta[:3], R(eta) @ nu[:3]])
    expected = solve_ivp(rate, (0.0, 10.0), first, t_eval=t, rtol=1e-10, atol=1e-12).y.T
    found = moved(vehicle, t, eta, nu)
    world = Rotation.from_euler("ZYX", found[:, [5, 4, 3]]).apply(found[:, 6:9])
    np.testing.assert_allclose(np.hstack([found[:, :3], world]), expected, atol=1e-7)


def test_any_body_obeys_the_balances_of_momentum_in_the_world():
    """Linear and angular momentum of the dry body about its centre of gravity, Kirchhoff's of the water."""
    matrix = (np.diag([20.0, 60, 70, 2, 8, 9]) + 0.8 * np.ones((6, 6))).tolist()
    vehicle = equipped({"name": "added_mass", "matrix": matrix}, *DAMPED, SHEAR, TREND, STREAM)
    body, M = BARE.rigid_body, np.array(matrix)
    center, inertia = np.array(body.center_of_gravity), np.array(body.inertia)
    linear, quadratic = (np.array(table["diagonal"]) for table in DAMPED)
    eta, nu, t = (
        np.array([0.0, 0, 3.0, 0.3, -0.4, 0.7]),
        np.array([1.0, -0.3, 0.6, 0.3, 0.4, 0.2]),
        np.linspace(0, 4, 201),
    )

    def rate(t: float, y: Array) -> Array:
        turn, v, w = Rotation.from_quat(y[3:7]), y[7:10], y[10:13]  # v in the world, w in the body
        Q = turn.as_matrix()
        n = np.concatenate([Q.T @ (v - water(y[2], t)), w])
        damp = -(linear + quadratic * np.abs(n)) * n
        weight, lift = Q.T @ [0, 0, body.mass * 9.81], Q.T @ [0, 0, -BARE.buoyancy.force]
        lift += Q.T @ np.append(TURN, 0.0) * BARE.buoyancy.force / 9.81  # the water accelerates as one
        force = damp[:3] + weight + lift
        moment = damp[3:] + np.cross(center, weight) + np.cross(BARE.buoyancy.center, lift)
        # Kirchhoff: (d/dt + w x) of the water's momentum M n, with the Munk moment v_r x p
        p, h = np.split(M @ n, 2)
        force -= np.cross(w, p)
        moment -= np.cross(w, h) + np.cross(n[:3], p)
        # nu_r_dot = a - [w x v_r; 0] less the water's rate, a the acceleration of CO in body axes
        seen = np.concatenate([-np.cross(w, n[:3]) - Q.T @ np.append(G * v[2] + TURN, 0.0), np.zeros(3)])
        rest = np.concatenate([force, moment]) - M @ seen
        # the dry body: f = m (a + w' x c + w x w x c), moment about CO
        rest[:3] -= body.mass * np.cross(w, np.cross(w, center))
        rest[3:] -= np.cross(w, inertia @ w) + np.cross(center, body.mass * np.cross(w, np.cross(w, center)))
        S = np.array([[0, -center[2], center[1]], [center[2], 0, -center[0]], [-center[1], center[0], 0]])
        dry = np.block(
            [[body.mass * np.eye(3), -body.mass * S], [body.mass * S, inertia - body.mass * S @ S]]
        )
        a = np.linalg.solve(dry + M, rest)
        spin = 0.5 * np.array([*(y[6] * w + np.cross(y[3:6], w)), -y[3:6] @ w])
        return np.concatenate([v, spin, Q @ a[:3], a[3:]])

    turn = Rotation.from_euler("ZYX", eta[[5, 4, 3]])
    first = np.concatenate([eta[:3], turn.as_quat(), turn.apply(nu[:3]), nu[3:]])
    expected = solve_ivp(rate, (0.0, 4.0), first, t_eval=t, rtol=1e-10, atol=1e-12).y.T
    found = moved(vehicle, BEGIN + t, eta, nu)
    turns = Rotation.from_euler("ZYX", found[:, [5, 4, 3]])
    np.testing.assert_allclose(found[:, :3], expected[:, :3], atol=1e-6)
    np.testing.assert_allclose(turns.apply(found[:, 6:9]), expected[:, 7:10], atol=1e-6)
    np.testing.assert_allclose(found[:, 9:], expected[:, 10:], atol=1e-6)


@given(states(), numbers(-0.2, 0.2), numbers(0.0, 20.0))
def test_about_its_depth_a_shear_is_no_current_and_elsewhere_a_current_of_that_depth(state, growth, depth):
    """Without diving only the velocity at the depth counts: damping is that in a uniform current."""
    eta, nu = state
    nu = nu.copy()
    nu[:3] -= (R(eta)[2] @ nu[:3]) * R(eta)[2]  # level way
    there = growth * (eta[2] - depth)

    def felt(*more: dict[str, Any]) -> Array:
        return effect_wrenches(equipped(*DAMPED, *more), eta[None], nu[None], [[0, 1]], [0.0])[0]

    sheared = felt({"name": "current_shear", "g_E": growth, "z_0": depth})
    np.testing.assert_allclose(sheared, felt({"name": "ocean_current", "v_E": there}), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        felt({"name": "current_shear", "g_E": growth, "z_0": eta[2]}), felt(), rtol=1e-9, atol=1e-9
    )


@settings(max_examples=20)
@given(states(), spd_matrices(scale=40.0), vectors(2, 0.2), vectors(2, 0.1), numbers(-9.0, 9.0))
def test_labels_of_effects_balance_the_acceleration(state, matrix, growth, turning, when):
    """M nu_dot = effect forces and those of the dry body, as `labels --subtract effects` takes them apart."""
    eta, nu = state
    shear = {"name": "current_shear", "g_N": float(growth[0]), "g_E": float(growth[1]), "z_0": 2.0}
    trend = {"name": "current_trend", "a_N": float(turning[0]), "a_E": float(turning[1]), "t_0": 3.0}
    vehicle = equipped({"name": "added_mass", "matrix": matrix.tolist()}, *DAMPED, shear, trend, STREAM)
    vehicle = msgspec.structs.replace(vehicle, thruster=())
    h = 1e-6
    motion = moved(vehicle, when + np.array([0.0, h, 2 * h]), eta, nu)
    nu_dot = (motion[2, 6:] - motion[0, 6:]) / (2 * h)
    here = motion[1:2]
    forces = effect_forces(vehicle, here[:, :6], here[:, 6:], [[0, 1]], [when + h])[0]
    mass, dry = rigid_body.mass_matrix(vehicle) + inertia_matrix(vehicle), rigid_body.mass_matrix(vehicle)
    coriolis = rigid_body.coriolis_matrix(dry, here[0, 6:]) @ here[0, 6:]
    bare = rigid_body.restoring(vehicle, here[0, 3], here[0, 4])
    np.testing.assert_allclose(mass @ nu_dot, forces + bare - coriolis, rtol=1e-5, atol=2e-3)


@given(states(), vectors(2, 0.3), numbers(0.0, 9.0), numbers(-50.0, 50.0))
def test_columns_and_kernels_know_the_same_motion_through_the_water(state, growth, depth, when):
    eta, nu = state
    shear = {"name": "current_shear", "g_N": float(growth[0]), "g_E": float(growth[1]), "z_0": depth}
    vehicle = equipped(STREAM, shear, TREND, {"name": "linear_damping", "diagonal": [1.0] * 6})
    still = equipped(STREAM, shear, TREND)
    felt = [effect_wrenches(one, eta[None], nu[None], [[0, 1]], [when])[0] for one in (vehicle, still)]
    expected = through_water(current(vehicle), eta[None], nu[None], [when])[0]
    np.testing.assert_allclose(felt[1] - felt[0], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("depth", [4.0, 12.0])
def test_left_alone_it_drifts_with_the_water_of_its_depth(depth):
    vehicle = equipped(*DAMPED, SHEAR, STREAM, bare=neutral())
    nu = np.concatenate([water(depth), np.zeros(3)])
    motion = moved(vehicle, np.linspace(0.0, 20.0, 201), np.array([0.0, 0, depth, 0, 0, 0]), nu)
    np.testing.assert_allclose(motion[-1, :3], [*(20.0 * water(depth)[:2]), depth], atol=1e-8)


def test_left_alone_it_stays_at_rest_in_water_that_quickens():
    """Pressure and added mass carry a neutral vehicle along exactly, whatever its shape and drag."""
    matrix = (np.diag([20.0, 60, 70, 2, 8, 9]) + 0.8 * np.ones((6, 6))).tolist()
    vehicle = equipped({"name": "added_mass", "matrix": matrix}, *DAMPED, TREND, bare=neutral())
    t = BEGIN + np.linspace(0.0, 20.0, 201)
    stream = np.outer(t - 101.0, TURN)
    nu = np.array([*stream[0], 0.0, 0.0, 0.0, 0.0])
    motion = moved(vehicle, t, np.zeros(6), nu)
    way = np.outer(0.5 * ((t - 101.0) ** 2 - (BEGIN - 101.0) ** 2), TURN)
    np.testing.assert_allclose(motion[:, :2], way, atol=1e-8)
    np.testing.assert_allclose(motion[:, 6:8], stream, atol=1e-9)
    np.testing.assert_allclose(motion[:, 2:6], 0.0, atol=1e-9)


def test_a_trend_that_is_taken_up_later_is_the_same():
    """Segments, shots and replays begin at their own times: no clock starts anew."""
    vehicle, t = equipped(*DAMPED, TREND), BEGIN + np.linspace(0.0, 8.0, 401)
    whole = moved(vehicle, t, np.zeros(6), np.zeros(6))
    rest = moved(vehicle, t[150:], whole[150, :6], whole[150, 6:])
    np.testing.assert_allclose(rest, whole[150:], atol=1e-9)
    assert np.abs(moved(vehicle, t - 50.0, np.zeros(6), np.zeros(6)) - whole).max() > 0.1
