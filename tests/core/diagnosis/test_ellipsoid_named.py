"""Drag of the hull as an ellipsoid is named for a file without drag, with its coefficients and its centre."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
import synthetic
from recordings import DAMPING, damped, moved, noisy

from hydro.core.diagnosis.pipeline import diagnose
from hydro.core.explanation.trials import Recordings

HIDDEN = {"name": "ellipsoid_drag", "C": [0.6, 0.5, 0.7], "position": [0.04, 0.0, -0.05]}


@pytest.fixture(scope="module")
def named():
    """First finding where the file has linear damping alone."""
    known = synthetic.vehicle()
    file = msgspec.structs.replace(known, effect=(*known.effect, DAMPING[0]))
    truth = msgspec.structs.replace(file, effect=(*file.effect, HIDDEN))
    return diagnose(file, noisy(moved(truth, seed=3), 3)).findings[0]


def test_a_hidden_ellipsoid_is_named(named):
    assert (named.verdict, named.effect) == ("missing", "ellipsoid_drag")


@pytest.mark.parametrize("key", ["C", "position"])
def test_its_values_are_within_their_errors(named, key):
    away = np.array(named.parameters[key]) - HIDDEN[key]
    assert (np.abs(away) <= 3.0 * np.array(named.standard_errors[key])).all()
    assert np.abs(away).max() < 0.15


def test_it_completes_a_file_with_drag():
    recordings = Recordings.of(damped(), noisy(moved(damped(HIDDEN), seed=3), 3), None, None)
    own = [table["name"] for table in DAMPING]
    assert recordings.promising(damped(), own)[0]["name"] == "ellipsoid_drag"
