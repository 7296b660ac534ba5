"""The rigid body against point masses, conserved momentum and the potential of weight and buoyancy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from strategies import angles, attitudes, numbers, spd_matrices, vectors, vehicles, velocities

from hydro.core.vehicle import frames, rigid_body
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Vehicle


def body_of(masses, points) -> Vehicle:
    """The vehicle that a cloud of point masses makes, by the definitions of mass, centre and inertia."""
    mass = masses.sum()
    center = masses @ points / mass
    arms = points - center
    inertia = np.einsum("i,ij,ij->", masses, arms, arms) * np.eye(3) - np.einsum(
        "i,ij,ik->jk", masses, arms, arms
    )
    return Vehicle(
        name="points",
        rigid_body=RigidBody(mass, tuple(center.tolist()), tuple(map(tuple, inertia.tolist()))),
        buoyancy=Buoyancy(mass * 9.81, (0.0, 0.0, 0.0)),
        hull=Hull(1.0, 1.0, 1.0),
    )


def clouds():
    """Masses [kg] and positions [m] about CO of a dozen points."""
    return st.tuples(
        arrays(np.float64, 12, elements=numbers(0.1, 20.0)),
        arrays(np.float64, (12, 3), elements=numbers(-1.0, 1.0)),
    )


@given(clouds(), velocities())
def test_mass_matrix_gives_the_energy_and_momentum_of_point_masses(cloud, nu):
    masses, points = cloud
    M = rigid_body.mass_matrix(body_of(masses, points))
    velocity = nu[:3] + np.cross(nu[3:], points)
    energy = 0.5 * masses @ np.sum(velocity**2, axis=1)
    assert 0.5 * nu @ M @ nu == pytest.approx(energy, rel=1e-12, abs=1e-12)
    momentum = [*masses @ velocity, *masses @ np.cross(points, velocity)]
    np.testing.assert_allclose(M @ nu, momentum, rtol=1e-11, atol=1e-10)


@given(vehicles(max_thrusters=0))
def test_mass_matrix_is_symmetric_positive_definite(vehicle):
    M = rigid_body.mass_matrix(vehicle)
    np.testing.assert_allclose(M, M.T, atol=1e-12)
    assert np.linalg.eigvalsh(M)[0] > 0.0


@given(clouds(), velocities(), velocities())
def test_newton_euler_gives_the_force_and_moment_that_accelerate_point_masses(cloud, nu, nu_dot):
    masses, points = cloud
    v, omega = nu[:3], nu[3:]
    acceleration = (
        nu_dot[:3]
        + np.cross(omega, v)
        + np.cross(nu_dot[3:], points)
        + np.cross(omega, np.cross(omega, points))
    )
    expected = [*masses @ acceleration, *masses @ np.cross(points, acceleration)]
    M = rigid_body.mass_matrix(body_of(masses, points))
    wrench = M @ nu_dot + rigid_body.coriolis_matrix(M, nu) @ nu
    np.testing.assert_allclose(wrench, expected, rtol=1e-10, atol=1e-9)


@given(arrays(np.float64, (6, 6), elements=numbers(-100.0, 100.0)), velocities(), velocities())
def test_coriolis_is_skew_and_without_power_whatever_the_matrix(M, nu, other):
    C = rigid_body.coriolis_matrix(M, np.stack([nu, other]))
    np.testing.assert_array_equal(C, -C.transpose(0, 2, 1))
    assert nu @ C[0] @ nu == pytest.approx(0.0, abs=1e-9)


@given(spd_matrices(), velocities(), vectors(6))
def test_coriolis_kernel_adds_the_matrix_form_times_velocity(M, nu, before):
    out = before.copy()
    rigid_body.coriolis_kernel(M.ravel(), nu, out)
    np.testing.assert_allclose(out - before, rigid_body.coriolis_matrix(M, nu) @ nu, rtol=1e-12, atol=1e-9)


@settings(max_examples=10)
@given(spd_matrices(scale=10.0), velocities(), attitudes())
def test_a_free_body_keeps_its_momentum_in_the_world(M, nu, attitude):
    """Kirchhoff: with no force, R p and x × R p + R h stay what they were, added mass or not."""

    def rate(_, state):
        R, nu = state[3:12].reshape(3, 3), state[12:]
        nu_dot = np.linalg.solve(M, -rigid_body.coriolis_matrix(M, nu) @ nu)
        return np.concatenate([R @ nu[:3], (R @ frames.skew(nu[3:])).ravel(), nu_dot])

    def momenta(state):
        x, R, momentum = state[:3], state[3:12].reshape(3, 3), M @ state[12:]
        linear = R @ momentum[:3]
        return np.concatenate([linear, np.cross(x, linear) + R @ momentum[3:]])

    start = np.concatenate([np.zeros(3), frames.rotation(*attitude).ravel(), nu])
    end = solve_ivp(rate, (0.0, 1.0), start, method="DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
    scale = np.linalg.norm(M @ nu) + 1.0
    np.testing.assert_allclose(momenta(end) / scale, momenta(start) / scale, atol=1e-6)


@given(vehicles(max_thrusters=0), numbers(0.0, 200.0), angles(), angles(), angles())
def test_potential_is_weight_and_buoyancy_times_the_depth_of_their_centres(vehicle, z, phi, theta, psi):
    R = Rotation.from_euler("ZYX", [psi, theta, phi]).as_matrix()
    weight = vehicle.rigid_body.mass * vehicle.environment.gravity
    depth_of_gravity = z + R[2] @ vehicle.rigid_body.center_of_gravity
    depth_of_buoyancy = z + R[2] @ vehicle.buoyancy.center
    expected = -weight * depth_of_gravity + vehicle.buoyancy.force * depth_of_buoyancy
    assert rigid_body.potential(vehicle, z, phi, theta) == pytest.approx(expected, rel=1e-9, abs=1e-6)


@given(vehicles(max_thrusters=0), attitudes().filter(lambda a: abs(a[1]) < 1.5))
def test_restoring_is_the_gradient_of_the_potential(vehicle, attitude):
    """Along each of the six motions the wrench does the work that the potential loses."""
    phi, theta, psi = attitude
    step = 1e-5
    velocity = np.zeros((6, 6))
    velocity[:3, :3] = frames.rotation(phi, theta, psi)
    velocity[3:, 3:] = frames.euler_rate_matrix(phi, theta)
    work = []
    for eta_dot in velocity.T:
        _, _, dz, dphi, dtheta, _ = step * eta_dot
        ahead = rigid_body.potential(vehicle, dz, phi + dphi, theta + dtheta)
        behind = rigid_body.potential(vehicle, -dz, phi - dphi, theta - dtheta)
        work.append(-(ahead - behind) / (2 * step))
    scale = vehicle.rigid_body.mass * vehicle.environment.gravity
    np.testing.assert_allclose(
        rigid_body.restoring(vehicle, phi, theta) / scale, np.array(work) / scale, atol=1e-6
    )


@given(numbers(5.0, 500.0), numbers(-0.2, 0.2), numbers(0.0, 0.1))
def test_a_neutral_level_vehicle_with_buoyancy_above_gravity_feels_nothing(mass, x, height):
    vehicle = Vehicle(
        name="neutral",
        rigid_body=RigidBody(mass, (x, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
        buoyancy=Buoyancy(mass * 9.81, (x, 0.0, -height)),
        hull=Hull(1.0, 1.0, 1.0),
    )
    np.testing.assert_array_equal(rigid_body.restoring(vehicle, 0.0, 0.0), np.zeros(6))


def test_restoring_broadcasts_columns_of_angles():
    vehicle = body_of(np.ones(4), np.eye(4, 3))
    phi, theta = np.linspace(-1, 1, 7), np.float32(0.2)
    wrench = rigid_body.restoring(vehicle, phi, theta)
    assert wrench.shape == (7, 6)
    np.testing.assert_array_equal(wrench[3], rigid_body.restoring(vehicle, phi[3], theta))
    assert rigid_body.restoring(vehicle, 0.1, 0.2).shape == (6,)
