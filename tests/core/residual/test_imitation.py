"""What the error of a hull's model makes of a change, against fits of the same to both recordings."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.diagnosis.model import fit_model
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.residual.imitation import imitations, pulls, widened

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
    return imitations(shots, FILE, model.unknown, model.values, fold)


def test_a_recording_that_the_model_of_the_hull_explains_imitates_nothing(model):
    assert imitated(problem(seed=1), model) == pytest.approx(np.zeros((2, 1)), abs=0.02)


def test_what_it_leaves_there_is_found_by_its_size_in_every_stretch(model):
    """A third of the change, which no change is, in the units of the entry."""
    found = imitated(problem({"name": "net_buoyancy", "dB": -2.0}, seed=1), model)
    assert found == pytest.approx(np.full((2, 1), -2.0), rel=0.03)


def test_of_a_change_that_is_not_linear_too():
    """Of a delay, whose derivatives depend on where it is."""
    late = {"name": "command_delay", "d": 0.1}
    shots = problem(late)
    model = fit_model(FILE, [{"name": "command_delay", "d": 0.08}], shots, shots.shots.record.track, 12)
    found = imitated(problem({"name": "command_delay", "d": 0.04}, seed=1), model)
    assert found.mean() == pytest.approx(0.04, abs=0.01)


def test_standard_errors_hold_what_is_imitated_and_how_stretches_differ(model):
    """Of imitations 3 and -4 the mean square is 12.5; stretches that pull by 2 each way add 16."""
    fit = model.estimated()
    wider = widened(fit, np.array([[3.0], [-4.0]]), np.array([[2.0], [-2.0]]))
    assert wider.standard_errors == pytest.approx(np.sqrt(12.5 + 16.0))
    assert wider.covariance == pytest.approx(12.5 + 16.0)
    assert dataclasses.replace(wider, covariance=0, standard_errors=0) == dataclasses.replace(
        fit, covariance=0, standard_errors=0
    )


def test_stretches_pull_by_what_fits_to_them_alone_would_find():
    """A hull that the file does not describe pulls the load of each half its own way, about equally far."""
    shots = problem(HEAVY, {"name": "crossflow_drag", "Cd_y": 0.05, "Cd_z": 0.05})
    fold = np.arange(len(shots.shots.starts)) * 2 // len(shots.shots.starts)

    def load(kept):
        part = OutputError(shots.shots.of(kept))
        return fit_model(FILE, ["net_buoyancy"], part, shots.shots.record.track, 12)

    whole = load(fold >= 0)
    pulled = pulls(whole.normal, whole.unknown, fold)[:, 0]
    apart = np.array([load(fold == one).values[0] - whole.values[0] for one in (0, 1)])
    assert pulled.sum() == pytest.approx(0.0, abs=0.05 * np.abs(pulled).max())
    assert np.sign(pulled).tolist() == np.sign(apart).tolist()
    assert np.abs(pulled).max() == pytest.approx(0.5 * np.abs(apart).mean(), rel=0.3)
