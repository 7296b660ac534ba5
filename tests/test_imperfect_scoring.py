"""What an answer is worth where no model is exactly right."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from benchmarks import imperfect_tables
from benchmarks.imperfect_base import report, scoring, study
from benchmarks.imperfect_logs import report as logs_report
from benchmarks.imperfect_logs import study as logs_study


def finding(verdict, effect, *others, confidence=None):
    return (verdict, effect, (effect, *others) if effect else (), confidence)


def row(*found, called=("payload",), kind="changed", chi2_end=20.0, schema=study.SCHEMA, **other):
    """A row of results; `found` lists (verdict, effect, members, confidence)."""
    verdicts, effects, members, confidences = zip(*found, strict=True) if found else ((), (), (), ())
    return dict.fromkeys(schema) | {
        **{"kind": kind, "seed": 1, "preset": "auv151", "noise": 1.0, "seconds": 300.0, "failure": ""},
        **{"title": " + ".join(called), "called": list(called), "share": 0.4, "chi2_end": chi2_end},
        **{"verdicts": list(verdicts), "effects": list(effects), "members": [list(m) for m in members]},
        **{"confidences": list(confidences), "before": 0.3, "after": 0.2, "floor": 0.02},
        **{"cpu": 20.0, "study_cpu": 30.0},
        **other,
    }


BASE = {"base_error": 0.2, "base_floor": 0.02, "oracle": 0.2}
NOTHING = finding("nothing_missing", "")


@pytest.mark.parametrize("verdict", ["missing", "suspect", "retune"])
def test_each_verdict_that_names_one_effect_can_be_first(verdict):
    assert scoring.score(row(finding(verdict, "payload"))).outcome == "first"
    assert scoring.score(row(finding(verdict, "tether"))).outcome == "wrong"
    late = row(finding(verdict, "tether"), finding("missing", "payload", confidence=1.0))
    assert scoring.score(late).outcome == "wrong"


@pytest.mark.parametrize("verdict", ["cannot_tell_apart", "missing"])
def test_a_tie_is_counted_apart_wherever_the_truth_stands_in_it(verdict):
    for found in (finding(verdict, "payload", "tether"), finding(verdict, "tether", "payload")):
        one = scoring.score(row(found))
        assert one.outcome == "tied"
        assert not one.stated
    assert scoring.score(row(finding(verdict, "tether", "current"))).outcome == "wrong tie"


def test_verdicts_that_name_nothing_do_not_count():
    others = ("log_fault", "not_excited", "none_of_the_known", "far_from_noise", "closed_loop")
    for verdict in others:
        assert scoring.score(row(finding(verdict, "tether"))).outcome == "silent"
        after = row(finding(verdict, "tether"), finding("suspect", "payload"))
        assert scoring.score(after).outcome == "first"


def test_alarms_are_what_is_called_missing_or_retuned_surely():
    def alarm(*found):
        return scoring.score(row(*found, called=(), kind="nothing")).alarm

    assert alarm(finding("missing", "tether", confidence=0.1))
    assert alarm(finding("retune", "added_mass", confidence=0.9))
    assert not alarm(finding("retune", "added_mass", confidence=0.89))
    assert not alarm(finding("retune", "added_mass"))
    assert not alarm(finding("suspect", "tether", confidence=1.0))
    assert not alarm(finding("far_from_noise", ""))
    assert not alarm(NOTHING)


def test_what_a_condition_itself_hides_is_no_alarm():
    told = [finding("missing", "sensor_delay", confidence=1.0)]
    assert not scoring.score(row(*told, called=("sensor_delay",), kind="none")).alarm
    assert scoring.score(row(*told, called=("ocean_current",), kind="none")).alarm


def test_retuning_what_the_file_has_wrong_by_design_does_not_count():
    told = [finding("retune", "linear_damping", confidence=1.0)]
    excused = row(*told, called=(), misjudged=["linear_damping"])
    assert scoring.score(excused).outcome == "silent"
    assert not scoring.score(excused).alarm
    assert scoring.score(row(*told, called=())).alarm
    sought = row(*told, called=("linear_damping",), misjudged=["linear_damping"])
    assert scoring.score(sought).outcome == "first"


def test_statements_are_single_names_from_nine_tenths_on():
    wrong = scoring.score(row(finding("suspect", "payload", confidence=0.5), finding("missing", "tether")))
    assert not wrong.stated
    assert not wrong.stated_wrongly
    later = [finding("missing", "payload", confidence=0.95), finding("missing", "tether", confidence=0.9)]
    both = scoring.score(row(*later))
    assert both.stated
    assert both.stated_wrongly
    tie = scoring.score(row(finding("cannot_tell_apart", "tether", "current", confidence=0.99)))
    assert not tie.stated_wrongly


@pytest.mark.parametrize(("left", "blind"), [(2.9, False), (3.1, True)])
def test_nothing_is_missing_only_near_the_noise(left, blind):
    assert scoring.score(row(NOTHING, chi2_end=left)).blind is blind
    assert not scoring.score(row(finding("missing", "payload"), chi2_end=left)).blind


def test_bins_hold_equal_counts_and_every_naming_once():
    rng = np.random.default_rng(3)
    for count in (1, 99, 250, 730, 5000):
        confidence = rng.uniform(0.0, 1.0, count)
        parts = scoring.bins(confidence)
        assert sorted(np.concatenate(parts).tolist()) == list(range(count))
        assert len(parts) <= 10
        assert max(p.size for p in parts) - min(p.size for p in parts) <= 1
        assert len(parts) == 1 or min(p.size for p in parts) >= scoring.BIN
        tops = [confidence[part].max() for part in parts]
        assert tops == sorted(tops)


def test_equal_confidences_share_a_bin_and_those_below_have_one():
    """Most are certain: where enough are not, these are not hidden among them."""
    confidence = np.concatenate([np.full(290, 1.0), np.linspace(0.1, 0.9, 110)])
    doubtful, certain = scoring.bins(confidence)
    assert sorted(doubtful) == list(range(290, 400))
    assert sorted(certain) == list(range(290))
    assert len(scoring.bins(confidence[:-11])) == 1
    middle = np.concatenate([np.linspace(0.1, 0.4, 110), np.full(120, 0.5), np.linspace(0.6, 0.9, 110)])
    assert [part.size for part in scoring.bins(middle)] == [230, 110]


def test_the_brier_score_of_a_calibrated_forecast_is_its_variance():
    rng = np.random.default_rng(4)
    stated = rng.uniform(0.0, 1.0, 200_000)
    happened = (rng.uniform(size=stated.size) < stated).astype(float)
    assert scoring.brier(stated, happened) == pytest.approx(1.0 / 6.0, abs=2e-3)  # E[p (1 - p)]
    assert scoring.brier(happened, happened) == 0.0


def test_the_report_counts_what_it_says():
    rows = [
        row(finding("missing", "payload", confidence=0.95), **BASE, seed=1),
        row(finding("cannot_tell_apart", "tether", "payload"), **BASE, seed=2),
        row(finding("retune", "added_mass", confidence=0.97), **BASE, seed=3),
        row(NOTHING, **BASE, seed=4),
        row(finding("missing", "tether", confidence=0.9), **BASE, called=(), kind="nothing", seed=1),
        row(NOTHING, **BASE, seed=5, share=0.05),
        row(**BASE, seed=6) | {"failure": "DataError: too short"},
    ]
    text = report.summary(pl.DataFrame(rows, schema=study.SCHEMA))
    overall = next(line for line in text.splitlines() if line.startswith("| all |"))
    assert [cell.split("(")[-1].rstrip(") ") for cell in overall.split("|")[2:-1]] == [
        "1 of 4",  # named first
        "1 of 4",  # tied
        "1 of 4",  # nothing named
        "2 of 4",  # stated
        "1 of 4",  # wrong at 0.9
    ]
    assert "1 studies whose change makes less are left out" in text
    assert "above 3: 33.3 %" in text  # of all six scored, two said nothing was missing
    assert "Failed: 1 of 7" in text


def test_the_report_of_spoilt_logs_pairs_seeds():
    def told(seed, condition, name):
        return row(
            finding("missing", name, confidence=0.95),
            kind="one",
            seed=seed,
            condition=condition,
            hidden=["payload"],
            misjudged=[],
            schema=logs_study.SCHEMA,
        )

    rows = [told(1, "clean", "payload"), told(2, "clean", "tether")]
    rows += [told(1, "filtered", "tether"), told(2, "filtered", "payload")]
    text = logs_report.summary(pl.DataFrame(rows, schema=logs_study.SCHEMA))
    paired = next(line for line in text.splitlines() if line.startswith("| filtered |") and "of 1)" in line)
    assert "(0 of 1)" in paired.split("|")[2]
    assert "(1 of 1)" in paired.split("|")[4]


def test_kept_tables_have_the_file_as_given_as_their_baseline():
    studies = pl.DataFrame(
        [
            row(finding("missing", "tether", confidence=1.0), before=1.0, after=0.5, oracle=0.4),
            row(finding("suspect", "payload"), before=1.0, after=2.0, oracle=0.4),
            row(NOTHING, kind="nothing", called=()),
        ],
        schema_overrides={"oracle": pl.Float64},
    ).with_columns(with_before=False)
    kinds = {"rival": "regression", "condition": "imperfect base", "failure": "", "share": 1.0, "cpu": 1.0}
    named = {"misjudged": [], "called": ["tether"], "before": 1.0}
    rivals = pl.DataFrame(
        [
            kinds | named | {"kind": "one", "named": "tether", "after": 0.5},
            kinds | named | {"kind": "none", "named": "payload", "after": 3.0, "called": []},
        ]
    )
    ours, theirs, best, given = imperfect_tables.base(studies, rivals)
    assert ours["named first"].endswith("(1 of 2)")
    assert ours["error after / before"].startswith("1.25, greater in 50.0 %")
    assert theirs["named first"].endswith("(1 of 1)")
    assert theirs["alarm, nothing hidden"].endswith("(1 of 1)")
    assert best["error after / before"].startswith("0.40")
    assert given["error after / before"] == "1.00"
    assert given["nothing named"].endswith("(2 of 2)")
