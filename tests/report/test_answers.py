"""Answers of diagnose: one screen, each statement once, and next commands that parse."""

from __future__ import annotations

import math
import re
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from command_lines import parse, pasted_from
from hypothesis import given
from hypothesis import strategies as st
from recordings import damped

from hydro.core.diagnosis.doubts import unconfirmed
from hydro.core.diagnosis.findings import Diagnosis, Finding, Prediction
from hydro.core.diagnosis.status import Reference, status
from hydro.core.experiment.advice import ADD, adding
from hydro.report import diagnosis
from hydro.report.diagnosis import Context
from hydro.report.following import Call, next_file, pasted, quoted
from hydro.report.next_steps import MEND, in_python, next_steps
from hydro.report.screen import MOST_LINES

GAIN = {"g": [0.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0, 0.0]}
VALUES = {
    "thruster_gain": GAIN,
    "ocean_current": {"v_N": 0.2, "v_E": -0.15, "v_D": 0.0},
    "net_buoyancy": {"dB": -5.0},
    "payload": {"mass": 3.0, "x": 0.2, "y": 0.0, "z": 0.1},
    "quadratic_damping": {"diagonal": [90.0, 260.0, 380.0, 10.0, 40.0, 30.0]},
}
UNSEEN = ("body_lift", "tether", "sensor_delay", "surface_suction", "ocean_waves")
KNOWN = Prediction(5.0, 0.3, 0.1, 0.01, 0.02, {axis: [0.3, 0.1, 0.02] for axis in "uvwpqr"})
CALL = Call(Path("my vehicle.toml"), ("dive 1.parquet",))


def answer(
    findings: list[Finding],
    *,
    width: int = 80,
    call: Call = CALL,
    known: Prediction | None = KNOWN,
    audit: Any = None,
    whole: bool = False,
) -> str:
    vehicle = damped()
    told = status(findings, Reference(vehicle, 0.02))
    log = SimpleNamespace(record=SimpleNamespace(dt=0.02), audit=audit)
    found = Diagnosis(tuple(findings), vehicle, (9.0, 5.0, 1.0), prediction=known, status=told)
    context = Context.of(found, vehicle, cast(Any, log), call)
    lines = diagnosis.answer(found.frame(), context, width, whole=whole)
    return "\n".join(line.text for line in lines)


def missing(name: str, **more) -> Finding:
    given = {"confidence": 0.97, "share": 0.6, "low": 0.5, "high": 0.7, "members": (name,), "advice": ADD}
    return Finding("missing", name, parameters=VALUES[name], **(given | more))


@st.composite
def findings(draw):
    """Findings of one diagnosis, some without a confidence or a share, and what the log does not show."""
    number = st.one_of(st.floats(0.0, 1.0), st.just(math.nan))
    found = [
        Finding(
            draw(st.sampled_from(["missing", "retune", "suspect", "cannot_tell_apart"])),
            name,
            (name, *draw(st.sampled_from([(), ("tether",)]))),
            draw(number),
            *draw(st.sampled_from([(math.nan, math.nan), (0.1, 0.9)])),
            confidence=draw(number),
            p_value=draw(st.sampled_from([math.nan, 1e-9, 0.03])),
            parameters=values,
            error_added=draw(st.sampled_from([math.nan, 0.05, 0.5])),
        )
        for name, values in VALUES.items()
        if draw(st.booleans())
    ]
    if draw(st.booleans()):
        found = [Finding("log_fault", members=("z",), advice="z moves in steps"), *found]
    found += draw(st.sampled_from([[], [Finding("none_of_the_known", share=0.2)], [Finding("closed_loop")]]))
    found = found or [Finding("nothing_missing")]
    return found + [Finding("not_excited", name, (name,)) for name in UNSEEN[: draw(st.integers(0, 5))]]


@given(findings(), st.sampled_from([None, KNOWN, replace(KNOWN, added=0.31), replace(KNOWN, added=0.3)]))
def test_an_answer_fits_one_screen_and_its_commands_parse(found, known):
    text = answer(found, known=known)
    lines = text.splitlines()
    assert len(lines) <= MOST_LINES
    assert max(map(len, lines)) <= 80
    assert "nan" not in text
    for line in pasted_from(text):
        parse(line)
        assert "my vehicle.toml" in shlex.split(line), "names are quoted"


@given(findings())
def test_an_answer_on_a_wide_terminal_fits_one_screen(found):
    assert len(answer(found, width=200).splitlines()) <= MOST_LINES


def test_a_finding_has_its_confidence_share_rivals_and_one_command():
    text = answer([missing("thruster_gain", members=("thruster_gain", "payload"))])
    assert "Thruster gain: very likely, 97 %." in text
    told = " ".join(text.split())
    assert "Without it 60 % (50 to 70 %) of the squared error returns; payload fits as well." in told
    (following,) = pasted_from(text)
    assert following == (
        "hydro diagnose 'my vehicle.toml' 'dive 1.parquet' | "
        "hydro add 'my vehicle.toml' -o 'my vehicle-1.toml'"
    )


def test_shares_of_several_findings_need_not_sum_to_one():
    changed = replace(missing("quadratic_damping", low=math.nan, high=math.nan), verdict="retune")
    text = " ".join(answer([missing("thruster_gain"), changed]).split())
    assert "The file's old values cause 60 % of its squared error." in text
    assert text.count("need not sum to 100 %") == 1
    assert "need not sum" not in answer([])


def test_each_value_with_its_error_is_printed_once():
    stated, suspected = (
        missing("thruster_gain", standard_errors={"g": [0.01] * 8}),
        replace(missing("net_buoyancy"), verdict="suspect", confidence=0.4),
    )
    text = " ".join(answer([stated, suspected]).split())
    for words in ("(±1) of its modelled thrust", "heavier than modelled"):
        assert text.count(words) == 1, text
    assert "Net buoyancy, unconfirmed: possible, 40 %." in text
    assert "Unconfirmed: the confidence in the name is below 90 %." in text


def test_details_have_the_sentence_the_test_and_the_advice():
    one = missing("net_buoyancy", p_value=0.001, advice="add it", sentence="It is heavier.")
    nothing = Finding("nothing_missing", advice="chi2 1")
    found = Diagnosis((one, nothing), damped(), (9.0, 5.0, 1.0)).frame()
    told = [(title, text) for title, _, text in diagnosis.details(found)]
    assert told == [
        ("Net buoyancy: new effect", "It is heavier. p = 0.001. Add it."),
        ("Nothing missing", "Chi2 1."),
    ]


def test_stated_findings_share_the_command_that_adds_all():
    text = answer(
        [missing("thruster_gain"), missing("ocean_current")], call=replace(CALL, output="d.parquet")
    )
    assert "Next: add both corrections to the vehicle file:" in text
    assert pasted_from(text) == ["hydro add 'my vehicle.toml' d.parquet -o 'my vehicle-1.toml'"]


def test_add_is_not_advised_if_it_would_refuse():
    text = answer([missing("thruster_gain")], known=replace(KNOWN, added=0.31))
    assert "hydro add refuses it" in " ".join(text.split())
    assert pasted_from(text) == ["hydro explain 'my vehicle.toml' 'dive 1.parquet' -o study"]
    suspect = replace(missing("payload"), verdict="suspect", confidence=0.5, error_added=0.4)
    assert pasted_from(answer([suspect])) == ["hydro explain 'my vehicle.toml' 'dive 1.parquet' -o study"]


def test_no_next_command_is_printed_for_a_recording_from_stdin():
    assert pasted_from(answer([missing("thruster_gain")], call=replace(CALL, measured=("-",)))) == []


def test_thrusters_that_contradict_the_file_get_the_command_that_continues():
    fault = Finding("log_fault", members=("cmd_1",), confidence=0.99, advice="thruster 1 is reversed")
    text = answer([fault])
    assert text.count("thruster 1 is reversed") == 1
    assert pasted_from(text) == ["hydro diagnose 'my vehicle.toml' 'dive 1.parquet' --correct-thrusters"]
    audit = SimpleNamespace(wrong=True, wiring=SimpleNamespace(reversed=(0, 3), moved=()))
    following = ["hydro vehicle flip 'my vehicle.toml' --thruster 1,4 -o 'my vehicle-1.toml'"]
    assert pasted_from(answer([fault], audit=audit)) == following


@pytest.mark.parametrize(
    ("name", "there", "following"),
    [
        ("vehicle.toml", [], "vehicle-1.toml"),
        ("data/auv.toml", ["auv-1.toml"], "auv-2.toml"),
        ("vehicle-3.toml", [], "vehicle-4.toml"),
    ],
)
def test_the_next_file_is_a_free_name(name, there, following, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for one in there:
        Path(one).touch()
    assert next_file(Path(name)) == following


WORDS = st.lists(st.text("ab -'|$", min_size=1, max_size=30), min_size=1, max_size=12)


@given(WORDS, st.integers(30, 120))
def test_a_pasted_command_is_parsed_to_the_same_words(words, width):
    line = "\n".join(pasted(quoted(["hydro", *words]), width))
    kept = ["hydro", *("|" if one == "|" else one for one in words)]
    assert shlex.split(line.replace("\\\n", " ")) == kept


def test_one_command_is_next_and_alternatives_write_other_files():
    stated, suspected = (
        missing("thruster_gain"),
        replace(missing("payload"), verdict="suspect", confidence=0.6),
    )
    saved = replace(CALL, output="d.parquet")
    assert pasted_from(answer([stated, suspected], call=saved)) == [
        "hydro add 'my vehicle.toml' d.parquet -o 'my vehicle-1.toml'"
    ]
    text = answer([stated, suspected], call=saved, whole=True)
    assert text.index("Next: add this correction to the vehicle file:") < text.index("Error 5 s ahead")
    assert pasted_from(text)[1:] == [
        "hydro add 'my vehicle.toml' d.parquet --effect payload -o 'my vehicle-payload.toml'"
    ]


@given(findings(), st.sampled_from([None, KNOWN, replace(KNOWN, added=0.31)]))
def test_no_two_commands_write_the_same_vehicle_file(found, known):
    lines = pasted_from(answer(found, known=known, whole=True))
    written = [one for line in lines for one in shlex.split(line) if one.startswith("my vehicle-")]
    assert len(written) == len(set(written))


def test_thrusters_are_corrected_before_findings_are_added():
    fault = Finding("log_fault", members=("cmd_1",), confidence=0.99, advice="thruster 1 is reversed")
    first, *others = next_steps(
        Diagnosis((fault, missing("payload")), damped(), (9.0, 5.0, 1.0)).frame(), KNOWN
    )
    assert (first.action, [one.action for one in others]) == ("correct_thrusters", ["add"])


def test_a_diagnosis_that_continued_is_not_repeated():
    fault = Finding("log_fault", members=("cmd_1", "cmd_2"), confidence=0.99, advice="columns are exchanged")
    first = next_steps(Diagnosis((fault, missing("payload")), damped(), (9.0, 5.0, 1.0)).frame(), KNOWN)[0]
    assert (first.words, in_python(first)) == (MEND, "")
    text = answer([fault, missing("payload")], call=replace(CALL, output="d.parquet"))
    assert pasted_from(text) == ["hydro add 'my vehicle.toml' d.parquet -o 'my vehicle-1.toml'"]


@pytest.mark.parametrize(
    ("change", "action"), [(-0.01, "compare"), (-0.2, "add")], ids=["half a sample", "ten samples"]
)
def test_an_effect_that_the_log_may_cause_is_not_to_be_added(change, action):
    """Thrusters quicker by half a sample: the log writes commands so, and nothing is to be changed."""
    words = adding("thruster_lag", {"dT": change}, 0.02)
    unsure = Finding("suspect", "thruster_lag", parameters={"dT": change}, confidence=0.3, advice=words)
    steps = next_steps(Diagnosis((unconfirmed(unsure),), damped(), (9.0, 5.0, 1.0)).frame(), None)
    assert [one.action for one in steps] == [action]


def needed_before() -> Finding:
    """An answer whose file is so far from the vehicle that the earlier recording needs the same effects."""
    effects = ("quadratic_damping", "payload")
    return Finding("none_of_the_known", members=effects, advice="fit them first")


def test_a_refused_change_comes_with_the_fit_of_the_earlier_recording():
    """The command has the user's own files, as a shell reads them."""
    call = replace(CALL, options={"--before": Path("last year.parquet"), "--map": Path("map.toml")})
    line, *_ = pasted_from(answer([needed_before()], call=call))
    assert line == (
        "hydro fit 'my vehicle.toml' 'last year.parquet' --map map.toml --effect quadratic_damping "
        "--effect payload -o 'my vehicle-fitted.toml'"
    )
    parse(line)
    whole = answer([needed_before()], call=call, whole=True)
    assert not re.search(r"\b[A-Z]{4,}\b", whole), "a placeholder"


def test_a_refused_change_without_files_comes_with_an_expression():
    step = next_steps(Diagnosis((needed_before(),), damped(), (9.0, 5.0, 1.0)).frame())[0]
    assert in_python(step) == "hydro.fit(vehicle, before, ['quadratic_damping', 'payload']).vehicle"


def test_the_sentence_of_the_diagnosis_is_shown():
    """It may compare with the values of an earlier recording, which the report does not know."""
    told = "A current of 0.25 m/s flows toward 323°, not 0.1 m/s as before."
    assert told in " ".join(answer([missing("ocean_current", sentence=told)]).split())
