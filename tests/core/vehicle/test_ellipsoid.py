"""Lamb's k-factors against his table, limits in closed form, and direct integration."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from hydro.core.errors import DataError
from hydro.core.vehicle.ellipsoid import added_mass_matrix, lamb_constants, lamb_factors

RHO = 1025.0
axes = st.tuples(*[st.floats(0.05, 5.0)] * 3)


@given(axes)
def test_constants_sum_to_two(semi_axes):
    assert lamb_constants(semi_axes).sum() == pytest.approx(2.0, rel=1e-12)


@given(axes)
def test_constants_are_their_integrals(semi_axes):
    a, b, c = semi_axes

    def integrand(log_s, square):
        s = np.exp(log_s)
        return s / ((square + s) * np.sqrt((a * a + s) * (b * b + s) * (c * c + s)))

    for axis, constant in zip(semi_axes, lamb_constants(semi_axes), strict=True):
        integral = quad(integrand, -40, 40, args=(axis**2,), limit=400, epsabs=0, epsrel=1e-10)[0]
        assert constant == pytest.approx(a * b * c * integral, rel=1e-7)


def test_sphere():
    np.testing.assert_allclose(lamb_factors((0.3, 0.3, 0.3)), [0.5, 0.5, 0.5, 0, 0, 0], atol=1e-12)
    volume = 4 / 3 * np.pi * 0.3**3
    diagonal = [0.5 * RHO * volume] * 3 + [0.0] * 3
    np.testing.assert_allclose(
        added_mass_matrix((0.3, 0.3, 0.3), RHO, (0, 0, 0)), np.diag(diagonal), atol=1e-9
    )


@pytest.mark.parametrize(
    ("ratio", "k_1", "k_2", "k_rotation"),
    [
        (1.50, 0.305, 0.621, 0.094),
        (2.00, 0.209, 0.702, 0.240),
        (2.99, 0.122, 0.803, 0.465),
        (3.99, 0.082, 0.860, 0.608),
        (4.99, 0.059, 0.895, 0.701),
        (6.01, 0.045, 0.918, 0.764),
        (8.01, 0.029, 0.945, 0.840),
        (9.97, 0.021, 0.960, 0.883),
    ],
)
def test_prolate_spheroids_of_lambs_table(ratio, k_1, k_2, k_rotation):
    """Lamb (1932), art. 115: three printed digits."""
    k = lamb_factors((ratio, 1.0, 1.0))
    np.testing.assert_allclose(k, [k_1, k_2, k_2, 0.0, k_rotation, k_rotation], atol=2.5e-3)


@given(st.floats(1.01, 20.0))
def test_prolate_spheroids_in_closed_form(ratio):
    """Lamb art. 105: alpha_0 = 2 (1 - e^2)/e^3 (atanh e - e)."""
    e = np.sqrt(1 - 1 / ratio**2)
    alpha = 2 * (1 - e**2) / e**3 * (np.arctanh(e) - e)
    beta = 1 / e**2 - (1 - e**2) / e**3 * np.arctanh(e)
    np.testing.assert_allclose(lamb_constants((ratio, 1, 1)), [alpha, beta, beta], rtol=1e-7)
    k = e**4 * (beta - alpha) / ((2 - e**2) * (2 * e**2 - (2 - e**2) * (beta - alpha)))
    assert lamb_factors((ratio, 1, 1))[4] == pytest.approx(k, rel=1e-6)


def test_thin_disc_broadside():
    """Lamb art. 102, 115: 8/3 rho a^3 along the axis and 16/45 rho a^5 about a diameter."""
    M_A = np.diag(added_mass_matrix((0.8, 0.8, 1e-6), RHO, (0, 0, 0)))
    assert M_A[2] == pytest.approx(8 / 3 * RHO * 0.8**3, rel=1e-5)
    assert M_A[3:5] == pytest.approx(16 / 45 * RHO * 0.8**5, rel=1e-5)


def test_long_cylinder_is_strip_theory():
    """An elliptic cylinder (b, c) has rho pi c^2 per length in sway, rho pi (b^2 - c^2)^2/8 in roll."""
    k = lamb_factors((1000.0, 0.3, 0.2))
    assert k[1] == pytest.approx(0.2 / 0.3, rel=1e-4)
    assert k[2] == pytest.approx(0.3 / 0.2, rel=1e-4)
    displaced = np.pi * 0.3 * 0.2 * (0.3**2 + 0.2**2) / 4
    assert k[3] == pytest.approx(np.pi * (0.3**2 - 0.2**2) ** 2 / 8 / displaced, rel=1e-4)


@given(axes, st.permutations([0, 1, 2]))
def test_axes_may_be_named_in_any_order(semi_axes, order):
    k = lamb_factors(semi_axes)
    permuted = lamb_factors([semi_axes[i] for i in order])
    np.testing.assert_allclose(permuted, k[[*order, *[3 + i for i in order]]], rtol=1e-8, atol=1e-12)


@given(axes, st.floats(1e-9, 1e-4))
def test_nearly_equal_axes_lose_no_digits(semi_axes, gap):
    """Through 0/0 at b = c the rotational factor must go as gap^2, not as rounding."""
    a, b, _ = semi_axes
    exact = lamb_factors((a, b, b * (1 + 1e-4)))[3] * (gap / 1e-4) ** 2
    assert lamb_factors((a, b, b * (1 + gap)))[3] == pytest.approx(exact, rel=5e-4)


@given(axes, st.tuples(*[st.floats(-2, 2)] * 3), st.tuples(*[st.floats(-3, 3)] * 6))
def test_kinetic_energy_does_not_know_the_origin(semi_axes, center, nu):
    nu = np.array(nu)
    at_center = np.array([*(nu[:3] + np.cross(nu[3:], center)), *nu[3:]])
    about_co = added_mass_matrix(semi_axes, RHO, center)
    about_center = added_mass_matrix(semi_axes, RHO, (0, 0, 0))
    assert nu @ about_co @ nu == pytest.approx(at_center @ about_center @ at_center, rel=1e-9, abs=1e-6)
    np.testing.assert_array_equal(about_co, about_co.T)
    assert np.linalg.eigvalsh(about_co)[0] >= -1e-9 * np.abs(about_co).max()


def test_a_centre_ahead_couples_sway_and_yaw():
    M_A = added_mass_matrix((1.0, 0.3, 0.3), RHO, (0.5, 0, 0))
    assert M_A[1, 5] == pytest.approx(0.5 * M_A[1, 1])
    assert M_A[2, 4] == pytest.approx(-0.5 * M_A[2, 2])


@pytest.mark.parametrize("wrong", [(1, 1), (1, 0, 1), (1, -1, 1), (1, np.nan, 1), (np.inf, 1, 1)])
def test_wrong_axes_are_refused(wrong):
    with pytest.raises(DataError, match="three positive, finite semi-axes"):
        lamb_factors(wrong)
