"""Every wrench of the catalogue against its closed form, written with scipy and numpy alone."""

from __future__ import annotations

import numpy as np
import pytest
from bench import BARE, BUOYANCY, CENTER_OF_BUOYANCY, R, equipped, force_at, neutral, wrench
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import approx_fprime
from scipy.spatial.transform import Rotation
from strategies import numbers, spd_matrices, states, vectors, velocities

from hydro.core.effects import assemble, effect_wrenches
from hydro.core.effects.restoring import weight_or_moment
from hydro.core.effects.surroundings import hung_weight
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle.rigid_body import coriolis_matrix

LEVEL = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
HULL_X = (0.1 - 0.8, 0.1 + 0.8)  # of the bench's hull
RHO, WIDTH, HEIGHT = 1025.0, 0.4, 0.3


def close(actual, expected, rtol=1e-10, atol=1e-9):
    np.testing.assert_allclose(actual, expected, rtol=rtol, atol=atol)


@given(velocities(), spd_matrices(scale=50.0))
def test_linear_damping_is_minus_d_nu(nu, matrix):
    close(wrench({"name": "linear_damping", "matrix": matrix.tolist()}, LEVEL, nu), -matrix @ nu)
    diagonal = np.diag(matrix)
    close(wrench({"name": "linear_damping", "diagonal": diagonal.tolist()}, LEVEL, nu), -diagonal * nu)


@given(velocities(), vectors(6, 100.0))
def test_quadratic_damping_is_odd_and_quadratic(nu, diagonal):
    effect = {"name": "quadratic_damping", "diagonal": diagonal.tolist()}
    close(wrench(effect, LEVEL, nu), -diagonal * np.abs(nu) * nu)
    close(wrench(effect, LEVEL, -2.0 * nu), -4.0 * wrench(effect, LEVEL, nu))


@given(velocities(), vectors(6, 20.0))
def test_coupled_damping_fills_six_entries(nu, values):
    pairs = ((1, 5), (5, 1), (2, 4), (4, 2), (1, 3), (3, 1))
    matrix = np.zeros((6, 6))
    for value, (i, j) in zip(values, pairs, strict=True):
        matrix[i, j] = value
    names = {f"D{i}{j}": float(v) for v, (i, j) in zip(values, pairs, strict=True)}
    close(wrench({"name": "coupled_damping", **names}, LEVEL, nu), -matrix @ nu)


@given(velocities(), vectors(15, 50.0))
def test_cross_axis_drag_is_a_damping_by_the_other_speeds(nu, values):
    """-diag(D |v|) nu: it turns with the motion, grows with its square, and never drives the vehicle."""
    matrix = np.zeros((6, 3))
    matrix[~np.eye(6, 3, dtype=bool)] = np.abs(values)
    names = {f"D{i}{j}": matrix[i, j] for i in range(6) for j in range(3) if i != j}
    tau = wrench({"name": "cross_axis_drag", **names}, LEVEL, nu)
    close(tau, -(matrix @ np.abs(nu[:3])) * nu)
    assert tau @ nu <= 0.0


def test_cross_axis_drag_slows_an_oblique_coast_as_one_over_time():
    """With u = v and D01 = D10 both obey m u' = -D u^2, of which u0 / (1 + D u0 t / m) is the solution."""
    vehicle = equipped({"name": "cross_axis_drag", "D01": 40.0, "D10": 40.0}, bare=neutral())
    t = np.arange(500) * 0.02
    motion = trajectory(assemble(vehicle), np.zeros((500, 1)), t, nu=[1.5, 1.5, 0, 0, 0, 0])
    expected = 1.5 / (1.0 + 40.0 / 50.0 * 1.5 * t)
    np.testing.assert_allclose(motion[:, 6:8], np.column_stack([expected, expected]), rtol=1e-8)


@given(velocities(), numbers(0.1, 2.0), numbers(0.1, 2.0))
def test_crossflow_drag_against_quadrature(nu, side, bottom):
    """32 midpoints against adaptive quadrature: the midpoint rule's error is of the order of 1/32^2."""
    _, v, w, _, q, r = nu
    low, high = HULL_X

    def integral(function):
        return quad(function, low, high, points=kinks, limit=200)[0]

    kinks = [x for x in (-v / r if r else 9.0, w / q if q else 9.0) if low < x < high] or None
    lateral, vertical = -0.5 * RHO * side * HEIGHT, -0.5 * RHO * bottom * WIDTH
    expected = [
        0.0,
        lateral * integral(lambda x: abs(v + x * r) * (v + x * r)),
        vertical * integral(lambda x: abs(w - x * q) * (w - x * q)),
        0.0,
        -vertical * integral(lambda x: x * abs(w - x * q) * (w - x * q)),
        lateral * integral(lambda x: x * abs(v + x * r) * (v + x * r)),
    ]
    actual = wrench({"name": "crossflow_drag", "Cd_y": side, "Cd_z": bottom}, LEVEL, nu)
    scale = 0.5 * RHO * 2.0 * WIDTH * 1.6 * (np.abs(nu).max() * 1.9) ** 2
    close(actual, expected, rtol=2e-3, atol=2e-3 * scale)


def test_crossflow_drag_of_pure_sway_is_that_of_a_plate_and_acts_at_the_hulls_centre():
    tau = wrench({"name": "crossflow_drag", "Cd_y": 1.1}, LEVEL, [0, 0.5, 0, 0, 0, 0])
    force = -0.5 * RHO * 1.1 * HEIGHT * 1.6 * 0.25
    close(tau, [0, force, 0, 0, 0, 0.1 * force])


@given(velocities(), numbers(-0.8, 0.8), numbers(1.0, 40.0))
def test_body_lift_of_a_vertical_fin(nu, x, strength):
    """A fin at x: side force against the local drift, moment x times it; ahead and astern alike."""
    u, v, _, _, _, r = nu
    force = -strength * abs(u) * (v + x * r)
    names = {"L11": strength, "L15": strength * x, "L51": strength * x, "L55": strength * x * x}
    close(wrench({"name": "body_lift", **names}, LEVEL, nu), [0, force, 0, 0, 0, x * force])


@given(velocities(), numbers(-0.8, 0.8), numbers(1.0, 40.0))
def test_body_lift_of_a_horizontal_fin(nu, x, strength):
    """The point (x, 0, 0) sinks with w - x q; a force Z there pitches with M = -x Z."""
    u, _, w, _, q, _ = nu
    force = -strength * abs(u) * (w - x * q)
    names = {"L22": strength, "L24": -strength * x, "L42": -strength * x, "L44": strength * x * x}
    close(wrench({"name": "body_lift", **names}, LEVEL, nu), [0, 0, force, 0, -x * force, 0])


@given(velocities(), spd_matrices(), numbers(-2.0, 2.0))
def test_added_mass_coriolis_is_minus_kappa_c_a_nu(nu, matrix, kappa):
    tau = wrench(
        {"name": "added_mass_coriolis", "kappa": kappa},
        LEVEL,
        nu,
        {"name": "added_mass", "matrix": matrix.tolist()},
    )
    close(tau, -kappa * coriolis_matrix(matrix, nu) @ nu, atol=1e-8)
    assert abs(nu @ tau) < 1e-9 * (1.0 + np.abs(matrix).max() * np.abs(nu).max() ** 3)


def test_munk_moment_turns_a_slender_body_broadside():
    """(Y_vdot - X_udot) u v of SNAME: with drift to starboard (v > 0) the bow is pushed further to port."""
    added = {"name": "added_mass", "diagonal": [10.0, 60.0, 70.0, 1.0, 8.0, 9.0]}
    tau = wrench({"name": "added_mass_coriolis", "kappa": 1.0}, LEVEL, [1.5, 0.2, 0, 0, 0, 0], added)
    close(tau, [0, 0, 0, 0, 0, (10.0 - 60.0) * 1.5 * 0.2])


@given(states(), numbers(-30.0, 30.0))
def test_net_buoyancy_lifts_at_the_centre_of_buoyancy(state, force):
    eta, nu = state
    close(
        wrench({"name": "net_buoyancy", "dB": force}, eta, nu),
        force_at(CENTER_OF_BUOYANCY, [0, 0, -force], eta),
    )


@given(states(), vectors(3, 0.1), numbers(-30.0, 30.0))
def test_moved_and_added_buoyancy_together_are_one_buoyancy(state, moved, extra):
    """(B + dB) at r_b + d, less B at r_b which the rigid body has already."""
    eta, nu = state
    effects = (
        {"name": "buoyancy_offset", **dict(zip(("dx", "dy", "dz"), moved.tolist(), strict=True))},
        {"name": "net_buoyancy", "dB": extra},
    )
    total = force_at(CENTER_OF_BUOYANCY + moved, [0, 0, -(BUOYANCY + extra)], eta)
    close(
        wrench(effects[0], eta, nu, effects[1]), total - force_at(CENTER_OF_BUOYANCY, [0, 0, -BUOYANCY], eta)
    )


@given(states(), vectors(3), numbers(-30.0, 30.0))
def test_payload_weighs_down_at_its_place(state, place, weight):
    eta, nu = state
    named = dict(zip("xyz", place.tolist(), strict=True))
    close(
        wrench({"name": "payload", "w": weight, "mass": 3.0, **named}, eta, nu),
        force_at(place, [0, 0, weight], eta),
    )


@given(states(), vectors(3), vectors(3, 20.0), numbers(0.0, 15.0))
def test_tether_pulls_along_the_straight_line(state, attachment, anchor, slack):
    eta, nu = state
    line = anchor - eta[:3] - R(eta) @ attachment
    distance = np.linalg.norm(line)
    pull = 7.0 * max(0.0, distance - slack) * line / distance
    effect = {
        "name": "tether",
        "k": 7.0,
        "slack": slack,
        "attachment": attachment.tolist(),
        "anchor": anchor.tolist(),
    }
    close(wrench(effect, eta, nu), force_at(attachment, pull, eta), atol=1e-8)


def test_tether_at_its_anchor_is_slack():
    effect = {"name": "tether", "k": 7.0, "anchor": [0.0, 0.0, 5.0]}
    close(wrench(effect, LEVEL, np.zeros(6)), np.zeros(6))


@given(states(), numbers(0.2, 3.0))
def test_surface_suction_decays_with_depth(state, decay):
    eta, nu = state
    for depth, force in ((-0.5, 20.0), (0.0, 20.0), (decay, 20.0 / np.e), (3.0 * decay, 20.0 / np.e**3)):
        eta[2] = depth
        tau = wrench({"name": "surface_suction", "A": 20.0, "decay": decay}, eta, nu)
        close(tau, force_at(CENTER_OF_BUOYANCY, [0, 0, -force], eta))


@pytest.mark.parametrize("rate", [0.5, 3.0, 12.0])
def test_fluid_memory_against_direct_convolution(rate):
    """-int_0^t K exp(-a (t - t')) nu_dot(t') dt' by quadrature, of a motion that began as it always was."""
    t = np.arange(0.0, 4.0, 0.02)
    axes, strength = np.arange(1, 7), np.linspace(3.0, 8.0, 6)
    nu = 0.4 + np.sin(np.outer(t, 1.0 + 0.3 * axes))
    effect = {"name": "fluid_memory", "K": [strength.tolist()], "rates": [rate]}
    actual = effect_wrenches(equipped(effect), np.zeros((len(t), 6)), nu, [[0, len(t)]], t)

    def convolution(k, i):
        w = 1.0 + 0.3 * axes[i]
        return quad(lambda s: w * np.cos(w * s) * np.exp(-rate * (t[k] - s)), 0.0, t[k])[0]

    for k in (0, 1, 50, 199):
        for i in axes - 1:
            assert actual[k, i] == pytest.approx(-strength[i] * convolution(k, i), abs=1e-3 * strength[i])


def test_fluid_memory_of_several_rates_adds_and_steady_motion_feels_nothing():
    nu = np.tile([1.0, -0.5, 0.3, 0.1, 0.2, -0.4], (50, 1))
    nu[25:] *= 2.0
    both = {"name": "fluid_memory", "K": [[2.0] * 6, [5.0] * 6], "rates": [1.0, 8.0]}
    eta, rows, t = np.zeros((50, 6)), [[0, 50]], 0.02 * np.arange(50)
    total = effect_wrenches(equipped(both), eta, nu, rows, t)
    apart = sum(
        effect_wrenches(equipped({"name": "fluid_memory", "K": [[k] * 6], "rates": [a]}), eta, nu, rows, t)
        for k, a in ((2.0, 1.0), (5.0, 8.0))
    )
    close(total, apart)
    close(total[:25], np.zeros((25, 6)), atol=1e-12)
    assert (total[26] * nu[26] < 0).all()


@given(states())
def test_a_current_is_felt_as_relative_velocity(state):
    eta, nu = state
    drag = {"name": "linear_damping", "diagonal": [5.0, 20.0, 30.0, 2.0, 6.0, 5.0]}
    water = np.array([0.4, -0.3, 0.1])
    moving = wrench(drag, eta, nu, {"name": "ocean_current", "v_N": 0.4, "v_E": -0.3, "v_D": 0.1})
    relative = nu - np.concatenate([R(eta).T @ water, np.zeros(3)])
    close(moving, wrench(drag, eta, relative))


@given(states())
def test_tether_is_the_gradient_of_its_energy(state):
    """Along every motion of the body, by finite differences of 1/2 k (distance - slack)^2."""
    eta, _ = state
    attachment, anchor = np.array([0.5, 0.2, -0.1]), eta[:3] + np.array([4.0, -3.0, 2.0])

    def energy(twist):
        turned = R(eta) @ Rotation.from_rotvec(twist[3:]).as_matrix()
        place = eta[:3] + R(eta) @ twist[:3] + turned @ attachment
        return 0.5 * 9.0 * (np.linalg.norm(anchor - place) - 1.0) ** 2

    effect = {
        "name": "tether",
        "k": 9.0,
        "slack": 1.0,
        "attachment": attachment.tolist(),
        "anchor": anchor.tolist(),
    }
    gradient = approx_fprime(np.zeros(6), energy, 1e-7)
    close(wrench(effect, eta, np.zeros(6)), -gradient, rtol=1e-4, atol=1e-3)


@given(st.data())
def test_zero_is_absence(data):
    """Every wrench effect whose strengths are 0 adds nothing, whatever its places and rates."""
    eta, nu = data.draw(states())
    for effect in (
        {"name": "linear_damping", "diagonal": [0.0] * 6},
        {"name": "quadratic_damping", "diagonal": [0.0] * 6},
        {"name": "coupled_damping"},
        {"name": "crossflow_drag"},
        {"name": "cross_axis_drag"},
        {"name": "body_lift"},
        {"name": "power_drag", "diagonal": [0.0] * 6, "n": 1.5},
        {"name": "offset_drag", "position": [0.5, 0.1, 0.2]},
        {"name": "ellipsoid_drag", "position": [0.1, 0.0, 0.05]},
        {"name": "control_surface", "position": [-0.5, 0.1, 0.2], "deflection": 0.1, "stall": 0.3},
        {"name": "added_mass_coriolis"},
        {"name": "net_buoyancy"},
        {"name": "buoyancy_offset"},
        {"name": "payload", "x": 0.3},
        {"name": "tether", "anchor": [9.0, 9.0, 9.0]},
        {"name": "surface_suction", "decay": 1.0},
        {"name": "fluid_memory", "K": [[0.0] * 6], "rates": [2.0]},
    ):
        close(wrench(effect, eta, nu), np.zeros(6), atol=1e-9)


@given(states(), vectors(3, 1.0), numbers(0.0, 5.0), st.sampled_from([-1.0, 1.0]))
def test_a_tether_to_a_far_anchor_above_or_below_is_a_payload(state, at, pull, side):
    eta, nu = state
    anchor = [0.0, 0.0, side * 1e7]
    table = {"name": "tether", "k": pull / 1e7, "attachment": at.tolist(), "anchor": anchor}
    (hung,) = hung_weight(table, BARE)
    assert hung["w"] == pytest.approx(side * pull)
    close(wrench(table, eta, nu), wrench(hung, eta, nu), atol=1e-4)


@given(states(), vectors(3, 1.0), numbers(-40.0, 40.0))
def test_a_payload_without_mass_is_a_change_of_buoyancy_and_its_offset(state, at, weight):
    """So the offset with its moment is what a payload without weight would be."""
    eta, nu = state
    table = {"name": "payload", "w": weight, **dict(zip("xyz", at.tolist(), strict=True))}
    lighter, offset = weight_or_moment(table, BARE)
    assert lighter == {"name": "net_buoyancy", "dB": -weight}
    both = wrench(lighter, eta, nu, offset)
    center = np.add(CENTER_OF_BUOYANCY, [offset[f"d{axis}"] for axis in "xyz"])  # where dB acts
    both[3:] -= np.cross(center, weight * R(eta)[2])
    close(both, wrench(table, eta, nu), atol=1e-9)
