"""The benchmark of hidden effects: which vehicles and effects it draws, and how they are flown."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.hidden_effects import cases, study, vehicles
from hydro.core.effects import CATALOGUE, validate
from hydro.core.effects.record import Role
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.logs.axis_faults import axis_faults
from hydro.core.recording.arrays import recording


def test_draws_are_possible_and_depend_on_kind_and_seed_alone():
    counts = {"one": 1, "two": 2, "three": 3, "none": 0, "later": 1}
    hidden, later = set(), set()
    for kind in cases.KINDS:
        for seed in range(len(cases.HIDDEN)):
            case = cases.draw(kind, seed)
            assert case == cases.draw(kind, seed)
            validate(vehicles.joined(vehicles.preset(case.preset), case.hidden))
            if kind in counts:
                assert len(case.called) == len(case.hidden) == counts[kind]
                assert not case.foreign
            if kind == "one":
                hidden |= set(case.called)
            if kind == "later":
                later |= set(case.called)
            if kind == "unknown":
                assert set(case.called) <= {"power_drag"}, "of any power, as two of them are"
                assert case.foreign
            if kind == "later":
                assert case.called == (cases.LATER[seed % len(cases.LATER)],)
            assert set(case.called) <= set(CATALOGUE)
    left_out = {
        name
        for name, effect in CATALOGUE.items()
        if effect.is_written or effect.is_random or Role.WHOLE_HULL in effect.roles
    }
    assert hidden == set(CATALOGUE) - set(cases.LATER) - left_out, "every other effect has its turn"
    assert later == set(cases.LATER)


def test_a_case_can_be_made_weaker():
    case = next(c for s in range(30) if (c := cases.draw("one", s)).called == ("tether",))
    half = cases.weaker(case)
    assert half.hidden[0]["k"] == pytest.approx(0.5 * case.hidden[0]["k"])
    assert half.hidden[0]["anchor"] == case.hidden[0]["anchor"]


def test_what_is_hidden_is_doubled_until_it_tells():
    """A current of a few mm/s: its share grows to what was asked for; nothing hidden stays so."""
    case = cases.draw("one", 12, "simulate")
    faint = dataclasses.replace(case, hidden=({"name": "ocean_current", "v_N": 0.004, "v_E": 0.004},))
    flown = study.fly(faint, 40.0)
    told, again = study.telling(faint, flown, 40.0, 0.02)
    shares = []
    for one, recorded in ((faint, flown), (told, again)):
        errors = Ahead(recorded.held_out, recorded.exact)
        shares.append(study.shares(one, recorded, errors, errors.of(recorded.given))[0])
    doubled = np.log2(told.hidden[0]["v_N"] / 0.004)
    assert shares[0] < 0.02
    assert doubled == round(doubled)
    assert 1 <= doubled <= study.STRONGER
    assert shares[1] >= 0.02 or doubled == study.STRONGER
    nothing = cases.draw("none", 0, "simulate")
    assert study.telling(nothing, study.fly(nothing, 40.0), 40.0, 0.02)[0] is nothing


def test_damping_is_at_most_a_quarter_wrong_and_nothing_else_is():
    vehicle = vehicles.preset("remus100")
    wrong = vehicles.misjudged(vehicle, np.random.default_rng(0))
    for right, table in zip(vehicle.effect, wrong.effect, strict=True):
        if right["name"] not in vehicles.damping_of(vehicle):
            assert table == right
            continue
        for key in set(right) - {"name"}:
            ratio = np.array(table[key]) / np.where(np.array(right[key]) == 0.0, 1.0, right[key])
            assert (np.abs(ratio - 1.0)[np.array(right[key]) != 0.0] <= 0.25).all()
            assert table[key] != right[key]
    assert set(vehicles.damping_of(vehicle)) == {"quadratic_damping", "crossflow_drag"}


def test_what_is_hidden_adds_to_what_the_file_has():
    vehicle = vehicles.preset("stonefish")
    extra = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    full = vehicles.joined(
        vehicle, [{"name": "added_mass", "diagonal": extra}, {"name": "payload", "w": 3.0}]
    )
    before, after = (np.array(v.effects("added_mass")[0]["matrix"]) for v in (vehicle, full))
    np.testing.assert_allclose(after - before, np.diag(extra))
    assert full.effects("payload") == ({"name": "payload", "w": 3.0},)
    assert len(full.effect) == len(vehicle.effect) + 1


def test_a_log_far_from_the_origin_is_not_read_in_knots():
    """What its lever arm adds is no motion; half of it is less of that, but no better explained."""
    flown = study.fly(cases.draw("one", 78001), 160.0)
    assert axis_faults(flown.measured, recording(flown.given, flown.measured)) is None
