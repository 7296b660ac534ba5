"""Drag of the hull as an ellipsoid is named, with its coefficients and its centre."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import damped, moved, noisy

from hydro.core.diagnosis.pipeline import diagnose

HIDDEN = {"name": "ellipsoid_drag", "C": [0.6, 0.5, 0.7], "position": [0.04, 0.0, -0.05]}


@pytest.fixture(scope="module")
def named():
    """First finding where the file has plain damping alone."""
    return diagnose(damped(), noisy(moved(damped(HIDDEN), seed=3), 3)).findings[0]


def test_a_hidden_ellipsoid_is_named(named):
    assert (named.verdict, named.effect) == ("missing", "ellipsoid_drag")


@pytest.mark.parametrize("key", ["C", "position"])
def test_its_values_are_within_their_errors(named, key):
    away = np.array(named.parameters[key]) - HIDDEN[key]
    assert (np.abs(away) <= 3.0 * np.array(named.standard_errors[key])).all()
    assert np.abs(away).max() < 0.15
