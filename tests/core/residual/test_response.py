"""The linear answer of shots to a wrench against whole simulations in which that wrench acts."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.effects.columns import effect_wrenches
from hydro.core.prediction import multiple_shooting
from hydro.core.prediction.candidate import candidate, true_velocity
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.residual.response import Transitions
from hydro.core.vehicle.frames import quaternion_from_euler

LATE = {"name": "sensor_delay", "d": 0.21}
TURNED = {"name": "sensor_misalignment", "alpha": [0.02, -0.03, 0.05]}


def exact(shots, record, nu):
    """Shots begun at the state itself, which the tables of a simulation hold."""
    states = np.hstack([record.eta[:, :3], quaternion_from_euler(*record.eta[:, 3:].T), nu])
    return dataclasses.replace(shots, first=states[shots.starts], eta=record.eta, nu=record.nu)


@pytest.mark.parametrize(
    "extra",
    [
        {"name": "net_buoyancy", "dB": 1.0},
        {"name": "crossflow_drag", "Cd_y": 0.04, "Cd_z": 0.04},
        {"name": "coupled_damping", "D15": 0.6, "D24": -0.5, "D51": 0.6},
    ],
    ids=lambda table: table["name"],
)
@pytest.mark.parametrize("log", [(), (LATE, TURNED)], ids=["plain", "late and turned"])
def test_what_a_wrench_does_is_taken_from_what_was_measured(extra, log):
    """Simulated with the wrench, corrected by the linear answer, the file's own prediction is left."""
    vehicle, truth = damped(*log), damped(*log, extra)
    record = recording(vehicle, moved(truth, rows=700))
    motion = recording(vehicle, moved(damped(extra), rows=700))
    shots = make_shots(record, lead=0.3 if log else 0.0, sigma=np.ones(12))
    shots = exact(shots, motion, motion.nu)
    shots = dataclasses.replace(shots, nu=record.nu)
    alone = msgspec.structs.replace(vehicle, effect=(extra,))
    wrench = effect_wrenches(alone, motion.eta, motion.nu, record.segments, record.t)
    model = candidate(vehicle)
    prepared = multiple_shooting.prepare(model, shots)
    corrected = Transitions.of(model, shots).corrected(wrench)
    inside = slice(1, -1)  # a spline's ends know no readings beyond the segment
    before = multiple_shooting.residuals(prepared, shots)[inside]
    after = multiple_shooting.residuals(prepared, corrected)[inside]
    for part in (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)):
        there = np.abs(before[..., part]).max()
        assert there > 1e-4
        assert np.abs(after[..., part]).max() < 0.1 * there
    assert np.abs(true_velocity(model, record, record.nu)[50:-50] - motion.nu[50:-50]).max() < 1e-3


def test_a_wrench_of_nothing_changes_nothing():
    record = recording(damped(), moved(damped(), rows=300))
    shots = make_shots(record)
    corrected = Transitions.of(candidate(damped()), shots).corrected(np.zeros((record.rows, 6)))
    np.testing.assert_allclose(corrected.measured, shots.measured, atol=1e-15)


def test_the_answer_to_a_beginning_is_the_derivative_of_the_prediction():
    """Transitions multiplied against predictions from beginnings that are moved."""
    vehicle = damped()
    record = recording(vehicle, moved(vehicle, rows=300))
    shots = exact(make_shots(record, sigma=np.ones(12)), record, record.nu)
    model, little = candidate(vehicle), 1e-4
    prepared = multiple_shooting.prepare(model, shots)
    none = np.zeros((len(shots.starts), shots.length, 6, 12))
    answers = Transitions.of(model, shots).answers(slice(None), none, np.eye(12))
    still = multiple_shooting.residuals(prepared, shots)
    for i, unit in enumerate(np.eye(12)):
        first = multiple_shooting.displaced(shots.first, little * unit[None])
        moved_on = (still - multiple_shooting.residuals(prepared, shots, first)) / little
        np.testing.assert_allclose(answers[..., i], moved_on, atol=1e-2 * max(1.0, np.abs(moved_on).max()))
