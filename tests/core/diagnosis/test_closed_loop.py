"""Under feedback, what a steady disturbance could do as well is not stated."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from recordings import damped, moved, noisy

from hydro.core.diagnosis import closed_loop
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.model import fit_model
from hydro.core.diagnosis.settings import NEARLY_EQUAL
from hydro.core.diagnosis.unexplained import WRENCH
from hydro.core.effects.surroundings import steady_pull
from hydro.core.identification.prior import in_file
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import free
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots


def told(push: float, doubled: float) -> float:
    """What stays of more linear damping, found where a steady force acts that the file has not."""
    file, true = damped(), damped(*steady(push))
    table = next(one for one in file.effect if one["name"] == "linear_damping")
    more = {**table, "diagonal": [doubled * value for value in table["diagonal"]]}
    true = msgspec.structs.replace(
        true, effect=tuple(more if one["name"] == "linear_damping" else one for one in true.effect)
    )
    raw = noisy(moved(true), 1)
    shots = make_shots(recording(file, raw))
    model = fit_model(file, ["linear_damping"], OutputError.of(shots, file), shots.record.track, 6)
    (found,) = closed_loop.own_shares(SimpleNamespace(vehicle=file), model).values()
    return found


def steady(push: float) -> list[dict]:
    return [steady_pull(push, np.array([1.0, 0.0, 0.0]), np.zeros(3))] if push else []


def test_real_damping_keeps_its_share_and_damping_that_imitates_a_force_loses_it():
    assert told(0.0, 2.0) > 0.9
    assert told(40.0, 1.0) < NEARLY_EQUAL


@pytest.mark.parametrize(
    ("count", "tells", "stays"), [(1, 5.0, 0), (1, 20.0, 1), (6, 20.0, 0), (6, 120.0, 1)]
)
def test_an_effect_stays_only_if_each_parameter_gains_enough(monkeypatch, count, tells, stays):
    """Twice what is told in all, and so the mean square of chance for each, is not enough for many."""
    file = damped()
    unknown = free(file, ["linear_damping"])
    unknown = replace(unknown, entries=unknown.entries[:count])
    step = np.full(count, 0.1)
    values = in_file(file, unknown.entries) + step * unknown.scales
    information = tells / float(step @ step) * np.eye(count)
    gram = np.zeros((1, WRENCH + count + 1, WRENCH + count + 1))
    gram[0, :WRENCH, :WRENCH] = np.eye(WRENCH)
    gram[0, WRENCH:-1, WRENCH:-1] = information
    monkeypatch.setattr(closed_loop, "_with_wrenches", lambda model: gram)
    model = cast(Any, SimpleNamespace(unknown=unknown, values=values, normal=SimpleNamespace(chi2=1.0)))
    found = closed_loop.own_shares(cast(Any, SimpleNamespace(vehicle=file)), model)
    assert found == {"linear_damping": pytest.approx(stays, abs=1e-6)}


@pytest.mark.parametrize(("own", "verdict"), [(0.9, "missing"), (0.3, "suspect")])
def test_an_effect_that_a_disturbance_can_replace_is_only_suspected(own, verdict):
    found = Finding("missing", "added_mass", ("added_mass",), 0.5, confidence=1.0, advice="add it")
    judged = closed_loop._judged(found, {"added_mass": own})
    assert judged.verdict == verdict
    assert judged.confidence == (1.0 if own > NEARLY_EQUAL else pytest.approx(0.3))


def test_new_values_that_a_disturbance_can_replace_are_not_offered():
    found = Finding("retune", "linear_damping", ("linear_damping",), 0.5, parameters={"diagonal": [1.0] * 6})
    judged = closed_loop._judged(found, {"linear_damping": 0.1})
    assert judged.verdict == "not_separable"
    assert judged.members[0] == "linear_damping"
    assert len(judged.members) > 1
    assert not judged.parameters
    assert "90%" in judged.advice
