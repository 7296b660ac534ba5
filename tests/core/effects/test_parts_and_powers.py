"""Drag of any power of the speed, drag and lift of what sits off CO: closed forms, and none of it drives."""

from __future__ import annotations

import numpy as np
import pytest
from bench import R, equipped, neutral, wrench
from hypothesis import given
from scipy.spatial.transform import Rotation
from strategies import numbers, states, vectors, velocities

from hydro.core.effects import assemble
from hydro.core.simulation.simulate import trajectory

LEVEL = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
RHO = 1025.0
NEVER = 1e-9
"""Rounding of a power that is none [W]."""


def close(actual, expected, rtol=1e-9, atol=1e-9):
    np.testing.assert_allclose(actual, expected, rtol=rtol, atol=atol)


def powered(n, diagonal=(8.0, 0, 0, 0, 0, 0)):
    return {"name": "power_drag", "diagonal": list(diagonal), "n": n}


@pytest.mark.parametrize("n", [1.3, 1.5, 2.5, 3.5])
def test_power_drag_slows_a_coasting_vehicle_as_its_power_says(n):
    """m u' = -D u^n is solved by u^(1-n) = u0^(1-n) + (n - 1) D t/m."""
    t = np.arange(500) * 0.02
    vehicle = equipped(powered(n), bare=neutral())
    u = trajectory(assemble(vehicle), np.zeros((500, 1)), t, nu=[2.0, 0, 0, 0, 0, 0])[:, 6]
    close(u, (2.0 ** (1.0 - n) + (n - 1.0) * 8.0 / 50.0 * t) ** (1.0 / (1.0 - n)), rtol=1e-8)


@given(velocities(), vectors(6, 100.0).map(np.abs))
def test_power_drag_of_powers_1_and_2_is_linear_and_quadratic_damping(nu, diagonal):
    for n, name in ((1.0, "linear_damping"), (2.0, "quadratic_damping")):
        other = {"name": name, "diagonal": diagonal.tolist()}
        close(wrench(powered(n, diagonal.tolist()), LEVEL, nu), wrench(other, LEVEL, nu))


@given(velocities(), vectors(6, 100.0).map(np.abs), numbers(1.0, 3.5))
def test_power_drag_is_odd_never_drives_and_doubles_n_times(nu, diagonal, n):
    tau = wrench(powered(n, diagonal.tolist()), LEVEL, nu)
    close(wrench(powered(n, diagonal.tolist()), LEVEL, -2.0 * nu), -(2.0**n) * tau)
    assert (tau * nu <= 0.0).all()


def part(drag, position):
    return {"name": "offset_drag", "drag": list(map(float, drag)), "position": list(map(float, position))}


@given(states(), vectors(3, 100.0).map(np.abs), vectors(3))
def test_offset_drag_is_that_of_a_particle_at_its_place(state, drag, place):
    """Its velocity from two places of the particle a moment apart, its drag that of a body that moves so."""
    eta, nu = state
    moment, turned = 1e-6, R(eta)
    there, back = (
        moment * way * turned @ nu[:3] + turned @ Rotation.from_rotvec(moment * way * nu[3:]).apply(place)
        for way in (0.5, -0.5)
    )
    velocity = turned.T @ (there - back) / moment
    alone = {"name": "quadratic_damping", "diagonal": [*drag.tolist(), 0.0, 0.0, 0.0]}
    force = wrench(alone, eta, [*velocity, 0.0, 0.0, 0.0])[:3]
    close(wrench(part(drag, place), eta, nu), [*force, *np.cross(place, force)], rtol=1e-6, atol=1e-5)


@given(velocities(), vectors(3, 100.0).map(np.abs), vectors(3))
def test_offset_drag_never_drives(nu, drag, place):
    assert wrench(part(drag, place), LEVEL, nu) @ nu <= NEVER


def test_two_parts_on_a_boom_stop_a_turn_as_one_over_time():
    """At +x and -x their forces cancel: I r' = -2 d x^3 r^2, and the effect may stand in a file twice."""
    vehicle = equipped(part([0, 30, 0], [0.6, 0, 0]), part([0, 30, 0], [-0.6, 0, 0]), bare=neutral())
    t = np.arange(500) * 0.02
    motion = trajectory(assemble(vehicle), np.zeros((500, 1)), t, nu=[0, 0, 0, 0, 0, 1.5])
    close(motion[:, 11], 1.5 / (1.0 + 2.0 * 30.0 * 0.6**3 / 5.5 * 1.5 * t), rtol=1e-8)
    close(motion[:, 6:11], np.zeros((500, 5)))


def test_a_skid_below_pulls_the_nose_down_ahead_and_a_sonar_in_front_turns_a_sideways_motion():
    close(wrench(part([40, 0, 0], [0, 0, 0.3]), LEVEL, [2.0, 0, 0, 0, 0, 0]), [-160, 0, 0, 0, -48, 0])
    close(wrench(part([0, 40, 0], [0.5, 0, 0]), LEVEL, [0, 2.0, 0, 0, 0, 0]), [0, -160, 0, 0, 0, -80])


def rolls():
    return numbers(-1.1, 1.9)


def fin(**given):
    return {"name": "control_surface", "area": 0.02, "stall": 0.35, **given}


@given(velocities(), vectors(3), rolls(), numbers(-1.5, 1.5), numbers(0.05, 1.0))
def test_a_fin_never_drives(nu, place, roll, deflection, stall):
    effect = fin(position=place.tolist(), roll=roll, deflection=deflection, stall=stall)
    assert wrench(effect, LEVEL, nu) @ nu <= NEVER


@given(velocities(), vectors(3), rolls(), numbers(-1.5, 1.5), numbers(1e-6, 1.0))
def test_a_fin_answers_with_the_square_of_the_speed_down_to_none(nu, place, roll, deflection, slower):
    effect = fin(position=place.tolist(), roll=roll, deflection=deflection)
    close(wrench(effect, LEVEL, slower * nu), slower**2 * wrench(effect, LEVEL, nu), rtol=1e-6, atol=1e-10)
    close(wrench(effect, LEVEL, np.zeros(6)), np.zeros(6))


@given(velocities(), vectors(3), rolls(), numbers(-1.0, 1.0))
def test_a_fin_rolled_with_its_place_and_the_flow_has_its_wrench_rolled(nu, place, roll, deflection):
    """Seen in the axes of an elevator, a rolled fin is one."""
    turned = Rotation.from_euler("x", roll)
    seen = np.concatenate([turned.inv().apply(nu[:3]), turned.inv().apply(nu[3:])])
    flat = wrench(fin(position=turned.inv().apply(place).tolist(), deflection=deflection), LEVEL, seen)
    rolled = wrench(fin(position=place.tolist(), roll=roll, deflection=deflection), LEVEL, nu)
    close(rolled, np.concatenate([turned.apply(flat[:3]), turned.apply(flat[3:])]), atol=1e-7)


@given(numbers(-0.02, 0.02), numbers(-0.02, 0.02), numbers(-0.02, 0.02), numbers(-0.8, 0.8))
def test_below_stall_a_rudder_is_thin_wing_theory_s_lift(v, r, deflection, x):
    """Y = -1/2 rho pi A u^2 (drift/u + deflection's), N = x Y: the linear lift of a rudder off its stall."""
    effect = fin(position=[x, 0, 0], roll=np.pi / 2, deflection=deflection)
    tau = wrench(effect, LEVEL, [1.5, v, 0, 0, 0, r])
    force = 0.5 * RHO * np.pi * 0.02 * 1.5**2 * (deflection - (v + x * r) / 1.5)
    close(tau[[1, 5]], [force, x * force], rtol=2e-2, atol=0.05)


@pytest.mark.parametrize("angle", [0.7, 1.2, np.pi / 2, 2.2, 2.9, -0.8, -2.5])
def test_beyond_stall_a_fin_is_a_flat_plate_whichever_edge_leads(angle):
    """A plate is pushed along its normal alone, by rho A V^2 sin(a), but for its profile's drag."""
    nu = [1.5 * np.cos(angle), 0, 1.5 * np.sin(angle), 0, 0, 0]
    normal = -RHO * 0.02 * 1.5**2 * np.sin(angle)
    friction = 0.5 * RHO * 0.02 * 1.5**2 * 0.011
    tau = wrench(fin(), LEVEL, nu)
    close(tau[[0, 2]], [0.0, normal], rtol=5e-3, atol=friction)


def test_at_the_stall_lift_falls_from_pi_half_times_a_plate_s_to_a_plate_s():
    def lift(angle):
        way = [np.sin(angle), 0, -np.cos(angle), 0, 0, 0]
        return wrench(fin(), LEVEL, [np.cos(angle), 0, np.sin(angle), 0, 0, 0]) @ way

    times = [lift(angle) / (0.5 * RHO * 0.02 * np.sin(2.0 * angle)) for angle in (0.05, 0.2, 0.35, 0.6)]
    assert times == [
        pytest.approx(n, rel=2e-2)
        for n in (np.pi / 2, np.pi / 2, 0.5 * (0.35 * np.pi / np.sin(0.7) + 1), 1.0)
    ]


@given(velocities(), vectors(3), numbers(0.0, 1.1), numbers(-1.0, 1.0))
def test_a_fin_upside_down_is_the_same_fin_deflected_the_other_way(nu, place, roll, deflection):
    """Half a turn of roll, by turning all that acts on it instead: its place and the flow."""
    turned = np.array([1.0, -1.0, -1.0])
    effect = fin(position=place.tolist(), roll=roll, deflection=deflection)
    other = fin(position=(turned * place).tolist(), roll=roll, deflection=-deflection)
    flipped = np.concatenate([turned, turned])
    close(flipped * wrench(other, LEVEL, flipped * nu), wrench(effect, LEVEL, nu), atol=1e-7)


def test_a_trailing_edge_down_lifts_the_tail_and_one_to_port_turns_to_port():
    elevator = wrench(fin(position=[-0.8, 0, 0], deflection=0.1), LEVEL, [1.5, 0, 0, 0, 0, 0])
    rudder = wrench(fin(position=[-0.8, 0, 0], roll=np.pi / 2, deflection=0.1), LEVEL, [1.5, 0, 0, 0, 0, 0])
    assert elevator[2] < -5.0
    assert elevator[4] == pytest.approx(0.8 * elevator[2])
    assert rudder[1] == pytest.approx(-elevator[2])
    assert rudder[5] == pytest.approx(-0.8 * rudder[1])
