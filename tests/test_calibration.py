"""Calibration of stated confidence, on tables whose calibration is known in closed form."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from benchmarks import calibration, kept_tables
from benchmarks.calibration import BIN
from benchmarks.judge import rows
from benchmarks.judge.scores import score

STUDY = dict.fromkeys(rows.SCHEMA) | {"role": "finding", "failure": "", "alias": [], "misjudged": []}


def study(seed, *found, called=("payload",), **other):
    """The rows of a study; `found` lists (verdict, effect, confidence, support)."""
    same = STUDY | {"list": "clean-one", "seed": seed, "seconds": 160.0, "called": list(called)} | other
    return [
        same
        | {"rank": rank, "verdict": verdict, "effect": effect, "members": [effect] if effect else []}
        | {"confidence": confidence, "support": support}
        for rank, (verdict, effect, confidence, support) in enumerate(found)
    ] or [same | {"role": "none"}]


def forecasts(studies):
    return calibration.forecasts([score(each) for each in studies])


def calibrated(count=100, levels=((0.5, 1.0), (0.6, 1.0), (0.9, 1.0)), first=10_000, **other):
    """Studies of which exactly the stated share is named right, at each of a few levels."""
    studies, seed = [], first
    for stated, support in levels:
        for number in range(count):
            effect = "payload" if number < round(stated * count) else "tether"
            studies.append(study(seed, ("missing", effect, stated, support), **other))
            seed += 1
    return studies


def first_row(those, forecast="as stated"):
    return next(row for row in calibration.scores(those) if row["forecast"] == forecast)


def test_a_calibrated_forecaster_has_the_brier_score_of_its_variance():
    """E (c - right)^2 = c (1 - c) where a share c of the names stated at c is right."""
    found = forecasts(calibrated())
    row = first_row(found)
    expected = np.mean([0.5 * 0.5, 0.6 * 0.4, 0.9 * 0.1])
    assert float(row["Brier score"]) == pytest.approx(expected, abs=5e-5)
    share = (50 + 60 + 90) / 300
    assert float(row["of the base rate"]) == pytest.approx(share * (1.0 - share), abs=5e-5)
    assert calibration.held(found, "confidence") == [True, True, True]


def test_before_calibration_is_scored_by_what_the_confidence_was_made_from():
    """At a support of 1 the squared error is the share of wrong names."""
    row = first_row(forecasts(calibrated()), "before calibration")
    assert float(row["Brier score"]) == pytest.approx(1.0 - 200 / 300, abs=5e-5)
    assert calibration.held(forecasts(calibrated()), "support") == [False]


@pytest.mark.parametrize(("part", "expected"), [(1.0, 1.0), (0.5, 2.0), (1.25, 0.8)])
def test_the_slope_is_the_ratio_of_true_and_stated_differences(part, expected):
    """Confidences are moved from their mean of 0.55 by a part of their distance, and the truth stays."""
    levels = [(true, 0.55 + part * (true - 0.55)) for true in (0.2, 0.4, 0.6, 0.8, 0.75)]
    found = forecasts(
        [
            study(10_000 + 100 * place + number, ("missing", effect, told, 1.0))
            for place, (true, told) in enumerate(levels)
            for number in range(100)
            for effect in ["payload" if number < round(100 * true) else "tether"]
        ]
    )
    middle, low, high = calibration.slope(found, "confidence")
    assert middle == pytest.approx(expected)
    assert low < middle < high
    assert np.isnan(calibration.slope(found, "support")).all()


def test_the_shares_at_a_confidence_of_nine_tenths_are_those_of_right_and_of_stated_names():
    row = first_row(forecasts(calibrated()))
    assert row["right names at 0.9"].endswith("(90 of 200)")
    assert row["wrong names at 0.9"].endswith("(10 of 100)")


def test_kept_studies_are_decided_again_by_the_present_code(tmp_path, monkeypatch):
    path = tmp_path / "kept.parquet"
    found = [row for each in calibrated() for row in each]
    pl.DataFrame(found, schema=rows.SCHEMA).write_parquet(path)
    half = study(10_000, ("missing", "payload", 0.75, 1.0))
    monkeypatch.setattr(calibration.rescore, "rescored", lambda table, values: [score(half)] * (not values))
    assert calibration.read([path], decide=True)["confidence"].to_list() == [0.75]
    assert calibration.read([path]).height == 300


def test_equal_confidences_share_a_bin_of_at_least_a_hundred():
    found = forecasts(calibrated(130, ((0.3, 0.2), (0.5, 0.2), (1.0, 1.0))))
    rows = [row for row in calibration.reliability(found) if row["forecast"] == "as stated"]
    assert [(row["confidence"], row["names"]) for row in rows] == [
        ("0.300", 130),
        ("0.500", 130),
        ("1.000", 130),
    ]
    few = forecasts(calibrated(30))
    (bin_,) = (row for row in calibration.reliability(few) if row["forecast"] == "as stated")
    assert bin_["names"] == 90 < BIN
    assert "too few for a bin of 100" in calibration.summary(few)


def test_bins_hold_equal_counts_and_every_name_once():
    rng = np.random.default_rng(3)
    for count in (1, 99, 250, 730, 5000):
        confidence = rng.uniform(0.0, 1.0, count)
        parts = calibration.bins(confidence)
        assert sorted(np.concatenate(parts).tolist()) == list(range(count))
        assert len(parts) <= 10
        assert max(p.size for p in parts) - min(p.size for p in parts) <= 1
        assert len(parts) == 1 or min(p.size for p in parts) >= BIN
        tops = [confidence[part].max() for part in parts]
        assert tops == sorted(tops)


def test_equal_confidences_share_a_bin_and_those_below_have_one():
    """Most are certain: where enough are not, these are not hidden among them."""
    confidence = np.concatenate([np.full(290, 1.0), np.linspace(0.1, 0.9, 110)])
    doubtful, certain = calibration.bins(confidence)
    assert sorted(doubtful) == list(range(290, 400))
    assert sorted(certain) == list(range(290))
    assert len(calibration.bins(confidence[:-11])) == 1
    middle = np.concatenate([np.linspace(0.1, 0.4, 110), np.full(120, 0.5), np.linspace(0.6, 0.9, 110)])
    assert [part.size for part in calibration.bins(middle)] == [230, 110]


@pytest.mark.parametrize(("found", "called", "named", "right"), [
    ([("missing", "payload", 0.8, 1.0)], ("payload",), True, True),
    ([("suspect", "tether", 0.8, 1.0), ("missing", "payload", 0.9, 1.0)], ("payload",), True, False),
    ([("cannot_tell_apart", "payload", 0.6, 0.6)], ("payload",), True, True),
    ([("missing", "payload", 0.8, 1.0)], (), True, False),
    ([("none_of_the_known", "", None, None)], (), False, True),
    ([("none_of_the_known", "", None, None)], ("payload",), False, False),
    ([("nothing_missing", "", None, None)], (), False, True),
    ([("nothing_missing", "", None, None)], ("payload",), False, False),
])  # fmt: skip
def test_names_of_what_is_outside_the_catalogue_are_wrong_and_silence_is_counted_apart(
    found, called, named, right
):
    (one,) = forecasts([study(10_000, *found, called=called)]).to_dicts()
    assert (one["named"], one["right"]) == (named, right)
    assert one["confidence"] == (found[0][2] if named else None)


def test_silent_studies_make_no_forecast():
    rows = [*calibrated(), study(20_000, ("nothing_missing", "", None, None), called=())]
    rows.append(study(20_001, ("far_from_noise", "", None, None)))
    row, without = (first_row(forecasts(r)) for r in (rows, calibrated()))
    assert row["Brier score"] == without["Brier score"]
    assert row["studies"] == 302
    assert row["nothing named, rightly"].endswith("(1 of 2)")


def test_what_the_file_has_wrong_by_design_is_no_name():
    told = [("retune", "linear_damping", 1.0, 1.0), ("missing", "payload", 0.7, 0.9)]
    (one,) = forecasts([study(10_000, *told, misjudged=["linear_damping"])]).to_dicts()
    assert (one["confidence"], one["support"], one["right"]) == (0.7, 0.9, True)


def test_of_a_tie_the_confidence_is_that_of_the_best_effect():
    tie = {"members": ["payload", "tether"]}
    studies = [
        [row | tie for row in study(10_000 + number, ("cannot_tell_apart", best, 0.6, 0.6))]
        for number, best in enumerate(("payload", "tether"))
    ]
    assert forecasts(studies)["right"].to_list() == [True, False]


def test_a_first_name_without_a_confidence_is_left_out():
    found = forecasts([*calibrated(), study(20_000, ("retune", "payload", None, None))])
    assert first_row(found)["names"] == 300
    assert "1 state no confidence" in calibration.summary(found)


def test_seeds_of_development_and_failures_are_left_out():
    failed = study(30_000, failure="DataError: diverges")
    assert forecasts([*calibrated(), *calibrated(first=0), failed]).height == 300


def test_lists_are_pooled_and_told_apart_and_a_study_counts_once(tmp_path):
    names = ("clean-one", "logs", "panel-before")
    paths = [tmp_path / f"{name}.parquet" for name in names]
    for name, path in zip(names, paths, strict=True):
        found = [row for each in calibrated(list=name) for row in each]
        pl.DataFrame(found, schema=rows.SCHEMA).write_parquet(path)
    found = calibration.read([*paths, paths[0]])
    row = first_row(found)
    assert row["names"] == 900
    assert float(row["Brier score"]) == pytest.approx(np.mean([0.25, 0.24, 0.09]), abs=5e-5)
    lists = [row["names of"] for row in calibration.scores(found) if row["forecast"] == "as stated"]
    assert sorted(lists) == sorted([calibration.ALL, *names])
    assert calibration.held(found, "confidence") == [True, True, True]


def test_files_of_other_benchmarks_are_refused(tmp_path):
    pl.DataFrame({"rival": ["sindy"]}).write_parquet(tmp_path / "rivals.parquet")
    with pytest.raises(SystemExit, match=r"rivals\.parquet holds no results of"):
        calibration.read([tmp_path / "rivals.parquet"])


@pytest.mark.parametrize("name", ["diagram.png", "diagram.svg"])
def test_the_diagram_is_drawn(tmp_path, name):
    calibration.draw(forecasts(calibrated()), tmp_path / name)
    assert (tmp_path / name).stat().st_size > 5_000


def test_a_kept_table_has_its_origin_last_and_is_read_as_it_was_written(tmp_path):
    found = forecasts(calibrated())
    whence = kept_tables.origin(found, "python -m benchmarks.calibration write hidden.parquet", "abc1234")
    kept_tables.keep("calibration", [row | whence for row in calibration.scores(found)], tmp_path)
    read = pl.read_csv(tmp_path / "calibration.csv")
    assert read.columns[-5:] == ["commit", "recorded", "date", "command", "seeds"]
    assert read["seeds"].unique().to_list() == ["10000 to 10299"]
    assert read["forecast"].to_list() == list(calibration.FORECASTS)
