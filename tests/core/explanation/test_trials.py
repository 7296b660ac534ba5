"""Shots that look as far ahead as the ladder does, and fits of a step."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from recordings import DT, damped, moved

from hydro.core.diagnosis.settings import LEAST_SHOTS
from hydro.core.explanation.ladder import HORIZON
from hydro.core.explanation.trials import Recordings
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.arrays import Recording, recording
from hydro.core.recording.shots import make_shots
from hydro.core.vehicle.description import Vehicle


def recordings(record: Recording) -> Recordings:
    """A recording as it is, without a held-out one."""
    sigma = np.full(12, 0.01)

    def shots(seconds: float) -> Any:
        return make_shots(record, seconds=seconds, sigma=sigma)

    track = np.column_stack([record.eta[:, :3], record.t])
    log = SimpleNamespace(record=record, track=track, shots=shots, noise=sigma)
    yardstick = SimpleNamespace(weights=SimpleNamespace(velocity=np.ones(6)))
    return Recordings(cast(Any, log), None, cast(Any, yardstick), None)


@cache
def more_damped() -> Vehicle:
    """The vehicle with twice the linear damping of its file."""
    file = damped()
    more = [
        one | {"diagonal": [2.0 * value for value in one["diagonal"]]}
        if one["name"] == "linear_damping"
        else one
        for one in file.effect
    ]
    return msgspec.structs.replace(file, effect=tuple(more))


@pytest.mark.parametrize(("count", "enough"), [(LEAST_SHOTS - 1, False), (LEAST_SHOTS, True)])
def test_a_recording_of_minimum_length_gives_all_shots_ahead(count, enough):
    record = recording(damped(), moved(more_damped(), rows=round(count * HORIZON / DT)))
    ahead = recordings(record).ahead(damped(), 100)
    assert (0 if ahead is None else len(ahead.shots.starts)) == (count if enough else 0)


def test_an_effect_is_fitted_from_its_own_initial_values():
    file, true = damped(), more_damped()
    record = recording(file, moved(true, rows=600))
    problem = OutputError.of(make_shots(record, sigma=np.full(12, 0.01)), file)
    fitted = recordings(record).tried(file, ["linear_damping"], problem, 2)
    found, expected = (one.effects("linear_damping")[0]["diagonal"] for one in (fitted, true))
    np.testing.assert_allclose(found, expected, rtol=0.2)


def test_fits_start_from_equation_error_if_it_predicts_better():
    """A thousandth of the true damping: a fit of predictions from there may end elsewhere."""
    true = more_damped()
    little = [one | {"diagonal": [0.001 * value for value in one["diagonal"]]} for one in true.effect[1:]]
    far = msgspec.structs.replace(true, effect=(true.effect[0], *little))
    study = recordings(recording(far, moved(true, rows=1500)))
    found = study.started(far, ["linear_damping", "quadratic_damping"])
    assert study.error_ahead(found) < 0.1 * study.error_ahead(far)
    assert study.started(far, []) is far
