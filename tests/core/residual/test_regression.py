"""What a hull does beside its file, learnt from simulations of a vehicle that does it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.identification.candidate import candidate
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.residual.hull import stretches
from hydro.core.residual.regression import learn
from hydro.core.residual.response import Transitions

VEHICLE = damped()
MORE = {"name": "linear_damping", "diagonal": [6.0, 0.0, 0.0, 0.0, 0.0, 0.0]}


@pytest.fixture(scope="module")
def shots():
    """Of a vehicle that surge damps more than its file says."""
    record = recording(VEHICLE, moved(damped(MORE), rows=3000))
    return make_shots(record, sigma=np.full(12, 1e-3))


@pytest.mark.parametrize("first", [0, 1, 2])
def test_no_sample_is_left_out_where_samples_are_rarer_than_rows(shots, first):
    """Every third row has a sample: no choice of rows may miss them all."""
    seen = np.zeros((len(shots.starts), shots.length, 12), bool)
    seen[:, first::3] = True
    rare = dataclasses.replace(shots, seen=seen)
    whole, found = (
        learn(VEHICLE, Transitions.of(candidate(VEHICLE), some), stretches(some)) for some in (shots, rare)
    )
    assert np.linalg.norm(found.coefficients) > 0.5 * np.linalg.norm(whole.coefficients)
