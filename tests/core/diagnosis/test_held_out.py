"""Errors of predictions before and after findings are added, on recordings whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import polars as pl
import pytest
from recordings import damped, moved, noisy

from hydro.core.diagnosis.findings import Diagnosis, Finding, Prediction
from hydro.core.diagnosis.held_out import predicted
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.evaluation.replay_error import Ahead

HEAVY = {"name": "net_buoyancy", "dB": -8.0}
FOUND = Finding("missing", "net_buoyancy", ("net_buoyancy",), parameters={"dB": -7.0})
CURRENT = Finding(
    "missing", "ocean_current", ("ocean_current",), parameters={"v_N": 0.2, "v_E": 0.0, "v_D": 0.0}
)


@pytest.fixture(scope="module")
def heavy():
    """80 s of a vehicle that is heavier than its file."""
    return noisy(moved(damped(HEAVY), rows=4000), 1)


def checked(raw, *findings):
    """Errors before and after some findings."""
    log = preprocess(damped(), raw)
    return predicted(Diagnosis(findings, damped(), (1.0, 1.0, 1.0)), damped(), log)


def test_the_right_effect_lowers_the_held_out_error_to_the_noise(heavy):
    found = checked(heavy, FOUND, replace(CURRENT, verdict="suspect"))
    known = found.prediction
    assert known.falls
    assert known.given == pytest.approx(Ahead(heavy, damped()).of(damped()), rel=0.05)
    assert known.floor == pytest.approx(Ahead(heavy, damped()).floor, rel=0.05)
    assert known.added == pytest.approx(known.floor, rel=0.3)
    assert known.given > 2.0 * known.floor
    first, second = found.findings
    assert first.error_added == known.added
    assert second.error_added > 1.5 * first.error_added


def test_the_noise_floor_does_not_depend_on_the_sampling_rate(heavy):
    """A DVL of every fourth row leaves the same noise in each of its samples."""
    rare = (pl.int_range(pl.len()) % 4) == 0
    sparse = heavy.with_columns(pl.when(rare).then(pl.col(name)).alias(name) for name in ("u", "v", "w"))
    full, few = (checked(raw, FOUND).prediction for raw in (heavy, sparse))
    assert few.floor == pytest.approx(full.floor, rel=0.2)
    assert few.added == pytest.approx(few.floor, rel=0.3)


def test_a_wrong_effect_does_not_lower_the_error_of_a_right_file():
    known = checked(noisy(moved(damped(), rows=4000), 2), CURRENT).prediction
    assert not known.falls
    assert known.added == pytest.approx(known.given, rel=0.2)


def test_without_stated_findings_both_errors_are_equal(heavy):
    known = checked(heavy, replace(FOUND, verdict="suspect")).prediction
    assert (known.added, known.spread, known.falls) == (known.given, 0.0, False)


def test_unsure_new_values_do_not_count_as_added(heavy):
    """Values that were fitted together with an unconfirmed effect are wrong without it."""
    damping = {"diagonal": [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]}
    for sure, added in ((0.86, False), (0.95, True)):
        unsure = Finding("retune", "linear_damping", parameters=damping, confidence=sure)
        found = checked(heavy, replace(FOUND, verdict="suspect"), unsure)
        assert found.findings[1].error_added > 0.0
        assert (found.prediction.added != found.prediction.given) == added


def test_sessions_shorter_than_the_horizon_have_no_prediction(heavy):
    assert checked(heavy.head(1400)).prediction is None


def test_a_fall_within_the_standard_error_does_not_count():
    assert Prediction(5.0, 0.3, 0.2, 0.05, 0.01).falls
    assert not Prediction(5.0, 0.3, 0.27, 0.05, 0.01).falls
    assert not Prediction(5.0, 0.3, 0.4, 0.05, 0.01).falls


def test_added_waves_do_not_change_the_prediction(heavy):
    """They act by chance: hydro add adds them without a check."""
    waves = {"height": 0.2, "period": 4.0, "direction": 0.0, "peak": 2.3}
    known = checked(heavy, Finding("missing", "ocean_waves", ("ocean_waves",), parameters=waves)).prediction
    assert known.added == known.given
