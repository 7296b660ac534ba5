"""Faults of fins: the study that plants them, the fit of their values, the sentences that name them."""

from __future__ import annotations

import math

import polars as pl
import pytest

from benchmarks import fin_faults
from benchmarks.remus_steps import preset
from hydro.core.diagnosis.findings import Finding
from hydro.core.effects.hull import named_fin
from hydro.core.effects.sentences import sentence
from hydro.core.identification.fit import fit

RUDDER, PLANES = fin_faults.FINS
SEEDS = {"stuck": 4, "half": 4, "trim": 4}


@pytest.fixture(scope="module")
def vehicle():
    return preset()


@pytest.mark.parametrize("fault", SEEDS)
def test_the_values_of_a_faulty_fin_are_fitted(vehicle, fault, monkeypatch):
    monkeypatch.setattr(fin_faults, "SECONDS", 30.0)
    changed, fin = fin_faults.with_fault(vehicle, fault, SEEDS[fault])
    raw = fin_faults.flown(changed, SEEDS[fault]).filter(session="s0")
    (true,) = changed.effects(fin)
    (found,) = fit(vehicle, raw, [fin], method="equation").vehicle.effects(fin)
    assert [found["area"], *found["turn"], found["deflection"]] == pytest.approx(
        [true["area"], *true["turn"], true.get("deflection", 0.0)], rel=0.15, abs=0.02
    )


def test_every_case_has_one_fault_and_the_unchanged_one_none(vehicle):
    for seed in range(20):
        for fault in fin_faults.FAULTS:
            changed, fin = fin_faults.with_fault(vehicle, fault, seed)
            pairs = zip(vehicle.effect, changed.effect, strict=True)
            assert [one["name"] for one, other in pairs if one != other] == [fin] * (fin != "")
    (stuck,) = fin_faults.with_fault(vehicle, "stuck", 3)[0].effects(RUDDER)
    assert {fin_faults.with_fault(vehicle, "stuck", seed)[1] for seed in range(20)} == {RUDDER, PLANES}
    assert set(stuck) >= {"area", "turn"}


def test_the_autopilot_moves_both_fins_within_their_stops(vehicle, monkeypatch):
    monkeypatch.setattr(fin_faults, "SECONDS", 20.0)
    raw = fin_faults.flown(vehicle, 0)
    commands = raw.select("^cmd_.*$")
    assert raw["session"].n_unique() == fin_faults.SESSIONS
    assert commands.min_horizontal().min() >= -1.0
    assert commands.max_horizontal().max() <= 1.0
    assert commands.select(pl.all().std()).row(0) > (0.01, 0.2, 0.2)
    assert raw["u"].max() > 1.0


def test_a_fault_counts_as_found_by_a_stated_name_of_its_fin():
    assert fin_faults.right(Finding("retune", RUDDER), RUDDER)
    assert not fin_faults.right(Finding("retune", PLANES), RUDDER)
    assert not fin_faults.right(Finding("suspect", RUDDER), RUDDER)
    assert fin_faults.right(Finding("nothing_missing"), "")
    assert not fin_faults.right(Finding("retune", RUDDER), "")


def test_the_report_counts_each_fault():
    case = {
        "fault": "half",
        "fin": RUDDER,
        "found": RUDDER,
        "verdict": "retune",
        "right": True,
        "seconds": 3.0,
    }
    wrong = case | {"found": PLANES, "right": False, "seconds": 5.0}
    (row,) = fin_faults.report([case, wrong])
    assert row["fin named first"] == row["stated and right"] == row["stated and wrong"] == "1 of 2"
    assert row["processor seconds per case"] == "4"


def told(vehicle, values, errors, *, brief=False):
    (table,) = vehicle.effects(RUDDER)
    return sentence(vehicle, RUDDER, table | values, errors, 0.1, brief=brief)


def test_a_fin_that_no_longer_moves_is_said_to_be_stuck(vehicle):
    values, errors = (
        {"turn": [0.002], "deflection": math.radians(-3.0)},
        {"turn": [0.01], "deflection": 0.003},
    )
    text = told(vehicle, values, errors)
    assert text.startswith("The rudder no longer follows command 2: it stays at -3.0")
    assert told(vehicle, values, errors, brief=True).endswith("it stays at -3°.")


def test_half_a_fin_and_a_bent_fin_are_named_by_their_values(vehicle):
    half = told(vehicle, {"area": 0.002979}, {"area": 1e-4})
    assert half.startswith("The rudder's area is 0.5 times the file's value")
    bent = told(vehicle, {"deflection": 0.05}, {"deflection": 0.002})
    assert bent.startswith("The rudder's deflection is 2.9")


def test_a_fin_without_a_label_is_called_the_fin():
    assert named_fin("control_surface") == named_fin("control_surface:2") == "the fin"
    assert named_fin(PLANES) == "the stern planes"
