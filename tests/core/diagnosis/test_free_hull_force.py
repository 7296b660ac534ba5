"""Values with the hull force free, and when a hull law is judged by evidence."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from recordings import damped, moved, noisy

from hydro.core.diagnosis import pipeline
from hydro.core.diagnosis.baseline import Found, Outcome, refit, stable_shots
from hydro.core.diagnosis.by_likelihood import refine
from hydro.core.diagnosis.free_hull_force import limited_for_hull, with_free_hull_force
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.model import fit_model
from hydro.core.diagnosis.settings import DOUBTFUL, RIGHT
from hydro.core.effects.hull_laws import is_hull_law
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import free
from hydro.core.residual.allowance import Allowance
from hydro.core.residual.limits import WITHIN

FILE = damped()
DRAG = "quadratic_damping"
WEAK: dict[str, Any] = {"name": "thruster_asymmetry", "a": 0.2}
"""Weaker thrust astern, which more drag imitates."""
MORE_DRAG = {"name": DRAG, "diagonal": [140.0, 330.0, 480.0, 13.0, 55.0, 40.0]}
"""Drag of the vehicle, beyond that of its file."""


def recorded(*effects: dict[str, Any]) -> Any:
    """A recording of a vehicle with more drag than its file says; the drag of the file is held."""
    others = tuple(table for table in FILE.effect if table["name"] != DRAG)
    vehicle = msgspec.structs.replace(FILE, effect=(*others, MORE_DRAG, *effects))
    log = preprocess(FILE, noisy(moved(vehicle, rows=4000), 0))
    return replace(refit(FILE, log, stable_shots(FILE, log), FILE), effects=())


def test_values_do_not_absorb_the_drag_that_the_file_lacks():
    baseline = recorded(WEAK)
    model = fit_model(FILE, [WEAK["name"]], baseline.problem, baseline.log.track, 12)
    plain, free = model.estimated(), with_free_hull_force(baseline, model, [WEAK["name"]])
    assert model.normal.chi2 > RIGHT
    assert abs(plain.values[0] - WEAK["a"]) > 2.0 * WITHIN * plain.standard_errors[0]
    assert free is not None
    assert abs(free.values[0] - WEAK["a"]) < WITHIN * free.standard_errors[0]
    assert abs(free.values[0] - WEAK["a"]) < 0.2 * abs(plain.values[0] - WEAK["a"])


def test_values_of_a_model_that_may_be_right_are_those_of_the_fit():
    baseline = recorded()
    model = fit_model(FILE, [DRAG], baseline.problem, baseline.log.track, 12)
    assert model.normal.chi2 < RIGHT
    assert with_free_hull_force(baseline, model, [DRAG]) is None


def test_a_file_without_drag_keeps_the_fit():
    """The hull force would take over the drag."""
    wrong = cast(Any, SimpleNamespace(normal=SimpleNamespace(chi2=100.0)))
    bare = cast(Any, SimpleNamespace(vehicle=msgspec.structs.replace(FILE, effect=())))
    assert with_free_hull_force(bare, wrong, [WEAK["name"]]) is None


def outcome(chi2: float, *effects: str) -> Any:
    return SimpleNamespace(effects=effects, model=SimpleNamespace(normal=SimpleNamespace(chi2=chi2)))


@pytest.mark.parametrize(
    ("chi2", "effects", "bare", "alone"),
    [
        (10.0, ("added_mass", "cross_axis_drag"), False, True),
        (10.0, ("sensor_scale", "added_mass"), False, True),
        (10.0, ("added_mass", "payload"), False, False),
        (10.0, ("sensor_scale",), False, False),
        (10.0, (), False, False),
        (1.1, ("added_mass",), False, False),
        (10.0, ("added_mass",), True, False),
    ],
)
def test_hull_laws_alone_that_leave_an_error_are_judged_by_evidence(chi2, effects, bare, alone, monkeypatch):
    """A sensor error that kinematics shows does not count."""
    vehicle = msgspec.structs.replace(FILE, effect=()) if bare else FILE
    baseline = cast(Any, SimpleNamespace(vehicle=vehicle, sure="sensor_scale".__eq__))
    search = SimpleNamespace(wrong=lambda _: False, baseline=baseline, settle=lambda found, _: found)
    monkeypatch.setattr(pipeline, "selected", lambda *_: (search, outcome(chi2, *effects)))
    monkeypatch.setattr(pipeline, "reported", lambda regime, _: type(regime))
    regime = pipeline.chosen_and_reported(baseline, lambda *_: None, in_vain=False)
    assert regime is cast(Any, pipeline.ByEvidence if alone else pipeline.ByLikelihood)


def test_a_search_is_reconsidered_before_its_regime_is_chosen(monkeypatch):
    """The payload is dropped, and hull laws alone remain."""
    baseline = cast(Any, SimpleNamespace(vehicle=FILE, sure=lambda _: False))
    left = outcome(10.0, "added_mass")
    search = SimpleNamespace(wrong=lambda _: False, baseline=baseline, settle=lambda *_: left)
    monkeypatch.setattr(pipeline, "selected", lambda *_: (search, outcome(10.0, "payload", "added_mass")))
    monkeypatch.setattr(pipeline, "reported", lambda regime, _: regime)
    regime = cast(Any, pipeline.chosen_and_reported(baseline, lambda *_: None, in_vain=False))
    assert isinstance(regime, pipeline.ByEvidence)
    assert regime.outcome is left


def test_progress_does_not_fall_where_evidence_follows_a_search(monkeypatch):
    told = list[float]()

    def settle(found, progress):
        progress("without added_mass", 1.0)
        return found

    baseline = cast(Any, SimpleNamespace(vehicle=FILE, sure=lambda _: False))
    search = SimpleNamespace(wrong=lambda _: False, baseline=baseline, settle=settle)
    monkeypatch.setattr(pipeline, "selected", lambda *_: (search, outcome(10.0, "added_mass")))
    monkeypatch.setattr(pipeline, "reported", lambda _, progress: progress("held-out data", 0.0))
    pipeline.chosen_and_reported(baseline, lambda _, share: told.append(share), in_vain=False)
    assert told == sorted(told)


@pytest.mark.parametrize(
    ("chi2", "effect", "value", "limited"),
    [
        (10.0, "thruster_asymmetry", 0.2, False),
        (10.0, "thruster_asymmetry", 1e-5, True),
        (10.0, "cross_axis_drag", 50.0, True),
        (1.1, "cross_axis_drag", 50.0, False),
    ],
)
def test_confidence_with_an_unknown_hull_force(chi2, effect, value, limited):
    """A hull law may describe that force, and an effect that it takes over is not present."""
    unknown = free(FILE, [effect])
    fit = cast(Any, SimpleNamespace(free=unknown, values=np.full(len(unknown.entries), value)))
    baseline, model = cast(Any, SimpleNamespace(vehicle=FILE)), outcome(chi2).model
    assert limited_for_hull(0.86, effect, baseline, fit, model) == (DOUBTFUL if limited else 0.86)


def test_waves_and_predictions_that_diverge_leave_the_fit(monkeypatch):
    baseline = recorded(WEAK)
    model = fit_model(FILE, [WEAK["name"]], baseline.problem, baseline.log.track, 12)
    wave = baseline.problem.shots
    swell = np.zeros((len(wave.starts), wave.length - wave.lead, 12, 2))
    moving = replace(baseline, problem=OutputError(replace(wave, swell=swell)))
    assert with_free_hull_force(moving, model, [WEAK["name"]]) is None
    lost = SimpleNamespace(weight=np.repeat([1.0, 0.0], 10))
    monkeypatch.setattr(Allowance, "of", lambda *_: lost)
    assert with_free_hull_force(baseline, model, [WEAK["name"]]) is None


def test_values_in_the_answer_are_those_of_the_fitted_vehicle():
    """`hydro add` writes both, and refuses values that differ."""
    baseline = recorded(WEAK)
    model = fit_model(FILE, [WEAK["name"]], baseline.problem, baseline.log.track, 12)
    found = Found(WEAK["name"], 0.0, {WEAK["name"]: model})
    fitted = refine(baseline, Outcome(model, (found,), cast(Any, None)))
    free_fit = with_free_hull_force(baseline, fitted.model, [WEAK["name"]])
    assert fitted.fit is not None
    assert free_fit is not None
    np.testing.assert_allclose(fitted.fit.values, free_fit.values)
    assert fitted.fit.vehicle.effects(WEAK["name"])[0]["a"] == pytest.approx(fitted.fit.values[0], rel=0.01)


def test_laws_of_the_hull_are_those_of_its_motion_through_water():
    laws = ["added_mass", "cross_axis_drag", "body_lift", "fluid_memory", "linear_damping"]
    assert all(map(is_hull_law, laws))
    assert not any(map(is_hull_law, ["payload", "thruster_gain", "ocean_current", "sensor_scale"]))


def test_standard_errors_include_the_error_of_the_response():
    """Inertia in the file gives the force from the motion, so a tenth of the change is uncertain."""
    baseline = recorded(WEAK)
    model = fit_model(FILE, [WEAK["name"]], baseline.problem, baseline.log.track, 12)
    free = with_free_hull_force(baseline, model, [WEAK["name"]])
    assert free is not None
    assert free.standard_errors[0] >= 0.1 * abs(free.values[0])
    assert np.isfinite(free.standard_errors).all()
