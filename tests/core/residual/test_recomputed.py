"""Fits with a recomputed hull force, where a prediction or a derivative diverges."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.residual.hull import known_by
from hydro.core.residual.recomputed import Recomputed
from hydro.core.residual.response import Transitions

FILE = damped()


class Nothing:
    """A law without any force."""

    def wrench(self, vehicle, shots, rows=None):
        return np.zeros((shots.record.rows, 6))


def exploding():
    """Return the vehicle with damping so far below zero that every prediction diverges."""
    table = {"name": "linear_damping", "diagonal": [-1e5] * 6}
    rest = tuple(one for one in FILE.effect if one["name"] != "linear_damping")
    return msgspec.structs.replace(FILE, effect=(*rest, table))


@pytest.fixture(scope="module")
def problem():
    shots = make_shots(recording(FILE, moved(FILE, rows=4000)), sigma=np.full(12, 1e-3))
    hull = known_by(FILE, OutputError(shots), Nothing())
    return Recomputed.of(hull, Transitions.of(candidate(FILE), shots))


@pytest.mark.parametrize("free", [False, True], ids=["held", "free"])
def test_a_prediction_that_diverges_has_an_infinite_cost(problem, free):
    """Counted as zero error, it would be the best of all candidates."""
    asked = problem.with_free_law(FILE) if free else problem
    normal = asked.linearise(exploding(), [FILE], [1.0])
    assert normal.lost.all()
    assert normal.cost == np.inf
    assert np.isfinite(normal.matrix).all()
    assert np.isfinite(normal.score).all()


@pytest.mark.parametrize("free", [False, True], ids=["held", "free"])
def test_a_derivative_that_diverges_is_zero(problem, free):
    asked = problem.with_free_law(FILE) if free else problem
    normal = asked.linearise(FILE, [exploding()], [1.0])
    assert normal.cost == pytest.approx(asked.linearise(FILE, [], []).cost)
    assert normal.matrix == pytest.approx(0.0)
