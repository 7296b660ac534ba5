"""Calibration of stated confidence, on tables whose calibration is known in closed form."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from benchmarks import calibration, kept_tables
from benchmarks.hidden_effects import study as hidden
from benchmarks.imperfect_base import study as base
from benchmarks.imperfect_base.scoring import BIN
from benchmarks.imperfect_base.work import Results
from benchmarks.imperfect_logs import study as logs
from hydro.core.diagnosis.confidence import by_likelihood_confidence
from hydro.core.diagnosis.findings import Diagnosis, Finding

ANSWER = {"preset": "auv151", "noise": 1.0, "seconds": 160.0, "failure": "", "title": "", "misjudged": []}


def study(seed, *found, called=("payload",), schema=hidden.SCHEMA, **other):
    """A row; `found` lists (verdict, effect, confidence, support)."""
    verdicts, effects, confidences, supports = zip(*found, strict=True) if found else ((), (), (), ())
    row = ANSWER | {"kind": "one", "seed": seed, "source": "independent", "called": list(called)}
    row |= {
        "verdicts": list(verdicts),
        "effects": list(effects),
        "members": [[e] if e else [] for e in effects],
    }
    row |= {"confidences": list(confidences), "supports": list(supports)} | other
    return dict.fromkeys(schema) | {name: value for name, value in row.items() if name in schema}


def table(rows, schema=hidden.SCHEMA):
    return pl.DataFrame(rows, schema=schema)


def calibrated(count=100, levels=((0.5, 1.0), (0.6, 1.0), (0.9, 1.0)), first=10_000, **other):
    """Studies of which exactly the stated share is named right, at each of a few levels."""
    rows, seed = [], first
    for stated, support in levels:
        for number in range(count):
            effect = "payload" if number < round(stated * count) else "tether"
            rows.append(study(seed, ("missing", effect, stated, support), **other))
            seed += 1
    return rows


def first_row(those, forecast="as stated", suite=calibration.ALL):
    return next(
        row for row in calibration.scores(those) if (row["names of"], row["forecast"]) == (suite, forecast)
    )


def test_a_calibrated_forecaster_has_the_brier_score_of_its_variance():
    """E (c - right)^2 = c (1 - c) where a share c of the names stated at c is right."""
    found = calibration.forecasts(table(calibrated()))
    row = first_row(found)
    expected = np.mean([0.5 * 0.5, 0.6 * 0.4, 0.9 * 0.1])
    assert float(row["Brier score"]) == pytest.approx(expected, abs=5e-5)
    share = (50 + 60 + 90) / 300
    assert float(row["of the base rate"]) == pytest.approx(share * (1.0 - share), abs=5e-5)
    assert calibration.held(found, "confidence") == [True, True, True]


def test_before_calibration_is_scored_by_what_the_confidence_was_made_from():
    """At a support of 1 the squared error is the share of wrong names."""
    row = first_row(calibration.forecasts(table(calibrated())), "before calibration")
    assert float(row["Brier score"]) == pytest.approx(1.0 - 200 / 300, abs=5e-5)
    assert calibration.held(calibration.forecasts(table(calibrated())), "support") == [False]


def test_equal_confidences_share_a_bin_of_at_least_a_hundred():
    found = calibration.forecasts(table(calibrated(130, ((0.3, 0.2), (0.5, 0.2), (1.0, 1.0)))))
    rows = [row for row in calibration.reliability(found) if row["forecast"] == "as stated"]
    assert [(row["confidence"], row["names"]) for row in rows] == [
        ("0.300", 130),
        ("0.500", 130),
        ("1.000", 130),
    ]
    few = calibration.forecasts(table(calibrated(30)))
    (bin_,) = (row for row in calibration.reliability(few) if row["forecast"] == "as stated")
    assert bin_["names"] == 90 < BIN
    assert "too few for a bin of 100" in calibration.summary(few)


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
    (one,) = calibration.forecasts(table([study(10_000, *found, called=called)])).to_dicts()
    assert (one["named"], one["right"]) == (named, right)
    assert one["confidence"] == (found[0][2] if named else None)


def test_silent_studies_make_no_forecast():
    rows = [*calibrated(), study(20_000, ("nothing_missing", "", None, None), called=())]
    rows.append(study(20_001, ("far_from_noise", "", None, None)))
    row, without = (first_row(calibration.forecasts(table(r))) for r in (rows, calibrated()))
    assert row["Brier score"] == without["Brier score"]
    assert row["studies"] == 302
    assert row["nothing named, rightly"].endswith("(1 of 2)")


def test_what_the_file_has_wrong_by_design_is_no_name():
    told = [("retune", "linear_damping", 1.0, 1.0), ("missing", "payload", 0.7, 0.9)]
    (one,) = calibration.forecasts(table([study(10_000, *told, misjudged=["linear_damping"])])).to_dicts()
    assert (one["confidence"], one["support"], one["right"]) == (0.7, 0.9, True)


def test_seeds_of_development_failures_and_repetitions_are_left_out():
    rows = [*calibrated(), *calibrated(first=0), *calibrated()[:50], study(30_000, failure="Diverges")]
    assert calibration.forecasts(table(rows)).height == 300
    (early, late) = (study(seed, schema=base.SCHEMA, with_before=True) for seed in (69_999, 70_000))
    assert calibration.forecasts(table([early, late], base.SCHEMA))["seed"].to_list() == [70_000]


def test_suites_are_pooled_and_told_apart(tmp_path):
    """Older files, without supports, are read beside new ones; before calibration they count for nothing."""
    files = []
    for name, schema, other in (
        ("hidden", hidden.SCHEMA, {}),
        ("logs", logs.SCHEMA, {"condition": "clean"}),
        ("plain", base.SCHEMA, {"with_before": False}),
        ("before", base.SCHEMA, {"with_before": True}),
    ):
        rows = calibrated(first=70_000, schema=schema, **other)
        frame = table(rows, schema)
        files.append(tmp_path / f"{name}.parquet")
        (frame.drop("supports") if name == "logs" else frame).write_parquet(files[-1])
    found = calibration.read(files)
    row = first_row(found)
    assert row["names"] == 1200
    assert float(row["Brier score"]) == pytest.approx(np.mean([0.25, 0.24, 0.09]), abs=5e-5)
    suites = [row["names of"] for row in calibration.scores(found) if row["forecast"] == "as stated"]
    assert suites == [
        calibration.ALL,
        "hidden_effects",
        "imperfect_logs",
        "imperfect_base",
        "imperfect_base --before",
    ]
    assert first_row(found, "before calibration")["names"] == 900
    assert calibration.held(found, "confidence") == [True, True, True]


def test_files_of_other_benchmarks_are_refused(tmp_path):
    pl.DataFrame({"rival": ["sindy"]}).write_parquet(tmp_path / "rivals.parquet")
    with pytest.raises(SystemExit, match=r"rivals\.parquet holds no studies of diagnoses; give results of"):
        calibration.read([tmp_path / "rivals.parquet"])


@pytest.mark.parametrize("name", ["diagram.png", "diagram.svg"])
def test_the_diagram_is_drawn(tmp_path, name):
    calibration.draw(calibration.forecasts(table(calibrated())), tmp_path / name)
    assert (tmp_path / name).stat().st_size > 5_000


def test_a_kept_table_has_its_origin_last_and_is_read_as_it_was_written(tmp_path):
    found = calibration.forecasts(table(calibrated()))
    whence = kept_tables.origin(found, "python -m benchmarks.calibration write hidden.parquet", "abc1234")
    kept_tables.keep("calibration", [row | whence for row in calibration.scores(found)], tmp_path)
    read = pl.read_csv(tmp_path / "calibration.csv")
    assert read.columns[-5:] == ["commit", "recorded", "date", "command", "seeds"]
    assert read["seeds"].unique().to_list() == ["10000 to 10299"]
    assert read["forecast"].to_list() == list(calibration.FORECASTS)


def test_a_results_file_of_before_there_were_supports_is_gone_on_with(tmp_path):
    path = tmp_path / "hidden.parquet"
    table([study(10_000, ("missing", "payload", 0.9, 1.0))]).drop("supports").write_parquet(path)
    Results(path, hidden.SCHEMA).add(study(10_001, ("missing", "payload", 0.9, 0.95)))
    found = pl.read_parquet(path)
    assert found.schema == pl.Schema(hidden.SCHEMA)
    assert found["supports"].to_list() == [None, [0.95]]


@pytest.mark.parametrize(("left", "stated"), [(1.1, 0.9), (1.6, 0.9 * 102 / 118), (4.0, 0.9 * 102 / 118)])
def test_a_finding_keeps_what_its_confidence_was_made_from(left, stated):
    """Where more than noise is left, a name is less sure than the share of resamples that it wins."""
    finding = Finding("missing", "payload", confidence=by_likelihood_confidence(0.9, left), support=0.9)
    row = hidden.answer(Diagnosis((finding, Finding("nothing_missing")), None, (9.0, 9.0, left)))
    assert row["confidences"] == [pytest.approx(stated), None]
    assert row["supports"] == [0.9, None]
