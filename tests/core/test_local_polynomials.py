"""Local polynomials equal scipy's, at the ends too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import savgol_coeffs, savgol_filter

from hydro.core.local_polynomials import savitzky_golay, savitzky_golay_weights


@pytest.mark.parametrize("shape", [(40,), (40, 3)])
@pytest.mark.parametrize(
    ("width", "degree", "deriv", "dt"), [(5, 3, 0, 1.0), (11, 7, 0, 1.0), (31, 3, 1, 0.02)]
)
def test_they_are_the_filter_of_savitzky_and_golay(
    shape: tuple[int, ...], width: int, degree: int, deriv: int, dt: float
) -> None:
    values = np.random.default_rng(0).standard_normal(shape).cumsum(axis=0)
    expected = savgol_filter(values, width, degree, deriv=deriv, delta=dt, axis=0)
    assert savitzky_golay(values, width, degree, deriv=deriv, dt=dt) == pytest.approx(
        expected, rel=1e-12, abs=1e-12
    )
    expected = savgol_coeffs(width, degree, deriv=deriv, delta=dt)
    assert savitzky_golay_weights(width, degree, deriv=deriv, dt=dt) == pytest.approx(
        expected, rel=1e-12, abs=1e-14
    )


def test_they_reproduce_a_cubic_and_its_slope() -> None:
    t = np.arange(30) * 0.1
    assert savitzky_golay(t**3, 7, 3) == pytest.approx(t**3, abs=1e-12)
    assert savitzky_golay(t**3, 7, 3, deriv=1, dt=0.1) == pytest.approx(3.0 * t**2, abs=1e-10)
