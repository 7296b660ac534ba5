"""The benchmark of hidden effects: what it draws, how it scores, and a slice of it."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.stats import binomtest

from benchmarks.hidden_effects import cases, report, scoring, study, vehicles
from benchmarks.hidden_effects.figure import confusions
from hydro.core.effects import CATALOGUE, validate
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.logs.axis_faults import axis_faults
from hydro.core.recording.arrays import recording

ROOT = Path(__file__).resolve().parents[1]
SLICE = 26  # seed of the studies in the slice


def row(kind="one", called=("ocean_current",), found=(), **other):
    """A row of results; `found` lists (verdict, effect, members, confidence)."""
    verdicts, effects, members, confidences = zip(*found, strict=True) if found else ((), (), (), ())
    base = dict.fromkeys(study.SCHEMA) | {
        **{"kind": kind, "seed": 0, "preset": "auv151", "source": "simulate", "noise": 1.0, "seconds": 300.0},
        **{"title": " + ".join(called), "called": list(called), "misjudged": ["quadratic_damping"]},
        **{"share": 0.3, "shares": [0.3] * len(called), "truth": "{}", "failure": ""},
        **{"verdicts": list(verdicts), "effects": list(effects), "members": [list(m) for m in members]},
        **{"confidences": list(confidences), "chi2_given": 3.0, "chi2_own": 2.0, "chi2_end": 1.0},
        **{"before": 0.3, "after": 0.1, "oracle": 0.1, "floor": 0.05, "wall": 8.0, "cpu": 12.0},
    }
    return base | other


def missing(effect, *others, confidence=0.9):
    verdict = "cannot_tell_apart" if others else "missing"
    return (verdict, effect, (effect, *others), confidence)


UNKNOWN = ("none_of_the_known", "", (), None)
NOTHING = ("nothing_missing", "", (), None)


def test_a_mean_current_beside_one_that_changes_is_where_it_counts_from():
    found = [missing("ocean_current"), missing("current_trend")]
    one = scoring.score(row(called=("current_trend",), found=found))
    assert one.exact
    assert one.top
    both = scoring.score(row(called=("current_trend", "ocean_current"), found=found))
    assert both.exact
    assert not scoring.score(row(called=("tether",), found=found)).exact


def test_a_right_answer():
    one = scoring.score(row(found=[missing("ocean_current")]))
    assert one.top
    assert one.covered
    assert one.exact
    assert one.tied
    assert one.alarm
    assert not one.unknown
    assert one.answer == "ocean_current"


def test_a_suspect_counts_as_named_and_far_from_noise_as_unknown():
    suspect = ("suspect", "ocean_current", ("ocean_current",), 0.6)
    assert scoring.score(row(found=[suspect])).exact
    assert scoring.score(row(found=[("far_from_noise", "", (), None)])).unknown


def test_a_tie_set_that_holds_the_truth_is_no_right_answer():
    one = scoring.score(row(found=[missing("tether", "ocean_current")]))
    assert not one.top
    assert one.covered
    assert not one.exact
    assert one.tied


def test_retuning_what_the_file_has_wrong_does_not_count_and_other_retuning_does():
    excused = ("retune", "quadratic_damping", ("quadratic_damping",), None)
    one = scoring.score(row(found=[missing("ocean_current"), excused]))
    assert one.exact
    none = scoring.score(row("none", (), [NOTHING, excused]))
    assert not none.alarm
    assert none.answer == scoring.NOTHING
    wrongly = scoring.score(row("none", (), [("retune", "body_lift", ("body_lift",), None)]))
    assert wrongly.alarm
    sought = scoring.score(row(called=("quadratic_damping",), found=[excused]))
    assert sought.exact


def test_one_effect_too_many_or_what_is_left_unexplained_spoils_the_set():
    for extra in (missing("payload"), UNKNOWN):
        one = scoring.score(row(found=[missing("ocean_current"), extra]))
        assert one.top
        assert not one.exact
        assert not one.tied


@pytest.mark.parametrize(
    ("found", "exact", "tied"),
    [
        ([missing("a"), missing("b")], True, True),
        ([missing("b"), missing("a")], True, True),
        ([missing("a", "b"), missing("c", "a")], False, True),
        ([missing("a", "b"), missing("c")], False, False),
        ([missing("a", "b")], False, False),
        ([missing("c", "a"), missing("d", "a")], False, False),
    ],
)
def test_two_effects_need_a_tie_set_each(found, exact, tied):
    one = scoring.score(row("two", ("a", "b"), found))
    assert (one.exact, one.tied) == (exact, tied)


def test_no_alarm_is_nothing_named_and_nothing_unexplained():
    assert not scoring.score(row("none", (), [NOTHING])).alarm
    assert scoring.score(row("none", (), [UNKNOWN])).alarm
    assert scoring.score(row("none", (), [UNKNOWN])).answer == scoring.UNKNOWN


@pytest.mark.parametrize(
    ("after", "best", "floor", "within"),
    [(0.16, 0.1, 0.05, True), (0.161, 0.1, 0.05, False), (None, 0.1, 0.05, None), (0.1, None, 0.05, None)],
)
def test_the_error_after_adding_against_the_oracles(after, best, floor, within):
    assert scoring.score(row(after=after, oracle=best, floor=floor)).within is within


def test_strength_is_that_of_the_weakest():
    one = scoring.score(row("two", ("a", "b"), share=0.9, shares=[0.6, 0.05]))
    assert one.stratum == "2 to 10 %"
    assert scoring.score(row(share=1.0)).stratum == "above 50 %"
    assert scoring.score(row(share=0.0)).stratum == "below 2 %"


@pytest.mark.parametrize(("hits", "count"), [(0, 10), (3, 10), (10, 10), (498, 500)])
def test_intervals_are_clopper_and_pearsons(hits, count):
    exact = binomtest(hits, count).proportion_ci(method="exact")
    assert scoring.interval(hits, count) == pytest.approx((exact.low, exact.high))


def test_the_report_counts_every_kind(tmp_path):
    rows = [
        row(found=[missing("ocean_current", confidence=0.97)], seed=0),
        row(found=[missing("tether", "ocean_current", confidence=0.6)], seed=1),
        row("two", ("a", "b"), [missing("a"), missing("b")]),
        row("three", ("a", "b", "c"), [missing("a")]),
        row("unknown", (), [UNKNOWN], title="swell", oracle=None),
        row("unknown", (), [NOTHING], title="swell", oracle=None, seed=1, chi2_own=1.01),
        row("form", ("tether",), [UNKNOWN], title="tether that stiffens", oracle=None),
        row("none", (), [NOTHING], title=""),
        row("none", (), [missing("payload")], title="", seed=1),
        row(seed=2, failure="DataError: no way"),
    ]
    table = pl.DataFrame(rows, schema=study.SCHEMA)
    text = report.summary(table)
    first = next(line for line in text.splitlines() if line.startswith("| all |"))
    half = "50.0 % [1.3, 98.7] (1 of 2)"
    assert first.split(" | ")[1:5] == [half, "100.0 % [15.8, 100.0] (2 of 2)", "1.50", half]
    assert "| ocean_current | 2 | **ocean_current** 1, tether 1 |" in text
    assert "| nothing | 2 | **nothing** 1, payload 1 |" in text
    assert "| swell | 2 | none of the known 1, nothing 1 |" in text
    assert "anew: called unknown 100.0 % [2.5, 100.0] (1 of 1)." in text
    assert "| 95 to 99 % | 1 | 97.0 % | 100.0 %" in text
    assert "### Failed: 1 of 10" in text
    assert "no way" in text
    confusions([scoring.score(r) for r in rows if not r["failure"]], tmp_path / "c.png")
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")


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
    written = {name for name, effect in CATALOGUE.items() if effect.is_written or effect.is_random}
    assert hidden == set(CATALOGUE) - set(cases.LATER) - written, "every effect has its turn"
    assert later == set(cases.LATER)


def test_a_case_can_be_made_weaker():
    case = next(c for s in range(30) if (c := cases.draw("one", s)).called == ("tether",))
    half = cases.weaker(case)
    assert half.hidden[0]["k"] == pytest.approx(0.5 * case.hidden[0]["k"])
    assert half.hidden[0]["anchor"] == case.hidden[0]["anchor"]


def test_what_is_hidden_is_doubled_until_it_tells(tmp_path):
    """A current of a few mm/s: its share grows to what was asked for; nothing hidden stays so."""
    case = cases.draw("one", 12, "simulate")
    faint = dataclasses.replace(case, hidden=({"name": "ocean_current", "v_N": 0.004, "v_E": 0.004},))
    flown = study.fly(faint, 40.0, tmp_path)
    told, again = study.telling(faint, flown, 40.0, tmp_path, 0.02)
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
    assert study.telling(nothing, study.fly(nothing, 40.0, tmp_path), 40.0, tmp_path, 0.02)[0] is nothing


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


def test_a_study_that_fails_is_a_row(tmp_path):
    short = study.run(cases.draw("none", 0), 4.0, tmp_path)
    assert short["failure"]
    assert short["seed"] == 0


@pytest.mark.slow
def test_a_slice_of_the_benchmark(tmp_path):
    """A strong effect is named and nothing is where nothing is hidden; the same command goes on."""

    def command(*arguments):
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.hidden_effects", *map(str, arguments)],
            **{"cwd": ROOT, "text": True, "capture_output": True, "check": False},
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    out = tmp_path / "results.parquet"
    study_ = ("run", "--kind", "one", "--kind", "none", "--seconds", 80, "--workers", 2, "-o", out)
    command(*study_, "--studies", 1, "--first-seed", SLICE)
    assert command(*study_, "--studies", 1, "--first-seed", SLICE) == "", "all of it is there already"
    table = pl.read_parquet(out)
    assert table.schema == pl.Schema(study.SCHEMA)
    assert table["failure"].to_list() == ["", ""]
    one, none = map(scoring.score, table.sort("kind", descending=True).to_dicts())
    assert one.top
    assert one.within
    assert one.row["before"] > 1.1 * one.row["after"]
    assert not none.alarm
    assert set(json.loads(one.row["truth"])) == {"hidden", "foreign"}
    assert "### Nothing hidden" in command("report", out, "--plot", tmp_path / "c.png")
    assert (tmp_path / "c.png").exists()


def test_a_log_far_from_the_origin_is_not_read_in_knots(tmp_path):
    """What its lever arm adds is no motion; half of it is less of that, but no better explained."""
    flown = study.fly(cases.draw("one", 78001), 160.0, tmp_path)
    assert axis_faults(flown.measured, recording(flown.given, flown.measured)) is None
