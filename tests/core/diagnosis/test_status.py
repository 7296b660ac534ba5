"""The headline of a diagnosis: it says what the findings say, and nothing that contradicts them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import damped

from hydro.core.diagnosis.findings import Finding, Prediction
from hydro.core.diagnosis.settings import LIKELY, SURE
from hydro.core.diagnosis.status import Reference, in_words, status

STATED = {
    "thruster_gain": {"g": [0.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0, 0.0]},
    "ocean_current": {"v_N": 0.2, "v_E": -0.15, "v_D": 0.0},
    "net_buoyancy": {"dB": -5.0},
}
NOTHING = ("Nothing is missing", "Nothing has changed")
OF_WHOLE = st.sampled_from([None, "none_of_the_known", "far_from_noise", "nothing_missing"])


@st.composite
def findings(draw):
    """Findings of one diagnosis: effects, a log fault or none, and one verdict on the whole at most."""
    found = [
        Finding(draw(st.sampled_from(["missing", "retune", "suspect"])), name, (name,), parameters=values)
        for name, values in STATED.items()
        if draw(st.booleans())
    ]
    rest = draw(OF_WHOLE)
    found = [
        Finding(one.verdict, one.effect, one.members, parameters=one.parameters, confidence=draw(CONFIDENCE))
        for one in found
    ]
    if draw(st.booleans()):
        found = [Finding("log_fault", members=("z",), advice="z moves in steps"), *found]
    if rest == "nothing_missing" and any(one.effect for one in found):
        rest = None
    return [*found, Finding(rest)] if rest else found or [Finding("nothing_missing")]


CONFIDENCE = st.one_of(st.floats(0.0, 1.0), st.just(math.nan))


@given(findings(), st.sampled_from([None, 0.7, 3.0]))
def test_a_headline_contradicts_no_finding(found, left):
    answer = status(found, Reference(damped(), 0.02), left)
    verdicts = {one.verdict for one in found}
    unsure = [one for one in found if one.verdict == "retune" and one.confidence < SURE]
    stated = [one for one in found if one.verdict in ("missing", "retune") and one not in unsure]
    assert answer.headline.endswith((".", ")"))
    assert "nan" not in answer.headline
    assert (answer.kind == "stated") == bool(stated)
    assert answer.headline.startswith("Not certain") == (not stated and bool(unsure or "suspect" in verdicts))
    assert answer.headline.startswith(NOTHING) == (answer.kind == "nothing")
    if answer.headline.startswith(NOTHING):
        assert not verdicts & {"missing", "retune", "suspect", "none_of_the_known", "far_from_noise"}
    if "log_fault" in verdicts:
        assert "The log has a fault: z moves in steps." in answer.headline
    if "within its noise" in answer.headline:
        assert left is None
    if left == 3.0:
        assert answer.kind == "unexplained" or "remains" in answer.headline or "all of the" in answer.headline
    if answer.kind == "unexplained":
        assert not verdicts & {"missing", "retune", "suspect"}


def test_the_headline_counts_the_effects_and_has_a_sentence_for_each():
    found = [
        Finding(
            "missing",
            "thruster_gain",
            ("thruster_gain",),
            parameters=STATED["thruster_gain"],
            standard_errors={"g": [0.01] * 8},
        ),
        Finding("missing", "net_buoyancy", ("net_buoyancy",), parameters=STATED["net_buoyancy"]),
        Finding("retune", "quadratic_damping", ("quadratic_damping",)),
    ]
    text = status(found, Reference(damped(), 0.02)).headline
    assert text.startswith("The model needs 3 corrections: ")
    assert "hruster 4 delivers 70 %" in text
    assert status(found[:1], Reference(damped(), 0.02), 0.7).headline.startswith("1 effect has changed: ")


@pytest.mark.parametrize("added", [0.31, 0.1, 0.3])
def test_the_headline_says_that_findings_do_not_lower_the_error(added):
    found = Finding("missing", "net_buoyancy", ("net_buoyancy",), parameters=STATED["net_buoyancy"])
    known = Prediction(5.0, 0.3, added, 0.01, 0.02)
    text = status([found], Reference(damped(), 0.02), prediction=known).headline
    assert text.endswith("it does not lower the held-out prediction error.") == (added == 0.31)


def test_the_headline_tells_a_suspicion_where_the_stated_findings_are_refuted():
    known, suspected = (
        Finding(verdict, name, (name,), parameters=STATED[name], confidence=sure)
        for verdict, name, sure in (("missing", "net_buoyancy", 0.99), ("suspect", "thruster_gain", 0.59))
    )
    for added, told in ((0.31, True), (0.1, False)):
        prediction = Prediction(5.0, 0.3, added, 0.01, 0.02)
        text = status([known, suspected], Reference(damped(), 0.02), prediction=prediction).headline
        assert text.endswith("(possible, 59 %).") == told


def test_confidence_in_words():
    assert in_words(1.0) == "very likely, more than 98 %"
    assert in_words(0.97) == "very likely, 97 %"
    assert in_words(SURE - 0.01) == "likely, 89 %"
    assert in_words(LIKELY - 0.01) == "possible, 59 %"
    assert in_words(0.0) == "possible, less than 1 %"
    assert in_words(math.nan) == "possible"


def test_the_headline_of_a_stated_effect_with_unclear_values_says_that_it_explains_error():
    found = Finding(
        "missing", "net_buoyancy", ("net_buoyancy",), parameters={"dB": 3.0}, standard_errors={"dB": 2.0}
    )
    text = status([found], Reference(damped(), 0.02), 0.7).headline
    assert text.startswith("1 effect has changed: Net buoyancy explains a part of the error. ")


def test_the_headline_of_undetermined_gains_says_that_they_explain_error():
    found = Finding("missing", "thruster_gain", ("thruster_gain",), parameters=STATED["thruster_gain"])
    text = status([found], Reference(damped(), 0.02)).headline
    assert "Thruster gain explains a part of the error. Thrusters 1 to 8 are not determined" in text


def test_the_headline_shows_a_formula_instead_of_the_weight_that_it_replaces():
    formula = Finding("suspect", "formula", ("formula",), parameters={"forces": ["X u^3"], "force": [-300.0]})
    weight = Finding("suspect", "net_buoyancy", ("net_buoyancy",), parameters={"dB": -30.0}, confidence=0.02)
    text = status([formula, weight, Finding("none_of_the_known")], Reference(damped(), 0.02)).headline
    assert "heavier" not in text
    assert text.endswith("(possible).")


def test_a_change_within_the_recording_is_told_beside_an_unconfirmed_name():
    """Values of the whole recording then mean little, so the headline must say it."""
    unsure = Finding("suspect", "net_buoyancy", parameters=STATED["net_buoyancy"], confidence=0.4)
    within = Finding("none_of_the_known", advice="the vehicle seems to have changed within the recording")
    answer = status([unsure, within], Reference(damped(), 0.02), 3.0)
    assert answer.kind == "uncertain"
    assert answer.sentences[1] == "The vehicle seems to have changed within the recording."
