"""A log of another point of the body: its place is recovered with damping, and none is found without one."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import damped, moved, noisy

from hydro.core.identification.fit import fit

FITTED = ("linear_damping", "quadratic_damping", "reference_point")


@pytest.mark.parametrize("place", [[-0.15, 0.0, 0.0], [0.0, 0.0, 0.0]], ids=["behind", "at the origin"])
def test_a_fit_recovers_the_place_of_the_logged_point(place):
    actual = damped({"name": "reference_point", "r": place})
    found = fit(damped(), noisy(moved(actual, seed=1, rows=1000), 1), FITTED)
    (table,) = (one for one in found.tables() if one["name"] == "reference_point")
    np.testing.assert_allclose(table["r"], place, atol=2e-3)
    away = (np.array(table["r"]) - place) / table["standard_error"]["r"]
    assert np.abs(away).max() < 4.0
