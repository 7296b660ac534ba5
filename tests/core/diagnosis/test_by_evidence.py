"""How far a name by transfer is believed where no model reaches the noise."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, cast

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.diagnosis import by_evidence
from hydro.core.diagnosis.baseline import Baseline
from hydro.core.diagnosis.confidence import by_evidence_confidence, by_transfer_confidence
from hydro.core.diagnosis.findings import Finding, extended
from hydro.core.diagnosis.settings import DOUBTFUL, SURE
from hydro.core.diagnosis.transfer import Rival, Survey
from hydro.core.identification.outcome import Fit
from hydro.core.preprocessing.sensor_tests import KinematicTest
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files

VEHICLES = Path(__file__).resolve().parents[3] / "datasets" / "vehicles"


FILE = files.read(VEHICLES / "auv151.toml")[0]
LIFT = {"L11": 0.0, "L15": 0.0, "L51": 0.0, "L55": 0.0, "L22": 12.0, "L24": 0.0, "L42": 0.0, "L44": 0.0}


def payload(x: float) -> dict[str, Any]:
    return {"w": 3.0, "x": x, "y": 0.1, "z": 0.0, "mass": 1.0}


def named(
    effect: str, table: dict[str, Any], vehicle: Vehicle = FILE, better: str = "", *, excluded: bool = True
) -> Finding:
    """Return what is said of an effect that removes nearly all of the error of left-out data.

    A `better` effect may be `excluded`, because it predicts longer stretches worse.
    """
    fit = SimpleNamespace(
        vehicle=extended(vehicle, [{"name": effect, **table}]), table=lambda effect: (table, {})
    )
    rival = Rival(effect, False, cast(Any, None), 0.98, 0.98)
    normal = SimpleNamespace(score=np.ones((20, 1)), chi2=50.0)
    model = SimpleNamespace(normal=normal, costs=np.ones(20), excesses=np.full(20, 9.0))
    lesser = SimpleNamespace(costs=np.full(20, 10.0), excesses=np.full(20, 9.0), vehicle=vehicle)
    first = [Rival(better, False, cast(Any, None), 0.99, 0.99)] if better else []
    survey = Survey(cast(Any, None), (*first, rival), False, (rival,) if excluded else (*first, rival))
    parts = cast(Any, (rival, survey, [], model, lesser, cast(Fit, fit), 0.02))
    return by_evidence._finding(*parts)


def test_a_hull_law_is_confirmed_only_for_a_file_without_drag():
    """Beside drag it may stand for the error of the drag; a payload cannot."""
    bare = msgspec.structs.replace(FILE, effect=())
    assert named("payload", payload(0.1)).is_confirmed
    assert not named("body_lift", LIFT).is_confirmed
    assert named("body_lift", LIFT).confidence == DOUBTFUL
    assert named("body_lift", LIFT, bare).is_confirmed


@pytest.mark.parametrize(("lengths", "verdict"), [(0.3, "missing"), (1.7, "suspect")])
def test_a_payload_at_an_implausible_place_is_only_suspected(lengths: float, verdict: str):
    """What transfers with a value beyond what physics leaves stands for something else."""
    finding = named("payload", payload(lengths * FILE.hull.length))
    assert finding.verdict == verdict
    assert finding.confidence is not None
    assert (finding.confidence >= SURE) == (verdict == "missing")


@pytest.mark.parametrize("stated", [0.0, 0.08])
def test_a_sensor_error_that_kinematics_shows_is_found_whatever_the_search_chose(stated, monkeypatch):
    """A DVL scale of 8 %, known to a tenth of a percent, unless the file states it already."""
    vehicle = FILE
    if stated:
        vehicle = extended(vehicle, [{"name": "sensor_scale", "s": stated}])
    test = KinematicTest("sensor_scale", np.full(3, 0.08), 1e-6 * np.eye(3), 100, 0.005, 1e5)
    log = SimpleNamespace(track=np.zeros((1, 4)), record=SimpleNamespace(dt=0.05))
    shown = SimpleNamespace(
        vehicle=vehicle,
        effects=(),
        sensors={"sensor_scale": test},
        refitted=SimpleNamespace(vehicle=vehicle),
        problem=None,
        log=log,
        explained=lambda _: 0.5,
    )
    monkeypatch.setattr(by_evidence, "fit_model", lambda *_: None)
    found = list(by_evidence._sensor_errors(cast(Any, shown)))
    assert [(one.verdict, one.share) for one in found] == ([] if stated else [("missing", 0.5)])


def test_fits_start_from_values_that_the_search_found(monkeypatch):
    """A current far from zero is lost from a linearised start; values of the file's effects are its own."""
    vehicle = FILE
    current = {"name": "ocean_current", "v_N": 0.2, "v_E": -0.1, "v_D": 0.0}
    own = vehicle.effect[0]["name"]
    fitted = SimpleNamespace(vehicle=extended(vehicle, [current]))
    found = [SimpleNamespace(effect=name, model=fitted) for name in ("ocean_current", own)]
    baseline = Baseline(vehicle, (own,), *[cast(Any, None)] * 4, sensors={})
    starts = list[Any]()
    named = by_evidence.Named((), cast(Any, fitted), None, cast(Any, fitted))
    monkeypatch.setattr(by_evidence, "by_transfer", lambda *given: starts.append(given[2]) or named)
    by_evidence.ByEvidence(baseline, cast(Any, SimpleNamespace(found=found))).select(lambda *_: None)
    assert starts == [{"ocean_current": current}]


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_transfer_confidence_grows_with_score_and_lead(score, more, rival):
    """Where another effect removes as much, nothing is stated."""
    here = by_transfer_confidence(score, [rival])
    assert here <= by_transfer_confidence(score, [])
    assert here <= by_transfer_confidence(max(score, more), [rival])
    assert by_transfer_confidence(score, [rival]) >= by_transfer_confidence(score, [rival, more])
    assert by_transfer_confidence(score, [score]) <= 0.5
    assert by_transfer_confidence(1.0, [0.5]) >= SURE


def test_evidence_confidence_grows_with_the_lead_from_one_half():
    sure = [by_evidence_confidence(lead + 100.0, [100.0, -5.0]) for lead in (0.0, 3.0, 40.0, 200.0)]
    assert sure == sorted(sure)
    assert sure[0] == pytest.approx(0.5, abs=0.01)
    assert sure[1] < 0.6
    assert SURE < sure[2] < sure[3] < 1.0
    assert by_evidence_confidence(70.0, [100.0]) < 0.2, "another has more evidence"
    assert by_evidence_confidence(1558.0, [1449.0]) < SURE, "a lead of 109, but any of them could be it"
    assert by_evidence_confidence(0.0, [-30.0]) == 0.0, "no more evidence than the file alone"


class Weighing:
    """An allowance that has an evidence for each effect."""

    evidence: ClassVar[dict[str, float]] = {}

    @classmethod
    def of(cls, *_):
        return cls()

    def held(self, unknown, values, prior):
        return SimpleNamespace(evidence=self.evidence[unknown], best=values)

    def refined(self, unknown, held, prior, most, gain):
        return held


def order(monkeypatch, evidence: dict[str, float], scores: dict[str, float]) -> tuple[bool, list[str]]:
    """Whether evidence orders rivals of these scores, and their order."""
    monkeypatch.setattr(Weighing, "evidence", {"alone": -100.0, **evidence})
    monkeypatch.setattr(by_evidence, "Allowance", Weighing)
    file = files.read(Path(__file__).parents[3] / "datasets" / "vehicles" / "auv151.toml")[0]
    few = SimpleNamespace(shots=None)
    baseline = SimpleNamespace(vehicle=file, problem=SimpleNamespace(some=lambda _: few))

    def model(name: str) -> Any:
        return SimpleNamespace(unknown=name, values=np.zeros(1))

    known: Any = SimpleNamespace(alone=lambda _: None, releasing=lambda _: known)
    rivals = tuple(Rival(name, False, model(name), score, score) for name, score in scores.items())
    surveyed = Survey(model("alone"), rivals, False, rivals)
    found = by_evidence.ranked_by_evidence(surveyed, cast(Any, baseline), model("alone"), known)
    return found.by_evidence, [rival.effect for rival in found.rivals]


def test_evidence_ranks_names_if_it_is_large_enough(monkeypatch):
    scores = {"thruster_inflow": 0.5, "payload": 0.4, "tether": -0.1}
    evidence = {"thruster_inflow": -80.0, "payload": -40.0, "tether": -np.inf}
    assert order(monkeypatch, evidence, scores) == (True, ["payload", "thruster_inflow", "tether"])
    evidence["tether"] = 500.0
    assert order(monkeypatch, evidence, scores)[1][0] == "payload", "a tether removes nothing elsewhere"
    evidence |= {"payload": -95.0, "thruster_inflow": -98.0}
    assert order(monkeypatch, evidence, scores) == (False, list(scores)), "chance alone gives as much"


def may_be_named(
    monkeypatch, evidence: dict[str, float], scores: dict[str, float], left: dict[str, float] | None
):
    """Names of the effects that may be named, and whether evidence ranks them.

    `left` are shares of the error of longer predictions; None where the recording is too short for them.
    """
    fit = SimpleNamespace(table=lambda effect: ({}, {}), vehicle=FILE)
    rivals = tuple(
        SimpleNamespace(
            effect=name, own=False, entries=1, evidence=evidence[name], score=score, estimated=lambda: fit
        )
        for name, score in scores.items()
    )

    def behind(tried: list[tuple[Any, float]], fair: list[bool]) -> list[bool]:
        assert all(fair)
        return [share > min(one for _, one in tried) + 0.1 for _, share in tried]

    check = SimpleNamespace(
        squares=lambda tables: left[tables[0]["name"]], removed=lambda _, share: 1.0 - share, behind=behind
    )
    monkeypatch.setattr(by_evidence.HeldOut, "of", lambda *_: None if left is None else check)
    ranks = cast(Any, rivals), cast(Any, tuple(sorted(rivals, key=lambda one: -one.score)))
    surveyed, scored = (Survey(cast(Any, None), one, one is ranks[0], one) for one in ranks)
    found = by_evidence.leading(surveyed, scored, cast(Any, SimpleNamespace(vehicle=None, log=None)))
    assert found.rivals == (surveyed if found.by_evidence else scored).rivals
    return [one.effect for one in found.leading], found.by_evidence


def test_only_effects_that_predict_longer_stretches_best_may_be_named(monkeypatch):
    """Weaker thrust may imitate added mass over two seconds, with more evidence, but not over five."""
    evidence = {"thruster_gain": 44.0, "fluid_memory": 30.0, "added_mass": -27.0, "payload": -30.0}
    scores = {"thruster_gain": 0.76, "fluid_memory": 0.43, "added_mass": 0.763, "payload": 0.04}
    left = {"thruster_gain": 1.86, "fluid_memory": 0.86, "added_mass": 0.59, "payload": 0.5}
    assert may_be_named(monkeypatch, evidence, scores, left) == (["added_mass"], False)
    assert may_be_named(monkeypatch, evidence, scores, None) == (list(evidence), True)
    left["fluid_memory"] = 0.6
    assert may_be_named(monkeypatch, evidence, scores, left) == (["fluid_memory", "added_mass"], True)


def test_nothing_is_named_that_does_not_lower_the_error_of_longer_predictions(monkeypatch):
    evidence, scores = {"thruster_gain": 16.0, "payload": 8.0}, {"thruster_gain": 0.12, "payload": 0.06}
    assert may_be_named(monkeypatch, evidence, scores, {"thruster_gain": 1.4, "payload": 0.99}) == ([], False)


def test_confidence_counts_leads_over_effects_that_may_be_named_alone():
    """Weaker thrust has far more evidence, but predicts longer stretches worse."""
    gain, mass, memory = (Rival(name, False, cast(Any, None), 0.9, 0.9) for name in "gmf")
    survey = Survey(cast(Any, None), (gain, mass, memory), by_evidence=True, leading=(mass, memory))
    assert survey.alternatives(mass, ()) == [memory]
    assert survey.alternatives(mass, ["f"]) == []
    assert named("payload", payload(0.1), better="thruster_gain").confidence >= SURE
    assert named("payload", payload(0.1), better="thruster_gain", excluded=False).confidence == DOUBTFUL


def test_further_names_have_no_more_confidence_than_the_first(monkeypatch):
    """Two that have all but the same evidence: neither is likely, and the better is not the less sure."""
    table = {"v_N": 0.2, "v_E": 0.1}
    vehicle = extended(files.read(VEHICLES / "auv151.toml")[0], [{"name": "ocean_current", **table}])
    free = SimpleNamespace(places=lambda _: [0], scales=np.ones(1))
    fit = SimpleNamespace(vehicle=vehicle, free=free, values=np.ones(1), table=lambda effect: (table, {}))
    model = SimpleNamespace(normal=SimpleNamespace(score=np.ones((20, 1))), costs=np.ones(20))
    model.excesses = np.ones(20)
    first, second = (
        SimpleNamespace(
            effect=name, own=False, evidence=evidence, score=0.5, model=model, estimated=lambda: fit
        )
        for name, evidence in (("payload", 30.0), ("ocean_current", 29.0))
    )
    both = cast(Any, (first, second))
    survey = Survey(cast(Any, model), both, by_evidence=True, leading=both)
    finding = SimpleNamespace(confidence=0.05)
    monkeypatch.setattr(by_evidence, "with_response_error", lambda fit, file: fit)
    baseline = SimpleNamespace(vehicle=vehicle, log=SimpleNamespace(record=SimpleNamespace(dt=0.02)))
    (told,) = by_evidence._nearly_as_good(*cast(Any, (first, survey, [second], finding, baseline)))
    assert (told.effect, told.confidence) == ("ocean_current", finding.confidence)
