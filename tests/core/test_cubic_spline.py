"""The cubic spline is that of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from hydro.core.cubic_spline import cubic_spline


@pytest.mark.parametrize("count", [4, 5, 60])
def test_it_is_that_of_scipy_between_samples_and_beyond(count: int) -> None:
    rng = np.random.default_rng(count)
    x, y = np.sort(rng.uniform(0.0, 3.0, count)), rng.normal(size=(count, 3))
    places = np.concatenate([x, np.linspace(-0.1, 3.1, 40)])
    expected = CubicSpline(x, y)(places)
    np.testing.assert_allclose(cubic_spline(x, y)(places), expected, atol=1e-12 * np.abs(expected).max())
