"""A hull force that acts in the simulation, where the response of first order is too far off."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
import synthetic
from recordings import DAMPING, damped, flown, moved

from hydro.core.diagnosis.baseline import stable_shots
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.effects.columns import effect_wrenches
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.forced import ForcedOutputError, displaced_by
from hydro.core.prediction.multiple_shooting import predict
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots
from hydro.core.residual import hull as hulls
from hydro.core.residual.hull import learnt
from hydro.core.residual.response import Transitions


@pytest.fixture(scope="module")
def without_drag():
    """Shots of a damped vehicle, the file without its drag, and the force of the drag."""
    vehicle = synthetic.vehicle()
    record = recording(vehicle, moved(damped(), rows=700))
    alone = msgspec.structs.replace(vehicle, effect=DAMPING)
    wrench = effect_wrenches(alone, record.eta, record.nu, record.segments, record.t)
    return vehicle, make_shots(record, sigma=np.ones(12)), wrench


def test_a_simulated_force_leaves_less_than_its_response_of_first_order(without_drag):
    """Without drag the file runs away within a shot, and its response to the drag with it."""
    vehicle, shots, wrench = without_drag
    first = OutputError(Transitions.of(candidate(vehicle), shots).corrected(wrench))
    inside = slice(1, -1)  # the ends of a spline know no samples beyond the segment
    alone, linear, simulated = (
        np.abs(one.residuals(vehicle)[inside]).max()
        for one in (OutputError(shots), first, ForcedOutputError.under(shots, wrench))
    )
    assert simulated < 0.05 * alone
    assert simulated < 0.5 * linear


def test_no_force_changes_nothing(without_drag):
    vehicle, shots, wrench = without_drag
    still = ForcedOutputError.under(shots, 0.0 * wrench)
    np.testing.assert_allclose(still.residuals(vehicle), OutputError(shots).residuals(vehicle), atol=1e-12)


def test_a_thruster_effect_does_not_change_the_force(without_drag):
    """Gains, lags and losses of the vehicle's thrusters leave the thrusters of the wrench alone."""
    vehicle, shots, wrench = without_drag
    slow = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, {"name": "thruster_lag", "dT": 0.3}))
    rows = ForcedOutputError.under(shots, wrench).prepared(slow).model.thrusters[-6:]
    np.testing.assert_array_equal(rows, ForcedOutputError.under(shots, wrench).rows)


def test_measurements_move_by_the_difference_of_two_predictions(without_drag):
    vehicle, shots, wrench = without_drag
    forced = ForcedOutputError.under(shots, wrench)
    one, other = (predict(each.prepared(vehicle), each.shots) for each in (OutputError(shots), forced))
    reached = displaced_by(other, one, other)
    same = np.sign((reached[..., 3:7] * one[..., 3:7]).sum(axis=-1))  # q and -q are one attitude
    reached[..., 3:7] *= same[..., None]
    np.testing.assert_allclose(reached, one, atol=1e-9)
    one[0] = np.nan  # a prediction that diverges
    np.testing.assert_array_equal(displaced_by(other, one, other)[0], other[0])


def test_the_force_is_simulated_where_the_first_order_fails_and_held_out_data_agree(monkeypatch):
    """A file with five times the drag: its response to the force is 1.6 times too far off."""
    effects = (
        {**table, "diagonal": [5.0 * value for value in table["diagonal"]]}
        if "damping" in table["name"]
        else table
        for table in damped().effect
    )
    sticky = msgspec.structs.replace(damped(), effect=tuple(effects))
    monkeypatch.setattr(hulls, "RIGHT", 1.3)
    simulated = learnt(sticky, stable_shots(sticky, preprocess(sticky, flown(seed=10))))
    assert simulated.simulated
    assert simulated.left < 0.015 * simulated.given  # 0.03 by the response of first order
