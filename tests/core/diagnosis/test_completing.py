"""A file that is far from its vehicle is fitted to the earlier recording before its hull force is learnt."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from recordings import WEAK, damped, flown

from hydro.core.diagnosis import completing
from hydro.core.diagnosis.baseline import stable_shots
from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.pipeline import diagnose_log, hull_of
from hydro.core.diagnosis.settings import SURE
from hydro.core.diagnosis.status import Reference, with_sentences
from hydro.core.effects.built_in import with_built_in
from hydro.core.prediction.candidate import candidate
from hydro.core.residual.completion import Completion
from hydro.core.residual.hull import Hull, learnt
from hydro.core.residual.limits import FIT
from hydro.core.vehicle.description import Thruster, Vehicle

MASS, DRAG = {"name": "added_mass"}, {"name": "quadratic_damping"}


def far() -> Vehicle:
    """Return the file of the recorded vehicle with half of its inertia and a third of its drag."""
    near = damped()
    body = msgspec.structs.replace(
        near.rigid_body, inertia=(0.5 * np.array(near.rigid_body.inertia)).tolist()
    )
    effects = [
        {**table, "diagonal": (np.array(table["diagonal"]) / 3.0).tolist()}
        if str(table["name"]).endswith("damping")
        else table
        for table in near.effect
    ]
    return msgspec.structs.replace(near, rigid_body=body, effect=tuple(effects))


@pytest.fixture(scope="module")
def hull():
    return hull_of(far(), flown(seed=10))


def test_the_hull_force_is_learnt_about_the_fitted_file(hull):
    assert hull.completion is not None
    assert hull.completion.file == far()
    file = far()
    alone = learnt(file, stable_shots(file, preprocess(file, flown(seed=10))))
    assert alone.left > FIT
    assert hull.left < 0.5 * alone.left
    assert (hull.given, hull.alone.tolist()) == (alone.given, alone.alone.tolist())


def test_the_thrust_of_a_weak_thruster_is_right_although_the_file_is_far_off(hull):
    file = far()
    raw = flown(WEAK, seed=40, rows=1000).filter(session="s0")
    (found,) = diagnose_log(file, preprocess(file, raw, hull), hull=hull).findings
    assert (found.verdict, found.effect) == ("missing", "thruster_gain")
    assert found.confidence >= SURE
    away = found.parameters["g"][1] + 0.3
    assert abs(away) <= 2.0 * found.standard_errors["g"][1] + 0.01


def vehicle(*effects):
    return msgspec.structs.replace(damped(), effect=effects)


def test_changed_and_added_effects_stay_and_the_others_are_completed():
    fitted = (
        MASS | {"diagonal": [2.0] * 6},
        DRAG | {"diagonal": [3.0] * 6},
        {"name": "net_buoyancy", "dB": 1.0},
    )
    given = MASS | {"diagonal": [1.0] * 6}, DRAG | {"diagonal": [1.0] * 6}
    both = Completion(vehicle(*given), vehicle(*fitted))
    assert both.of(vehicle(*given)) == vehicle(*fitted)
    assert both.of(vehicle(*fitted)) == vehicle(*fitted)
    changed = DRAG | {"diagonal": [9.0] * 6}
    assert both.of(vehicle(given[0], changed, WEAK)) == vehicle(fitted[0], changed, WEAK, fitted[2])


def test_a_lag_is_that_of_thrusters_and_not_of_the_servo_of_a_fin():
    """Such a vehicle stays one that its file accepts."""
    near = damped()
    steered = msgspec.structs.replace(near, thruster=(*near.thruster, Thruster(name="c9", curve="none")))
    late = msgspec.structs.replace(steered, effect=({"name": "thruster_lag", "dT": 0.1},))
    whole = with_built_in(late, ["thruster_lag"])
    assert whole.thruster[-1] == steered.thruster[-1]
    assert whole.thruster[0].time_constant == pytest.approx(near.thruster[0].time_constant + 0.1)
    assert candidate(whole)


@pytest.mark.parametrize(("enough", "rounds"), [(True, 1), (False, 2)])
def test_fins_are_fitted_where_the_rest_of_the_file_is_not_enough(monkeypatch, enough, rounds):
    fin = {"name": "control_surface", "area": 0.4, "position": [-1.0, 0.0, 0.0], "stall": 0.3}
    tried, given, better = list[list[str]](), cast(Any, object()), cast(Any, object())

    def fitted(vehicle, log, hull, own):
        tried.append(own)
        return better if enough or "control_surface" in own else hull

    monkeypatch.setattr(completing, "_completed", fitted)
    assert completing.completed(damped(fin), cast(Any, None), given) is better
    assert ["control_surface" in own for own in tried] == [False, True][:rounds]


@pytest.mark.parametrize(("share", "told"), [(1.3, "is 1.3 times its earlier value"), (1.0, "is as before.")])
def test_sentences_name_the_earlier_value(share, told):
    """They compare with the values that were fitted to the earlier recording, not with those of the file."""
    near, file = damped(), far()
    hull = cast(Hull, SimpleNamespace(completion=Completion(file, near), completed=lambda vehicle: near))
    diagonal = [share * value for value in near.effects("quadratic_damping")[0]["diagonal"]]
    found = Finding("retune", "quadratic_damping", parameters={"diagonal": diagonal})
    answer = with_sentences(Diagnosis((found,), near, (1.0, 1.0, 1.0)), Reference.of(file, 0.02, hull))
    assert told in answer.findings[0].sentence
    assert "file" not in answer.findings[0].sentence
    assert "file" in with_sentences(answer, Reference.of(file, 0.02, None)).findings[0].sentence
