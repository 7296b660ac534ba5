"""Tables of advised flights, and studies in which no flight is asked for."""

from __future__ import annotations

from types import SimpleNamespace

import polars as pl

from benchmarks.flown_advice import study
from benchmarks.flown_advice.__main__ import summary, table
from hydro.core.diagnosis.findings import Diagnosis, Finding

ROW = dict.fromkeys(study.SCHEMA) | {
    **{"seconds": 120.0, "family": "one heading", "open": "rivals", "inside": True, "failure": ""},
    **{"advised_outcome": "named", "advised_confidence": 0.95, "random_outcome": "nothing"},
}


def results(*changes: dict) -> pl.DataFrame:
    rows = [ROW | {"seed": seed} | change for seed, change in enumerate(changes)]
    return pl.DataFrame(rows, schema=study.SCHEMA)


def test_open_studies_alone_are_counted_beside_the_random_flight():
    told = results(
        {},
        {"advised_confidence": 0.8, "random_outcome": "named"},
        {"open": "unseen", "family": "one speed", "advised_outcome": "wrong: tether"},
        {"open": ""},
        {"failure": "DataError: too short"},
    )
    every, rivals, unseen, *families = table(told)
    assert [row["studies"] for row in (every, rivals, unseen)] == [3, 2, 1]
    assert [row["open"] for row in families] == ["one heading", "one speed"]
    assert every["truth first after the advised run"].endswith("(2 of 3)")
    assert every["truth first after a random one as long"].endswith("(1 of 3)")
    assert every["stated after the advised one"].endswith("(1 of 3)")
    assert every["wrong after it"].endswith("(1 of 3)")
    words = summary(told)
    assert "5 recordings of one manoeuvre, 3 of them open" in words
    assert "Seed 4 failed: DataError: too short" in words


def test_other_values_of_what_was_not_misjudged_are_a_wrong_name():
    vehicle = SimpleNamespace(name="hull")
    damping = Finding("retune", "linear_damping", ("linear_damping",), 0.1)
    inertia = Finding("retune", "added_mass", ("added_mass",), 0.7, confidence=1.0)
    sure = Finding("retune", "linear_damping", ("linear_damping",), 0.7, confidence=1.0)
    for findings, words in (((damping,), "nothing"), ((sure,), "nothing"), ((inertia,), "wrong: added_mass")):
        found = Diagnosis(findings, vehicle, (9.0, 1.0, 1.0), None)
        assert study.outcome(found, "tether", ["linear_damping"])["outcome"] == words


def test_a_diagnosis_without_a_question_asks_for_no_flight(monkeypatch):
    """Where no model fits, a flight would tell nothing apart."""
    vehicle = SimpleNamespace(name="hull")
    found = Diagnosis((), vehicle, (9.0, 9.0, 9.0), None)
    assert found.question is None
    sea = SimpleNamespace(case=SimpleNamespace(hidden=[]))
    monkeypatch.setattr(study.cases, "first_recording", lambda *_: (sea, pl.DataFrame()))
    monkeypatch.setattr(study, "clean", lambda case, *_: (case, None))
    monkeypatch.setattr(study, "diagnose", lambda *_: found)
    row = study.run(70_000, 120.0)
    assert row["failure"] == ""
    assert row["open"] == ""
