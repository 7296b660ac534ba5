"""Error of a hull model in the values of a change, against fits of the same change to both recordings."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.diagnosis.model import fit_model
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.residual.imitation import imitations

FILE = damped()
HEAVY = {"name": "net_buoyancy", "dB": -6.0}


def problem(*effects, seed=0):
    record = recording(FILE, moved(damped(*effects), rows=3000, seed=seed))
    return OutputError(make_shots(record, sigma=np.full(12, 1e-3)))


@pytest.fixture(scope="module")
def model():
    shots = problem(HEAVY)
    return fit_model(FILE, ["net_buoyancy"], shots, shots.shots.record.track, 12)


def imitated(shots, model):
    """What fits to two stretches of a recording find of the change of a model."""
    fold = np.arange(len(shots.shots.starts)) * 2 // len(shots.shots.starts)
    return imitations(shots, FILE, model.unknown, model.values, fold) * model.unknown.scales


def test_a_recording_that_the_model_of_the_hull_explains_imitates_nothing(model):
    assert imitated(problem(seed=1), model) == pytest.approx(np.zeros((2, 1)), abs=0.02)


def test_what_it_leaves_there_is_found_by_its_size_in_every_stretch(model):
    """A third of the change, in the units of the entry; stretches with more motion count more."""
    found = imitated(problem({"name": "net_buoyancy", "dB": -2.0}, seed=1), model)
    assert found == pytest.approx(np.full((2, 1), -2.0), rel=0.05)
    assert found.mean() == pytest.approx(-2.0, rel=0.01)


def test_of_a_change_that_is_not_linear_too():
    """Of a delay, whose derivatives depend on where it is."""
    late = {"name": "command_delay", "d": 0.1}
    shots = problem(late)
    model = fit_model(FILE, [{"name": "command_delay", "d": 0.08}], shots, shots.shots.record.track, 12)
    found = imitated(problem({"name": "command_delay", "d": 0.04}, seed=1), model)
    assert found.mean() == pytest.approx(0.04, abs=0.01)
