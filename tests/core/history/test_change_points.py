"""Level shifts and trends in histories of estimates: found, dated and sized, and seldom found in noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro.core.history.change_points import LEVEL, alarms, inverse_trigamma, moderated, variances
from hydro.core.history.changes import Change, changes, levels
from hydro.core.history.parameters import Parameter
from hydro.core.history.sentences import headline, sentence

BASELINE, DIVES, ROWS = 4, 20, 8
GAIN = Parameter("thrust_3", "thrust", 2, "Thruster 3", "1", 1.0, 0.5)
LIFT = Parameter("net_buoyancy", "buoyancy", 0, "Net buoyancy", "N", 0.0, 10.0)
SWAY = Parameter("drag_sway", "drag", 1, "Sway drag", "1", 1.0, 0.5)


def history(seed: int, dives: int = DIVES) -> tuple[np.ndarray, np.ndarray]:
    """Unchanged parameters with an error of 1 to 2 %, and their standard errors."""
    rng = np.random.default_rng(seed)
    errors = rng.uniform(0.01, 0.02, (ROWS, dives))
    return 1.0 + errors * rng.normal(size=errors.shape), errors


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10_000),
    st.integers(0, ROWS - 1),
    st.integers(BASELINE, DIVES - 2),
    st.sampled_from([-1.0, 1.0]),
)
def test_a_shift_of_a_fifth_is_found_within_two_dives_and_dated(seed, row, date, sign) -> None:
    values, errors = history(seed)
    values[row, date:] += 0.2 * sign
    found = [one for one in changes(values, errors, BASELINE) if one.parameter == row]
    assert found
    assert found[0].found <= date + 1 + (date <= BASELINE + 1), "at the earliest dates the scatter is unknown"
    first = found[0]
    if first.kind == "shift":
        assert abs(first.date - date) <= 1
        assert first.size == pytest.approx(0.2 * sign, abs=4.0 * first.error + 0.01)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.floats(-1e3, 1e3), st.floats(1e-3, 1e3))
def test_alarms_do_not_depend_on_unit_or_origin(seed, origin, unit) -> None:
    values, errors = history(seed, 10)
    values[2, 6:] += 0.2
    assert alarms(origin * unit + unit * values, unit * errors, BASELINE) == alarms(values, errors, BASELINE)


@pytest.mark.parametrize("tails", ["white", "t(3)"])
def test_false_alarms_keep_the_level_over_thousands_of_dives(tails: str) -> None:
    rng, raised, tested = np.random.default_rng(5), 0, 0
    for _ in range(40):
        stated = rng.uniform(0.7, 1.4, (16, 30))
        size = rng.uniform(1.0, 3.0, (16, 1))  # stated errors are up to three times too small
        noise = rng.normal(size=stated.shape)
        if tails == "t(3)":
            noise = rng.standard_t(3, stated.shape) / np.sqrt(3.0)
        raised += len(alarms(size * stated * noise, stated, BASELINE))
        tested += 30 - BASELINE
    assert raised <= LEVEL * tested


def test_standard_errors_that_are_far_too_small_cause_no_alarm() -> None:
    values, errors = history(1)
    assert alarms(values, errors / 50.0, BASELINE) == []


def test_a_single_odd_dive_is_not_a_change() -> None:
    values, errors = history(2)
    values[0, 9] += 1.0
    values[1, -2] += 1.0
    assert [one for one in alarms(values, errors, BASELINE) if one.parameter in (0, 1)] == []


def test_missing_dives_are_skipped() -> None:
    values, errors = history(3)
    values[4, 12:] -= 0.2
    values[:, [6, 13]] = np.nan
    (found,) = changes(values, errors, BASELINE)
    assert (found.parameter, found.kind) == (4, "shift")
    assert found.date in (12, 13)


def test_a_slow_trend_is_one_change_and_no_shift() -> None:
    values, errors = history(4, 30)
    values[5] += 0.015 * np.maximum(np.arange(30) - 9.0, 0.0)
    (found,) = changes(values, errors, BASELINE)
    assert (found.parameter, found.kind) == (5, "trend")
    assert abs(found.date - 9) <= 3
    assert found.size == pytest.approx(0.3, abs=0.05)
    level = levels(values, errors, [found], 5)
    assert level[0] == level[found.date] < level[-1]


def test_two_shifts_of_one_parameter_are_two_changes() -> None:
    values, errors = history(6, 30)
    values[1, 10:] -= 0.3
    values[1, 20:] += 0.3
    first, second = changes(values, errors, BASELINE)
    assert (first.date, second.date) == (10, 20)
    assert second.after == pytest.approx(1.0, abs=0.02)
    found = changes(values[:, :15], errors[:, :15], BASELINE)
    assert [one.found for one in found] == [first.found], "later dives do not change when it was found"


def test_the_shrunk_factor_lies_between_its_own_and_the_common_one() -> None:
    squares, freedom = np.array([[2.0], [4.0], [8.0], [40.0]]), np.full((4, 1), 4.0)
    factor, degrees = moderated(squares, freedom, np.ones((4, 1), bool))
    own = squares / freedom
    assert np.all(degrees > freedom)
    assert own.min() < factor.min()
    assert factor.max() < own.max()
    assert inverse_trigamma(np.array([np.pi**2 / 6.0])) == pytest.approx([1.0])


def test_one_tiny_standard_error_does_not_outweigh_the_rest() -> None:
    errors = np.array([[1.0, 1.0, 1e-6, 1.0]])
    weight = 1.0 / variances(errors, np.ones((1, 4), bool))
    assert weight[0, 2] == pytest.approx(2.0 * weight[0, 0])


@pytest.mark.parametrize(
    ("change", "parameter", "told"),
    [
        (
            Change(0, "shift", 2, 3, 1.0, 0.71, 0.015),
            GAIN,
            "Thruster 3 fell from 100 % to 71 % (±3) between dive 2 and 3 (b and c).",
        ),
        (
            Change(0, "shift", 1, 3, 0.0, 4.7, 0.2),
            LIFT,
            "Net buoyancy rose by 4.7 N (±0.4) between dive 1 and 2 (a and b).",
        ),
        (
            Change(0, "trend", 1, 3, 1.0, 1.18, 0.025),
            SWAY,
            "Sway drag has grown by 18 % (±5) since dive 2 (b): fouling?",
        ),
        (
            Change(0, "shift", 1, 3, 1.0, 0.9, 0.025),
            SWAY,
            "Sway drag fell by 10 % (±5) between dive 1 and 2 (a and b).",
        ),
    ],
)
def test_a_change_in_words(change, parameter, told) -> None:
    assert sentence(change, parameter, ["a", "b", "c", "d"]) == told


def test_the_headline_says_when_there_is_nothing_to_compare() -> None:
    assert "no later dive" in headline([], 4, 4)
    assert headline([], 9, 4) == "No parameter has changed in 9 dives (baseline: the first 4)."
