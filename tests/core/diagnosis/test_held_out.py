"""Errors of predictions before and after findings are added, on recordings whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import damped, moved, noisy

from hydro.core.diagnosis.findings import Diagnosis, Finding, Prediction
from hydro.core.diagnosis.held_out import HeldOut, predicted, with_first
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.settings import NEGLIGIBLE
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.evaluation.velocity_errors import Squares

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


def suspected(finding: Finding, confidence: float) -> Finding:
    return replace(finding, verdict="suspect", confidence=confidence)


def test_a_suspect_that_alone_explains_almost_all_comes_first(heavy):
    """A current does not make the vehicle sink, whatever its confidence."""
    first, second = checked(heavy, suspected(CURRENT, 0.8), suspected(FOUND, 0.6)).findings
    assert (first.effect, first.confidence) == ("net_buoyancy", 0.6)
    assert (second.effect, second.confidence) == ("ocean_current", 0.6)


def test_findings_that_explain_the_error_together_keep_their_order():
    """Each alone leaves more than a tenth of the error, so neither is an alternative to the other."""
    current = {"name": "ocean_current", "v_N": 0.12, "v_E": 0.0, "v_D": 0.0}
    raw = noisy(moved(damped(HEAVY, current), rows=4000), 3)
    told = [suspected(CURRENT, 0.7), suspected(FOUND, 0.8)]
    found = checked(raw, *told).findings
    given = checked(raw, *told).prediction.given
    assert all(one.error_added < 0.99 * given for one in found), "each alone helps"
    assert [one.effect for one in found] == ["ocean_current", "net_buoyancy"]
    assert [one.confidence for one in found] == [0.7, 0.8]


def test_beside_a_confirmed_finding_suspects_keep_their_order(heavy):
    """A suspect that imitates the confirmed effect explains almost all alone, and nothing beside it."""
    payload = {"w": 7.0, "x": 0.0, "y": 0.0, "z": 0.0, "mass": 0.0}
    load = Finding("suspect", "payload", ("payload",), parameters=payload, confidence=0.2)
    found = checked(heavy, replace(FOUND, confidence=0.95), suspected(CURRENT, 0.8), load).findings
    assert [one.effect for one in found] == ["net_buoyancy", "ocean_current", "payload"]
    assert [one.confidence for one in found] == [0.95, 0.8, 0.2]


def test_effects_are_behind_only_by_more_than_the_errors_allow(heavy):
    """Of two that predict alike neither is behind, nor is one whose difference is scatter."""
    check = HeldOut.of(damped(), preprocess(damped(), heavy))
    assert check is not None
    buoyancy, current = FOUND.table, CURRENT.table
    right = check.squares([buoyancy])
    wrong = check.squares([current])
    assert check.behind([(buoyancy, right), (buoyancy, right)]) == [False, False]
    assert check.behind([(current, wrong), (buoyancy, right)]) == [True, False]
    assert check.behind([(current, wrong), (buoyancy, right)], [True, False]) == [False, False]
    assert check.behind([(current, wrong), (buoyancy, right)], [False, False]) == [True, False]
    assert check.behind([]) == []
    assert check.removed(buoyancy, right) == pytest.approx(1.0, abs=0.1)
    more = check.removed(buoyancy, right) - check.removed(current, right)
    assert more == pytest.approx(2.0 * NEGLIGIBLE), "a current has two components more"
    noisier = right.sums * np.random.default_rng(0).uniform(0.5, 1.6, (len(right.sums), 1))
    assert check.behind([(buoyancy, Squares(noisier, right.counts)), (buoyancy, right)]) == [False, False]
    assert (check.explains([(current, wrong), (buoyancy, right)]), check.explains([(current, wrong)])) == (
        1,
        None,
    )


def test_an_effect_with_one_diverging_prediction_is_behind(heavy):
    """The scatter of the difference is then as large as the difference."""
    check = HeldOut.of(damped(), preprocess(damped(), heavy))
    assert check is not None
    right = check.squares([FOUND.table])
    sums = right.sums.copy()
    sums[0] = 1e4 * right.counts[0]
    assert check.behind([(FOUND.table, Squares(sums, right.counts)), (FOUND.table, right)]) == [True, False]


@given(st.data())
def test_with_one_finding_first_all_others_keep_their_order(data):
    count = data.draw(st.integers(1, 8))
    sure = st.floats(0.0, 1.0) | st.just(float("nan"))
    findings = [Finding("suspect", f"effect {i}", confidence=data.draw(sure)) for i in range(count)]
    places = sorted(data.draw(st.sets(st.integers(0, count - 1), min_size=1)))
    first = data.draw(st.sampled_from(places))
    found = with_first(findings, places, first)
    assert all(found[i] is findings[i] for i in range(count) if i not in places)
    order = [found[i].effect for i in places]
    assert order == [findings[i].effect for i in (first, *(i for i in places if i != first))]
    most = findings[first].confidence
    for one in (found[i] for i in places):
        before = findings[int(one.effect.split()[1])].confidence
        assert one.confidence == min(before, most) or np.isnan(before) or np.isnan(most)
        assert not one.confidence > most
        assert np.isnan(one.confidence) == np.isnan(before)
