"""Ties and shares, left-out sessions against least squares that was never shown them, and doubts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.diagnosis import confidence
from hydro.core.diagnosis.by_likelihood import excess_share
from hydro.core.diagnosis.confidence import (
    folds,
    lead_confidence,
    left_out_costs,
    left_out_share,
    shared,
)
from hydro.core.diagnosis.doubts import discounted_by_largest, discounted_by_unexplained, stated
from hydro.core.diagnosis.findings import Finding
from hydro.core.errors import DataError
from hydro.core.prediction.normal_equations import Normal

SHOTS, ROWS = 60, 40
SESSION = np.repeat([0, 1, 2, 3], 15)
RESAMPLED = 120
rng = np.random.default_rng(0)


def drawn(seed: int = 0, columns: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Columns (S, ROWS, P) and white noise (S, ROWS)."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal((SHOTS, ROWS, columns)), rng.standard_normal((SHOTS, ROWS))


class Fitted(NamedTuple):
    """Linear problem about its least-squares fit, and the fitted amounts."""

    normal: Normal
    amounts: np.ndarray


def fitted(columns: np.ndarray, error: np.ndarray) -> Fitted:
    """A linear model at its least-squares fit, which began from nothing."""
    P = columns.shape[-1]
    amounts = np.linalg.lstsq(columns.reshape(-1, P), error.ravel())[0] if P else np.zeros(0)
    both = np.concatenate([columns, (error - columns @ amounts)[..., None]], axis=-1)
    gram = both.transpose(0, 2, 1) @ both
    return Fitted(Normal(gram, ROWS, gram[:, -1:, -1], np.zeros((SHOTS, 0, P + 1))), amounts)


def removed(first: Fitted, rival: Fitted) -> float:
    """Share of the error of held-out sessions that a rival removes."""
    return left_out_share(first.normal, rival.normal, rival.amounts, SESSION)


def test_left_out_costs_equal_refits_without_the_session():
    columns, noise = drawn()
    error = columns @ [0.5, -0.3, 0.0] + noise
    model = fitted(columns, error)
    found = left_out_costs(model.normal, SESSION, model.amounts)
    for number in range(4):
        out = number == SESSION
        known = np.linalg.lstsq(columns[~out].reshape(-1, 3), error[~out].ravel())[0]
        expected = ((error[out] - columns[out] @ known) ** 2).sum(axis=1)
        np.testing.assert_allclose(found[out], expected, rtol=1e-4)


def test_a_real_effect_explains_every_session():
    columns, noise = drawn()
    error = columns @ [1.5, 0.0, 0.0] + noise
    nothing = fitted(np.zeros((SHOTS, ROWS, 0)), error)
    assert 0.9 < removed(nothing, fitted(columns[..., :1], error)) <= 1.0
    assert removed(nothing, fitted(columns[..., 2:], error)) < 0.05


def test_many_parameters_gain_nothing_on_held_out_sessions():
    columns, noise = drawn(columns=80)
    error = 1.1 * noise
    many = fitted(columns, error)
    nothing = fitted(columns[..., :0], error)
    assert many.normal.cost < nothing.normal.cost
    assert removed(nothing, many) == 0.0


def test_an_effect_in_one_session_alone_explains_no_held_out_session():
    columns, noise = drawn(columns=1)
    columns[SESSION != 2] = 0.0
    error = columns @ [2.0] + noise
    assert removed(fitted(columns[..., :0], error), fitted(columns, error)) < 0.01


def test_a_recording_of_few_sessions_is_cut_into_stretches():
    np.testing.assert_array_equal(folds([4, 4, 7, 7, 9]), [0, 0, 1, 1, 2])
    stretches = folds(np.repeat([0, 1], 30))
    np.testing.assert_array_equal(np.bincount(stretches), [10] * 6)
    assert (np.diff(stretches) >= 0).all()
    np.testing.assert_array_equal(folds([0, 0]), [0, 1])
    with pytest.raises(DataError, match="record a longer session"):
        folds([0])


def test_diverged_shots_count_for_no_rival():
    columns, noise = drawn()
    model = fitted(columns, columns @ [0.5, 0.0, 0.0] + noise)
    model.normal.gram[7] = 0.0
    model.normal.gram[7, -1, -1] = np.inf
    costs = left_out_costs(model.normal, SESSION, model.amounts)
    assert np.isinf(costs[7])
    assert np.isfinite(np.delete(costs, 7)).all()
    nothing = fitted(columns[..., :0], columns @ [0.5, 0.0, 0.0] + noise)
    assert removed(nothing, model) > 0.9


@dataclass
class Rival:
    """Only what a selection reads of a model."""

    penalised: np.ndarray
    normal: Normal


def rival(costs: np.ndarray) -> Rival:
    gram = rng.standard_normal((RESAMPLED, 3, 3))
    return Rival(
        costs,
        Normal(gram @ gram.transpose(0, 2, 1), 100, np.ones((RESAMPLED, 1)), np.zeros((RESAMPLED, 0, 3))),
    )


def test_equal_rivals_are_selected_equally_often():
    costs = rng.chisquare(100, RESAMPLED)
    one, other = costs + rng.normal(0, 1, RESAMPLED), costs + rng.normal(0, 1, RESAMPLED)
    other += one.sum() / RESAMPLED - other.sum() / RESAMPLED
    found = confidence.selection_frequency({"a": rival(one), "b": rival(other)}, "a")
    assert set(found) == {"a", "b"}
    assert found["a"] == pytest.approx(0.5, abs=0.1)
    assert sum(found.values()) == pytest.approx(1.0)


def test_a_clear_winner_has_no_tied_rivals():
    costs = rng.chisquare(100, RESAMPLED)
    found = confidence.selection_frequency({"worse": rival(costs + 5.0), "best": rival(costs)}, "best")
    assert found == {"best": 1.0}


def test_changed_values_win_half_of_the_resamples_at_the_threshold():
    columns, noise = drawn(3)
    for truth, expected in ((0.0, 0.0), (1.0, 1.0)):
        model = fitted(columns, columns @ [0.5, -0.3, truth] + noise)
        assert confidence.change_frequency(model.normal, [2], model.amounts[[2]]) == pytest.approx(
            expected, abs=0.05
        )
    even = np.sqrt(np.log(SHOTS) / (columns[..., 2] ** 2).sum())  # of which the gain is just the penalty
    columns[..., 2] -= (
        columns[..., :2] @ np.linalg.lstsq(columns[..., :2].reshape(-1, 2), columns[..., 2].ravel())[0]
    )
    noise -= columns @ np.linalg.lstsq(columns.reshape(-1, 3), noise.ravel())[0]
    model = fitted(columns, columns @ [0.5, -0.3, even] + noise)
    assert confidence.change_frequency(model.normal, [2], model.amounts[[2]]) == pytest.approx(0.5, abs=0.15)


def test_other_parameters_are_refitted_if_an_effect_keeps_the_files_values(monkeypatch):
    columns, noise = drawn(4)
    columns[..., 1] += columns[..., 2]  # what one loses the other takes up
    error = columns @ [0.5, -0.3, 0.1] + noise
    model, seen = fitted(columns, error), []
    monkeypatch.setattr(confidence, "wins", lambda costs, _: seen.append(costs) or {"changed": 0.0})
    monkeypatch.setattr(confidence, "penalty", lambda *_: 0.0)
    confidence.change_frequency(model.normal, [2], model.amounts[[2]])
    without = fitted(columns[..., :2], error)
    np.testing.assert_allclose(seen[0]["unchanged"], without.normal.gram[:, -1, -1], rtol=1e-5)


def test_the_interval_of_a_share_has_its_nominal_coverage():
    covered = []
    for seed in range(150):
        draw = np.random.default_rng(seed)
        excess = draw.exponential(10.0, RESAMPLED)
        gain = excess * draw.uniform(0.1, 0.5, RESAMPLED)
        share, low, high = confidence.explained_share(gain, excess, 1)
        assert low <= share <= high
        covered.append(low <= 0.3 <= high)
    assert np.mean(covered) > 0.88


def test_a_share_is_clipped_to_0_and_1():
    assert confidence.explained_share(np.full(RESAMPLED, 3.0), np.full(RESAMPLED, 2.0), 4) == (1.0, 1.0, 1.0)
    assert confidence.explained_share(np.full(RESAMPLED, -1.0), np.full(RESAMPLED, 2.0), 4)[0] == 0.0


def test_a_share_equal_in_every_shot_has_an_interval_of_zero_width():
    excess = np.random.default_rng(0).exponential(10.0, RESAMPLED)
    assert confidence.explained_share(0.3 * excess, excess, 1) == pytest.approx((0.3, 0.3, 0.3))


@pytest.mark.parametrize(("rest", "sure"), [(0.6, 0.33), (0.3, 0.495), (0.1, 0.99)])
def test_a_large_unexplained_error_lowers_the_confidence_of_a_finding(rest, sure):
    named = Finding("missing", "added_mass", ("added_mass",), 0.3, confidence=0.99, advice="add it")
    found = discounted_by_unexplained(named, rest)
    assert found.confidence == pytest.approx(sure)
    assert ("record without feedback" in found.advice) == (rest >= 0.15)


def test_a_small_effect_needs_an_unexplained_error_that_is_smaller_still():
    """As in the log of a large ROV: propellers took 0.2 % of the error, and 1.9 times the noise was left."""
    noise = 1000.0
    first = SimpleNamespace(excess=492.0 * noise)
    model = SimpleNamespace(excess=0.9 * noise, normal=SimpleNamespace(residuals=noise))
    rest = excess_share(cast(Any, SimpleNamespace(refitted=first)), cast(Any, model))
    assert rest == pytest.approx(0.85 / 492.0)
    torque = Finding("missing", "propeller_torque", share=0.0022, confidence=1.0)
    thruster = replace(torque, effect="thruster_gain", share=0.017)
    assert stated(discounted_by_unexplained(torque, rest)).verdict == "suspect"
    assert discounted_by_unexplained(thruster, rest) == thruster
    model.excess = 0.04 * noise
    assert excess_share(cast(Any, SimpleNamespace(refitted=first)), cast(Any, model)) == 0.0


def test_overlapping_effects_split_their_common_share():
    lag = Finding("missing", "thruster_lag", share=0.05, low=0.04, high=0.06)
    delay = Finding("missing", "command_delay", share=0.07, low=0.06, high=0.08)
    first, second = shared([lag, delay], 0.96)
    assert first.share + second.share == pytest.approx(0.96)
    assert first.share / second.share == pytest.approx(5 / 7)
    assert "96% together" in first.advice
    assert "adds 5%" in first.advice


def test_effects_that_do_not_overlap_keep_their_shares():
    both = [Finding("missing", "payload", share=0.5), Finding("missing", "tether", share=0.45)]
    assert shared(both, 1.0) == both
    assert shared([], 0.0) == []


@pytest.mark.parametrize(
    ("verdict", "sure", "support", "told"),
    [
        ("missing", 0.89, 0.95, "suspect"),
        ("missing", 0.9, 0.95, "missing"),
        ("cannot_tell_apart", 0.6, 0.6, "cannot_tell_apart"),
        ("cannot_tell_apart", 0.5, 0.6, "suspect"),
    ],
)
def test_a_finding_of_low_confidence_becomes_a_suspect(verdict, sure, support, told):
    words = "add it with `hydro add`; a lift"
    found = stated(
        Finding(verdict, "body_lift", ("body_lift",), 0.5, confidence=sure, support=support, advice=words)
    )
    assert found.verdict == told
    assert ("--effect body_lift" in found.advice) == (told == "suspect")


def test_smaller_findings_lose_confidence_if_no_model_fits():
    first = Finding("missing", "payload", share=0.8, confidence=0.86)
    second = Finding("missing", "coupled_damping", share=0.2, confidence=0.86)
    assert discounted_by_largest([first, second], 1.5) == [first, second]
    assert discounted_by_largest([second, first], 5.0) == [replace(second, confidence=0.86 / 4), first]
    assert discounted_by_largest([], 5.0) == []


@pytest.mark.parametrize("seen", [0.0, 0.3, 1.0, 2.5])
def test_confidence_is_the_share_of_equal_leads_that_are_not_due_to_chance(seen):
    """Chance adds the difference of two exponential leads to the true difference of two candidates."""
    draw = np.random.default_rng(5)
    true = draw.uniform(-12.0, 12.0, 400_000)
    lead = true + draw.exponential(size=true.size) - draw.exponential(size=true.size)
    equal = np.abs(lead - seen) < 0.05
    assert lead_confidence(seen, np.inf, 1.0) == pytest.approx(np.mean(true[equal] > 0.0), abs=0.03)


LEADS = st.floats(-50.0, 50.0)


@given(LEADS, LEADS, st.floats(0.0, 10.0), st.floats(0.01, 5.0))
def test_confidence_grows_with_both_leads_and_two_candidates_share_one(over_next, over_none, more, by_chance):
    here = lead_confidence(over_next, over_none, by_chance)
    assert 0.0 <= here <= 1.0
    assert here <= lead_confidence(over_next + more, over_none, by_chance)
    assert here <= lead_confidence(over_next, over_none + more, by_chance)
    assert here <= lead_confidence(np.inf, over_none, by_chance)
    both = here + lead_confidence(-over_next, over_none, by_chance)
    assert both == pytest.approx(lead_confidence(np.inf, over_none, by_chance))


def test_without_a_lead_over_no_effect_nothing_is_believed():
    assert lead_confidence(5.0, 0.0, 1.0) == lead_confidence(5.0, -1.0, 1.0) == 0.0
    assert lead_confidence(0.0, np.inf, 1.0) == 0.5
