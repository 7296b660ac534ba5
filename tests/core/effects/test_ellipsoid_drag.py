"""Drag of the hull as an ellipsoid: exact along an axis, a closed form in straight motion, passive."""

from __future__ import annotations

import numpy as np
import pytest
from bench import equipped, neutral, wrench
from hypothesis import given
from strategies import numbers, vectors, velocities

from hydro.core.effects import assemble
from hydro.core.effects.ellipsoid import nearest_damping
from hydro.core.simulation.simulate import trajectory

LEVEL = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
RHO, SIDES = 1025.0, np.array([1.6, 0.4, 0.3])
AREAS = 0.25 * np.pi * np.array([SIDES[1] * SIDES[2], SIDES[0] * SIDES[2], SIDES[0] * SIDES[1]])
"""Frontal areas of the ellipsoid of the vehicles of `bench` [m^2]."""
NEVER = 1e-9
"""Rounding of a power that is none [W]."""


def close(actual, expected, rtol=1e-9, atol=1e-9):
    np.testing.assert_allclose(actual, expected, rtol=rtol, atol=atol)


def ellipsoid(C=(1.0, 1.0, 1.0), position=(0.0, 0.0, 0.0)):
    return {"name": "ellipsoid_drag", "C": list(map(float, C)), "position": list(map(float, position))}


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_along_an_axis_it_is_quadratic_damping_of_the_frontal_area(axis):
    nu, C = np.zeros(6), np.array([0.3, 0.8, 1.1])
    nu[axis] = -1.7
    expected = np.zeros(6)
    expected[axis] = 0.5 * RHO * C[axis] * AREAS[axis] * 1.7**2
    close(wrench(ellipsoid(C), LEVEL, nu), expected)


def test_a_coasting_hull_slows_as_its_frontal_area_says():
    """m u' = -k u^2 is solved by u = u0/(1 + k u0 t/m)."""
    t = np.arange(500) * 0.02
    vehicle = equipped(ellipsoid((0.4, 1.0, 1.0)), bare=neutral())
    u = trajectory(assemble(vehicle), np.zeros((500, 1)), t, nu=[2.0, 0, 0, 0, 0, 0])[:, 6]
    close(u, 2.0 / (1.0 + 0.5 * RHO * 0.4 * AREAS[0] * 2.0 * t / 50.0), rtol=1e-8)


def test_a_thrust_drives_the_hull_to_its_terminal_speed():
    t = np.arange(3000) * 0.02
    vehicle = equipped(ellipsoid((0.5, 1.0, 1.0)), bare=neutral())
    u = trajectory(assemble(vehicle), np.full((3000, 1), 0.25), t)[:, 6]
    assert u[-1] == pytest.approx(np.sqrt(20.0 / (0.5 * RHO * 0.5 * AREAS[0])), rel=1e-4)


@given(vectors(3, 2.0), vectors(3, 2.0).map(np.abs))
def test_in_straight_motion_the_flow_meets_the_projected_area(velocity, C):
    """X_i = -1/2 rho C_i sqrt(sum (A_j v_j)^2) v_i, and the moment -1/4 rho V v x (C v), with 48 faces."""
    tau = wrench(ellipsoid(C), LEVEL, [*velocity, 0.0, 0.0, 0.0])
    flux = 0.5 * RHO * np.sqrt(((AREAS * velocity) ** 2).sum())
    close(tau[:3], -flux * C * velocity, rtol=0.09)
    moment = -0.25 * RHO * np.pi / 6.0 * SIDES.prod() * np.cross(velocity, C * velocity)
    close(tau[3:], moment, rtol=0.0, atol=0.02 * flux * np.abs(C * velocity).max() * SIDES[0] + 1e-9)


@given(velocities(), vectors(3, 2.0).map(np.abs), vectors(3))
def test_it_never_drives(nu, C, place):
    assert wrench(ellipsoid(C, place), LEVEL, nu) @ nu <= NEVER


@given(velocities(), vectors(3, 2.0).map(np.abs), vectors(3), numbers(0.1, 3.0))
def test_it_grows_with_the_square_of_the_speed(nu, C, place, times):
    tau = wrench(ellipsoid(C, place), LEVEL, nu)
    close(wrench(ellipsoid(C, place), LEVEL, times * nu), times**2 * tau, atol=1e-7)


@given(velocities(), vectors(3, 2.0).map(np.abs), vectors(3))
def test_motion_turned_inside_out_has_the_opposite_force_and_the_same_moment(nu, C, place):
    inside_out = np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
    tau = wrench(ellipsoid(C, place), LEVEL, nu)
    close(wrench(ellipsoid(C, -place), LEVEL, inside_out * nu), inside_out * tau, atol=1e-7)


@given(velocities(), vectors(3))
def test_a_mirror_image_has_the_mirror_image_of_the_wrench(nu, place):
    port, flipped = np.array([1.0, -1.0, 1.0]), np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    tau = wrench(ellipsoid(position=place), LEVEL, nu)
    close(wrench(ellipsoid(position=port * place), LEVEL, flipped * nu), flipped * tau, atol=1e-7)


@given(velocities(), vectors(3))
def test_another_centre_sees_its_own_velocity(nu, place):
    there = np.concatenate([nu[:3] + np.cross(nu[3:], place), nu[3:]])
    at_origin = wrench(ellipsoid(), LEVEL, there)
    moved = np.concatenate([at_origin[:3], at_origin[3:] + np.cross(place, at_origin[:3])])
    close(wrench(ellipsoid(position=place), LEVEL, nu), moved, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(("axis", "one", "other"), [(4, 0, 2), (5, 0, 1)])
def test_a_turn_on_the_spot_has_the_moment_of_the_integral(axis, one, other):
    """M = 1/2 rho int max(v . n, 0) |v| r dA over the ellipsoid, by a fine grid on the sphere."""
    polar, azimuth = (np.arange(200) + 0.5) * np.pi / 200, (np.arange(400) + 0.5) * np.pi / 200
    theta, phi = np.meshgrid(polar, azimuth, indexing="ij")
    point = np.stack([np.cos(theta), np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)])
    half = 0.5 * SIDES[:, None, None]
    area = point * np.prod(half) / half * np.sin(theta) * (np.pi / 200) ** 2
    rate = np.zeros(3)
    rate[axis - 3] = 1.0
    velocity = np.cross(rate, (half * point).transpose(1, 2, 0)).transpose(2, 0, 1)
    power = (np.maximum((velocity * area).sum(0), 0.0) * (velocity**2).sum(0)).sum()
    tau = wrench(ellipsoid(), LEVEL, [0, 0, 0, *rate])
    assert tau[axis] == pytest.approx(-0.5 * RHO * power, rel=0.08)


def test_the_nearest_quadratic_damping_is_equal_along_and_about_each_axis():
    vehicle, table = equipped(), ellipsoid((0.3, 0.8, 1.1), (0.1, 0.0, 0.05))
    (plain,) = nearest_damping(table, vehicle)
    for i, nu in enumerate(np.eye(6)):
        assert wrench(plain, LEVEL, nu)[i] == pytest.approx(wrench(table, LEVEL, nu)[i])
