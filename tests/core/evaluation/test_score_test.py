"""Gains against least squares by numpy; the level and the power of the test; standard errors."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.evaluation import score_test
from hydro.core.evaluation.score_test import Evidence, p_values
from hydro.core.prediction.normal_equations import Normal

SHOTS, ROWS = 60, 40


def problem(columns: np.ndarray, error: np.ndarray) -> Normal:
    """Pieces of ROWS rows each."""
    both = np.column_stack([columns, error]).reshape(SHOTS, ROWS, -1)
    return Normal(both.transpose(0, 2, 1) @ both, ROWS, error.reshape(SHOTS, ROWS), np.zeros((SHOTS, 0, 1)))


def drawn(seed: int, amounts: tuple[float, ...] = (0.0,) * 5) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((SHOTS * ROWS, 5)) * [1.0, 10.0, 0.1, 1.0, 3.0]
    columns[:, 3] += columns[:, 0]
    return columns, columns @ np.array(amounts) + rng.standard_normal(SHOTS * ROWS)


def test_a_gain_is_the_fall_of_the_squared_residual():
    columns, error = drawn(0, (0.1, 0.0, 0.0, 0.2, 0.0))
    evidence = Evidence.of(problem(columns, error))

    def left(chosen):
        return np.linalg.lstsq(columns[:, chosen], error)[1].item()

    assert evidence.gain([0, 1], [3, 4]) == pytest.approx(left([0, 1]) - left([0, 1, 3, 4]), rel=1e-5)
    expected = np.linalg.lstsq(columns[:, [0, 3]], error)[0]
    np.testing.assert_allclose(evidence.solve([0, 3]) / evidence.size[[0, 3]], expected, rtol=1e-6)


def test_standard_errors_are_those_of_least_squares():
    columns, error = drawn(1)
    found = np.sqrt(np.diag(Evidence.of(problem(columns, error)).covariance([0], [3, 4], 1.0)))
    chosen = columns[:, [0, 3, 4]]
    np.testing.assert_allclose(found, np.sqrt(np.diag(np.linalg.inv(chosen.T @ chosen)))[1:], rtol=1e-6)


def test_false_alarms_are_as_rare_as_promised():
    """The least p-value of three groups is below 0.1 in a tenth of recordings without effect."""
    groups = {"one": [[1]], "two": [[2, 3]], "three": [[4]]}
    least = []
    for seed in range(200):
        evidence = Evidence.of(problem(*drawn(seed)))
        least.append(min(p_values(evidence, [0], groups).values()))
    assert 0.04 < np.mean(np.array(least) <= 0.1) < 0.17


def test_a_plain_effect_is_as_sure_as_the_flips_allow_and_only_it():
    evidence = Evidence.of(problem(*drawn(3, (0.0, 0.02, 0.0, 0.0, 0.0))))
    found = p_values(evidence, [0], {"there": [[1]], "not": [[2, 4]]})
    assert found["there"] == pytest.approx(1.0 / 2000.0)
    assert found["not"] > 0.05


@pytest.mark.parametrize("blocks", [8, 12])
def test_few_blocks_make_no_false_alarms_of_wide_groups(blocks):
    """A group of five of eight blocks is tested in parts, one of five of twelve whole."""

    def p(seed, amounts=(0.0,) * 5):
        whole = Evidence.of(problem(*drawn(seed, amounts)))
        part = Evidence(whole.matrix[:blocks], whole.score[:blocks], whole.error[:blocks], whole.size)
        return p_values(part, [], {"wide": [[0, 1, 2, 3, 4]]})["wide"]

    assert 0.02 < np.mean([p(seed) <= 0.1 for seed in range(200)]) < 0.15
    assert p(4, (1.0, 1.0, 0.0, 0.0, 0.0)) < 0.01


def test_the_best_of_several_shapes_makes_no_more_false_alarms_than_one():
    """Four shapes that are hardly alike: tested alone, the best would alarm three times as often."""
    shaped, chosen = [], []
    for seed in range(200):
        evidence = Evidence.of(problem(*drawn(seed)))
        shapes = [[1], [2], [3], [4]]
        shaped.append(p_values(evidence, [0], {"shaped": shapes})["shaped"])
        best = max(shapes, key=lambda columns: evidence.gain([0], columns))
        chosen.append(p_values(evidence, [0], {"best": [best]})["best"])
    assert 0.04 < np.mean(np.array(shaped) <= 0.1) < 0.17
    assert np.mean(np.array(chosen) <= 0.1) > 0.25


def test_the_level_holds_for_wide_groups_and_shots_of_unequal_weight():
    """The least p-value of groups of one to nine columns, beside nine that are fitted, told by few shots."""
    rng, least = np.random.default_rng(5), []
    weight = np.repeat(np.exp(1.5 * rng.standard_normal((SHOTS, 3, 1))), 8, axis=1).reshape(SHOTS, 1, 24)
    groups = {"wide": [range(9, 18)], "narrow": [range(18, 21)], "one": [[21]], "another": [[22]]}
    for _ in range(80):
        columns = (rng.standard_normal((SHOTS, ROWS, 24)) * weight).reshape(SHOTS * ROWS, 24)
        evidence = Evidence.of(problem(columns, rng.standard_normal(SHOTS * ROWS)))
        least.append(min(p_values(evidence, range(9), groups).values()))
    assert 0.04 < np.mean(np.array(least) <= 0.1) < 0.17


def test_a_flip_is_standardised_by_the_covariance_that_white_noise_gives_it():
    """A flip's score is linear in the residual, m = L e: white noise gives it the covariance L L^T."""
    rng, blocks, rows = np.random.default_rng(2), 6, 5
    given, group = [0, 1], [2, 3]
    columns, error = rng.standard_normal((blocks * rows, 4)), rng.standard_normal(blocks * rows)
    both = np.column_stack([columns, error]).reshape(blocks, rows, -1)
    gram = both.transpose(0, 2, 1) @ both
    evidence = Evidence.of(Normal(gram, rows, gram[:, -1, -1:], np.zeros((blocks, 0, 5))))
    signs = np.vstack([np.ones(blocks), rng.choice([-1.0, 1.0], (7, blocks))])
    found = score_test._forms(evidence, given, group, np.arange(blocks), signs)

    known, tested = columns[:, given], columns[:, group]
    fitted = known @ np.linalg.solve(known.T @ known, known.T)
    left = np.eye(len(error)) - fitted
    for form, sign in zip(found, signs, strict=True):
        L = (left @ tested).T @ (np.repeat(sign, rows)[:, None] * left)
        m = L @ error
        assert form == pytest.approx(m @ np.linalg.solve(L @ L.T, m), rel=1e-6)
