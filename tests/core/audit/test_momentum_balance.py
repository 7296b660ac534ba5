"""Errors of windows that follow one another."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.audit.momentum_balance import ORDER, SLOW, _autoregression, _inverse


def errors(coefficients: np.ndarray, count: int = 4000) -> np.ndarray:
    """A series that each value continues by some of those before it, and white noise."""
    out, noise = np.zeros(count), np.random.default_rng(0).standard_normal(count)
    for k in range(ORDER, count):
        out[k] = coefficients @ out[k - ORDER : k][::-1] + noise[k]
    return out


def test_an_autoregression_is_found_and_stops_short_of_a_random_walk():
    true = 0.6 * 0.5 ** np.arange(ORDER) * (-1.0) ** np.arange(ORDER)
    every = np.ones(4000, bool)
    np.testing.assert_allclose(_autoregression(errors(true), every), true, atol=0.05)
    walk = np.eye(ORDER)[0]
    assert np.abs(_autoregression(errors(walk), every)).sum() == pytest.approx(SLOW)


def test_windows_that_do_not_follow_one_another_say_nothing_of_it():
    apart = np.arange(4000) % 2 == 0
    np.testing.assert_array_equal(_autoregression(errors(0.5 * np.eye(ORDER)[0]), apart), 0.0)


def test_an_inverse_is_exact_and_of_a_singular_matrix_the_pseudo_inverse():
    columns = np.random.default_rng(0).normal(size=(50, 6))
    whole = columns.T @ columns
    np.testing.assert_allclose(_inverse(whole) @ whole, np.eye(6), atol=1e-12)
    columns[:, 5] = columns[:, 4]
    singular = 1e14 * columns.T @ columns + np.eye(6)
    np.testing.assert_allclose(_inverse(singular), np.linalg.pinv(singular, hermitian=True))
