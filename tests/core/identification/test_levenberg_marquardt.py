"""The iteration against ridge regression in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from hydro.core.identification.levenberg_marquardt import Prior, descend
from hydro.core.prediction.normal_equations import Normal, bounded_step
from hydro.core.prediction.parameters import free
from tests.synthetic import vehicle

ROWS = 400


@dataclass(frozen=True)
class Linear:
    """Least squares that is linear in the parameters, in units of their scales."""

    columns: np.ndarray
    measured: np.ndarray
    unknown: object

    def _error(self, one) -> np.ndarray:
        table = next(iter(one.effects("linear_damping")))
        x = np.array(table["diagonal"], float) / self.unknown.scales
        return self.measured - self.columns @ x

    def linearise(self, base, moved, steps) -> Normal:
        both = np.column_stack([self.columns[:, : len(moved)], self._error(base)])
        gram = (both.T @ both)[None]
        return Normal(gram, ROWS, gram[:, -1:, -1], np.zeros((1, 0, len(both.T))))

    def cost(self, one, step, normal) -> tuple[float, Linear]:
        return float(self._error(one) @ self._error(one)), self


@pytest.mark.parametrize("weight", [1e-2, 10.0, 1e5])
def test_a_prior_is_ridge_regression_about_its_centre(weight):
    rng = np.random.default_rng(3)
    unknown = free(vehicle(), ["linear_damping"])
    columns = rng.standard_normal((ROWS, 6))
    truth = rng.uniform(2.0, 4.0, 6)
    measured = columns @ truth + rng.standard_normal(ROWS)
    prior = Prior(np.full(6, 1.0), weight * np.arange(1.0, 7.0))
    problem = Linear(columns, measured, unknown)
    found, _, _ = descend(unknown, unknown.starts[0], problem, 20, enough=1e-9, prior=prior)
    matrix = columns.T @ columns + np.diag(prior.information)
    expected = np.linalg.solve(matrix, columns.T @ measured + prior.information * prior.centre)
    np.testing.assert_allclose(found / unknown.scales, expected, rtol=1e-5)


def test_without_a_prior_little_is_known():
    prior = Prior.weak(np.array([1.0, 2.0]))
    assert prior.cost(np.array([1.0, 2.0])) == 0.0
    assert prior.cost(np.array([11.0, 2.0])) == pytest.approx(1.0)


def test_a_bounded_step_is_the_least_within_its_bounds():
    """At the minimum, the slope along each entry is 0, or points out of the bound where the entry lies."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        root, score = rng.standard_normal((6, 4)), 3.0 * rng.standard_normal(4)
        matrix, (low, high) = root.T @ root, np.sort(rng.standard_normal((2, 4)), axis=0)
        step = bounded_step(matrix, score, low, high)
        assert ((low <= step) & (step <= high)).all()
        slope = score - matrix @ step
        within = (step > low + 1e-9) & (step < high - 1e-9)
        np.testing.assert_allclose(slope[within], 0.0, atol=1e-7)
        assert (slope[step >= high - 1e-9] > -1e-7).all()
        assert (slope[step <= low + 1e-9] < 1e-7).all()
