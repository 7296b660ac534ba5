"""Cases with closed forms in Fossen's handbook and SNAME's equations, written out component by component."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from strategies import attitudes, vehicles, velocities

from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Vehicle
from hydro.core.vehicle.frames import rotation, skew
from hydro.core.vehicle.rigid_body import coriolis_matrix, mass_matrix, restoring

BODY = RigidBody(20.0, (0.1, 0.0, 0.03), ((0.4, 0.0, 0.0), (0.0, 1.6, 0.0), (0.0, 0.0, 1.8)))
VEHICLE = Vehicle("case", BODY, Buoyancy(20.0 * 9.81, (0.1, 0.0, -0.02)), Hull(1.0, 0.3, 0.3))


@given(vehicles(max_thrusters=0))
def test_mass_matrix_component_by_component(vehicle):
    """M_RB of Fossen (3.44), with the inertia about CO by the parallel-axis theorem."""
    m = vehicle.rigid_body.mass
    x, y, z = vehicle.rigid_body.center_of_gravity
    I = np.array(vehicle.rigid_body.inertia)
    Ix, Iy, Iz = I[0, 0] + m * (y * y + z * z), I[1, 1] + m * (z * z + x * x), I[2, 2] + m * (x * x + y * y)
    Ixy, Iyz, Izx = -I[0, 1] + m * x * y, -I[1, 2] + m * y * z, -I[2, 0] + m * z * x
    expected = [
        [m, 0, 0, 0, m * z, -m * y],
        [0, m, 0, -m * z, 0, m * x],
        [0, 0, m, m * y, -m * x, 0],
        [0, -m * z, m * y, Ix, -Ixy, -Izx],
        [m * z, 0, -m * x, -Ixy, Iy, -Iyz],
        [-m * y, m * x, 0, -Izx, -Iyz, Iz],
    ]
    np.testing.assert_allclose(mass_matrix(vehicle), expected, rtol=1e-12, atol=1e-10)


@given(vehicles(max_thrusters=0), velocities(), velocities())
def test_six_scalar_equations_of_motion(vehicle, nu, nu_dot):
    """The rigid-body equations in SNAME's notation (Fossen sec. 3.3), force by force."""
    m = vehicle.rigid_body.mass
    x, y, z = vehicle.rigid_body.center_of_gravity
    M = mass_matrix(vehicle)
    Ix, Iy, Iz, Ixy, Iyz, Izx = M[3, 3], M[4, 4], M[5, 5], -M[3, 4], -M[4, 5], -M[3, 5]
    u, v, w, p, q, r = nu
    du, dv, dw, dp, dq, dr = nu_dot
    expected = [
        m * (du - v * r + w * q - x * (q * q + r * r) + y * (p * q - dr) + z * (p * r + dq)),
        m * (dv - w * p + u * r - y * (r * r + p * p) + z * (q * r - dp) + x * (q * p + dr)),
        m * (dw - u * q + v * p - z * (p * p + q * q) + x * (r * p - dq) + y * (r * q + dp)),
        Ix * dp + (Iz - Iy) * q * r - (dr + p * q) * Izx + (r * r - q * q) * Iyz + (p * r - dq) * Ixy
        + m * (y * (dw - u * q + v * p) - z * (dv - w * p + u * r)),
        Iy * dq + (Ix - Iz) * r * p - (dp + q * r) * Ixy + (p * p - r * r) * Izx + (q * p - dr) * Iyz
        + m * (z * (du - v * r + w * q) - x * (dw - u * q + v * p)),
        Iz * dr + (Iy - Ix) * p * q - (dq + r * p) * Iyz + (q * q - p * p) * Ixy + (r * q - dp) * Izx
        + m * (x * (dv - w * p + u * r) - y * (du - v * r + w * q)),
    ]  # fmt: skip
    np.testing.assert_allclose(M @ nu_dot + coriolis_matrix(M, nu) @ nu, expected, rtol=1e-9, atol=1e-7)


@given(vehicles(max_thrusters=0), attitudes())
def test_restoring_component_by_component(vehicle, attitude):
    """g(eta) of Fossen (4.6); the wrench on the vehicle is its negative."""
    phi, theta, _ = attitude
    W, B = vehicle.rigid_body.mass * vehicle.environment.gravity, vehicle.buoyancy.force
    (xg, yg, zg), (xb, yb, zb) = vehicle.rigid_body.center_of_gravity, vehicle.buoyancy.center
    st, ct, sp, cp = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    g = [
        (W - B) * st,
        -(W - B) * ct * sp,
        -(W - B) * ct * cp,
        -(yg * W - yb * B) * ct * cp + (zg * W - zb * B) * ct * sp,
        (zg * W - zb * B) * st + (xg * W - xb * B) * ct * cp,
        -(xg * W - xb * B) * ct * sp - (yg * W - yb * B) * st,
    ]
    np.testing.assert_allclose(restoring(vehicle, phi, theta), -np.array(g), rtol=1e-11, atol=1e-8)


def test_a_heeled_vehicle_is_righted_by_its_metacentric_height():
    """K = -W BG sin(phi), M = -W BG sin(theta): buoyancy above gravity turns the vehicle back."""
    weight, height = 20.0 * 9.81, 0.05
    np.testing.assert_allclose(restoring(VEHICLE, 0.3, 0.0)[3], -weight * height * np.sin(0.3), rtol=1e-12)
    np.testing.assert_allclose(restoring(VEHICLE, 0.0, 0.3)[4], -weight * height * np.sin(0.3), rtol=1e-12)


def test_a_heavy_vehicle_is_pulled_down_whichever_way_it_points():
    heavy = Vehicle("heavy", BODY, Buoyancy(20.0 * 9.81 - 7.0, (0.1, 0.0, 0.0)), VEHICLE.hull)
    for attitude in [(0.0, 0.0, 0.0), (0.5, -1.0, 2.0), (3.0, 0.2, -1.0)]:
        in_world = rotation(*attitude) @ restoring(heavy, *attitude[:2])[:3]
        np.testing.assert_allclose(in_world, [0.0, 0.0, 7.0], atol=1e-12)


def test_a_steady_turn_needs_the_centripetal_force_of_its_centre_of_gravity():
    """u and r alone: m u r to starboard at CO's path, and m x_g r^2 inward for the offset centre."""
    u, r = 1.5, 0.4
    nu = np.array([u, 0.0, 0.0, 0.0, 0.0, r])
    wrench = coriolis_matrix(mass_matrix(VEHICLE), nu) @ nu
    np.testing.assert_allclose(wrench[:3], [-20.0 * 0.1 * r * r, 20.0 * u * r, 0.0], atol=1e-12)
    np.testing.assert_allclose(wrench[5], 20.0 * 0.1 * u * r, atol=1e-12)


def test_the_munk_moment_turns_a_drifting_body_broadside():
    """Added mass alone, drifting at (u, v): the moment on the body is (A11 - A22) u v; Fossen sec. 6.3."""
    ahead, aside = 2.0, 15.0
    nu = np.array([1.2, 0.3, 0.0, 0.0, 0.0, 0.0])
    wrench_on_body = -coriolis_matrix(np.diag([ahead, aside, aside, 0.1, 0.9, 0.9]), nu) @ nu
    np.testing.assert_allclose(wrench_on_body, [0, 0, 0, 0, 0, (ahead - aside) * 1.2 * 0.3], atol=1e-12)


@given(vehicles(max_thrusters=0), velocities())
def test_moving_the_origin_keeps_the_energy(vehicle, nu):
    """M about CO is H^T M_CG H with Fossen's screw transformation (appendix C.2), and the energy is one."""
    body = vehicle.rigid_body
    H = np.block([[np.eye(3), skew(body.center_of_gravity).T], [np.zeros((3, 3)), np.eye(3)]])
    at_center = np.block(
        [[body.mass * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), np.array(body.inertia)]]
    )
    np.testing.assert_allclose(mass_matrix(vehicle), H.T @ at_center @ H, rtol=1e-12, atol=1e-10)
    moved = H @ nu
    np.testing.assert_allclose(
        nu @ mass_matrix(vehicle) @ nu, moved @ at_center @ moved, rtol=1e-11, atol=1e-10
    )
