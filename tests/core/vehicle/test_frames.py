"""Frames against scipy's Rotation, finite differences and what the axes mean."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import angles, attitudes, rotations, vectors

from hydro.core.errors import DataError
from hydro.core.vehicle import frames

NORTH, EAST, DOWN = np.eye(3)


def scipy_rotation(phi, theta, psi):
    return Rotation.from_euler("ZYX", np.stack([psi, theta, phi], axis=-1))


@given(angles(), angles(), angles())
def test_rotation_is_orthogonal_with_determinant_one_and_equal_to_scipy(phi, theta, psi):
    R = frames.rotation(phi, theta, psi)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(R, scipy_rotation(phi, theta, psi).as_matrix(), atol=1e-14)


@given(attitudes(), attitudes())
def test_a_product_of_quaternions_turns_by_both(first, second):
    """Right turn first, as scipy has it."""
    right, left = (Rotation.from_euler("xyz", angles) for angles in (first, second))
    out = np.zeros(4)
    frames.quaternion_product_kernel(
        left.as_quat(scalar_first=True), *right.as_quat(scalar_first=True).tolist(), out
    )
    np.testing.assert_allclose(
        Rotation.from_quat(out, scalar_first=True).as_matrix(), (left * right).as_matrix(), atol=1e-14
    )
    assert np.linalg.norm(out) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("attitude", "body", "world"),
    [
        ((0.0, 0.0, np.pi / 2), NORTH, EAST),  # a quarter turn to starboard: the bow points east
        ((0.0, np.pi / 2, 0.0), NORTH, -DOWN),  # positive pitch lifts the bow
        ((np.pi / 2, 0.0, 0.0), EAST, DOWN),  # positive roll lowers the starboard side
    ],
)
def test_positive_angles_turn_the_axes_the_sname_way(attitude, body, world):
    np.testing.assert_allclose(frames.rotation(*attitude) @ body, world, atol=1e-15)


def test_rotation_broadcasts_columns_and_scalars():
    phi, psi = np.linspace(-1, 1, 5), np.linspace(-3, 3, 5)
    R = frames.rotation(phi, 0.3, psi)
    assert R.shape == (5, 3, 3)
    np.testing.assert_allclose(R, scipy_rotation(phi, np.full(5, 0.3), psi).as_matrix(), atol=1e-14)
    assert frames.rotation(phi[:, None].astype(np.float32), 0.3, psi).shape == (5, 5, 3, 3)


@given(attitudes())
def test_euler_angles_survive_the_way_over_a_rotation_and_a_quaternion(attitude):
    back = frames.euler_from_rotation(frames.rotation(*attitude))
    over_quaternion = frames.euler_from_quaternion(frames.quaternion_from_euler(*attitude))
    for found in (back, over_quaternion):
        turn = np.exp(1j * found) / np.exp(1j * attitude)  # pi and -pi are one angle
        np.testing.assert_allclose(np.angle(turn), 0.0, atol=1e-12)


@given(angles(), angles(), angles())
@example(0.7, np.pi / 2, -0.4)
@example(0.7, -np.pi / 2, 2.0)
@example(0.7, np.pi / 2 - 1e-7, -0.4)
@example(0.7, np.pi / 2 - 1e-9, -0.4)
def test_rotations_survive_the_way_over_euler_angles_even_where_these_are_singular(phi, theta, psi):
    R = frames.rotation(phi, theta, psi)
    np.testing.assert_allclose(frames.rotation(*frames.euler_from_rotation(R)), R, atol=2e-8)


@given(angles(), st.sampled_from([1.0, -1.0]))
def test_where_roll_and_yaw_are_one_turn_the_roll_is_zero(turn, up):
    s, c = np.sin(turn), np.cos(turn)
    R = np.array([[0.0, -s, up * c], [0.0, c, up * s], [-up, 0.0, 0.0]])  # exact zeros, as logs have them
    phi, theta, psi = frames.euler_from_rotation(R)
    assert (phi, theta) == (0.0, up * np.pi / 2)
    np.testing.assert_allclose(frames.rotation(phi, theta, psi), R, atol=1e-15)


@given(angles(), angles(), angles())
def test_quaternion_is_the_scalar_first_scipy_one_with_positive_scalar(phi, theta, psi):
    q = frames.quaternion_from_euler(phi, theta, psi)
    assert q[0] >= 0.0
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-14)
    other = np.roll(scipy_rotation(phi, theta, psi).as_quat(), 1)
    assert abs(q @ other) == pytest.approx(1.0, abs=1e-12)  # q and -q are one rotation
    np.testing.assert_allclose(
        frames.rotation_from_quaternion(-3.0 * q), frames.rotation(phi, theta, psi), atol=1e-14
    )


@pytest.mark.parametrize(
    "bad", [[0.0, 0.0, 0.0, 0.0], [np.nan, 0.0, 0.0, 1.0], [[1.0, 0, 0, 0], [0.0, 0, 0, 0]]]
)
def test_a_quaternion_that_is_no_rotation_is_refused(bad):
    with pytest.raises(DataError, match="quaternion"):
        frames.euler_from_quaternion(bad)


@given(attitudes().filter(lambda a: abs(a[1]) < 1.4), vectors(3))
def test_euler_rates_move_the_attitude_as_body_rates_do(attitude, omega):
    step = 1e-6
    rate = frames.euler_rate_matrix(*attitude[:2]) @ omega
    change = frames.rotation(*(attitude + step * rate)) - frames.rotation(*(attitude - step * rate))
    arm = np.array([0.3, -0.5, 0.8])  # a point of the body moves with R (omega x arm)
    expected = frames.rotation(*attitude) @ np.cross(omega, arm)
    np.testing.assert_allclose(change @ arm / (2 * step), expected, atol=1e-6)


@given(vectors(6, 10.0), vectors(6, 10.0))
def test_frd_flu_is_an_involution_that_keeps_power_and_handedness(nu, tau):
    np.testing.assert_array_equal(frames.swap_frd_flu(frames.swap_frd_flu(nu)), nu)
    assert frames.swap_frd_flu(nu) @ frames.swap_frd_flu(tau) == pytest.approx(nu @ tau, abs=1e-9)
    swapped = np.cross(frames.swap_frd_flu(nu[:3]), frames.swap_frd_flu(tau[:3]))
    np.testing.assert_allclose(swapped, frames.swap_frd_flu(np.cross(nu[:3], tau[:3])), atol=1e-12)


@given(rotations())
def test_frd_flu_is_half_a_turn_about_the_bow(R):
    half = Rotation.from_euler("x", np.pi).as_matrix()
    np.testing.assert_allclose(frames.swap_frd_flu(R), R @ half.T, atol=1e-15)


def test_frd_flu_refuses_what_is_neither_vector_nor_twist():
    with pytest.raises(DataError, match=r"3 or 6 components, got shape \(4,\)"):
        frames.swap_frd_flu(np.zeros(4))


@given(vectors(3, 10.0), vectors(3, 10.0))
def test_skew_is_the_cross_product(a, b):
    S = frames.skew(a)
    np.testing.assert_array_equal(S, -S.T)
    np.testing.assert_allclose(S @ b, np.cross(a, b), atol=1e-12)
    np.testing.assert_array_equal(frames.skew(np.stack([a, b]))[1], frames.skew(b))
