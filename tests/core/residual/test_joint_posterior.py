"""Joint posterior of changes against closed forms of numpy, and the coverage of its standard errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from hydro.core.identification.levenberg_marquardt import Prior
from hydro.core.prediction.normal_equations import Normal
from hydro.core.residual.joint_posterior import Posterior, joint_posterior, nearly_held, widening

SHOTS, ROWS, STRETCHES = 24, 30, 4
FOLD = np.arange(SHOTS) * STRETCHES // SHOTS
ENDLESS = (np.full(3, -np.inf), np.full(3, np.inf))
FREE = np.zeros(3, bool)


def linear(columns, error):
    """Return the problem of columns (S, R, P) and errors (S, R)."""
    flat = np.concatenate([columns, error[..., None]], axis=-1)
    gram = np.einsum("sri,srj->sij", flat, flat)
    count = columns.shape[-1] + 1
    return Normal(gram, ROWS, np.zeros((SHOTS, 12)), np.zeros((SHOTS, 0, count)))


@pytest.fixture(scope="module")
def columns():
    return np.random.default_rng(1).normal(size=(SHOTS, ROWS, 3))


def test_mean_and_standard_errors_equal_those_of_numpy(columns):
    rng = np.random.default_rng(2)
    error, here = rng.normal(size=(SHOTS, ROWS)), np.array([0.2, -0.1, 0.4])
    prior, draws = Prior(np.array([0.0, 0.5, 0.0]), np.array([40.0, 90.0, 10.0])), rng.normal(size=(5, 3))
    found = joint_posterior(linear(columns, error), here, prior, ENDLESS, FOLD, draws, FREE)
    x, e, root = columns.reshape(-1, 3), error.ravel(), np.diag(np.sqrt(prior.information))
    rows, target = np.vstack([x, root]), np.concatenate([e + x @ here, root @ prior.centre])
    mean = np.linalg.lstsq(rows, target, rcond=None)[0]
    assert found.mean == pytest.approx(mean)
    left = error - columns @ (mean - here)
    inverse = np.linalg.inv(rows.T @ rows)
    scores = np.einsum("sri,sr->si", columns, left).reshape(STRETCHES, -1, 3).sum(axis=1)
    pulled = scores @ inverse
    first, second = (draws**2).mean(axis=0), 4 / 3 * (pulled**2).sum(axis=0)
    freedom = (first + second) ** 2 / (first**2 / 5 + second**2 / 3)
    factor = stats.t.ppf(stats.norm.cdf(2.0), freedom) / 2.0
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(np.sqrt(first + second) * factor)


def test_values_stay_within_their_bounds(columns):
    error = columns @ np.array([2.0, -3.0, 0.5])
    bounds = (np.array([-1.0, -1.0, -1.0]), np.array([1.0, 5.0, 5.0]))
    prior = Prior(np.zeros(3), np.full(3, 0.25))
    found = joint_posterior(linear(columns, error), np.zeros(3), prior, bounds, FOLD, np.zeros((2, 3)), FREE)
    assert found.mean[:2] == pytest.approx([1.0, -1.0])


def test_shots_that_diverge_are_left_out(columns):
    normal = linear(columns, columns @ np.array([1.0, 2.0, 3.0]))
    normal.gram[5] = 0.0
    normal.gram[5, -1, -1] = np.inf
    prior = Prior(np.zeros(3), np.full(3, 1e-9))
    found = joint_posterior(normal, np.zeros(3), prior, ENDLESS, FOLD, np.zeros((2, 3)), FREE)
    assert found.mean == pytest.approx([1.0, 2.0, 3.0])


def test_held_entries_without_a_visible_change_condition_the_others():
    """Conditional normal distribution (Bishop 2006, eq. 2.81 and 2.82)."""
    spread = np.array([[4.0, 1.5], [1.5, 1.0]])
    found = nearly_held(Posterior(np.array([3.0, 0.4]), spread), np.zeros(2), np.array([False, True]))
    assert found.mean == pytest.approx([3.0 - 1.5 * 0.4, 0.0])
    assert found.covariance == pytest.approx(np.array([[4.0 - 1.5**2, 0.0], [0.0, 0.0]]))


def test_held_entries_with_a_clear_change_hardly_affect_the_others():
    spread = np.array([[4.0, 1.5], [1.5, 1.0]]) * 1e-4
    found = nearly_held(Posterior(np.array([3.0, 1.4]), spread), np.zeros(2), np.array([False, True]))
    assert found.mean == pytest.approx([3.0, 1.4], abs=0.01)
    assert found.covariance == pytest.approx(spread, rel=0.01)


def test_factor_is_that_of_students_distribution_and_vanishes_for_many_stretches():
    one = widening(np.array([[1.0], [0.0]]), np.array([[3.0], [3.0]]))
    assert one == pytest.approx(stats.t.ppf(stats.norm.cdf(2.0), 3.0) / 2.0)
    assert widening(np.array([[1.0], [2.0]]), np.full((2, 1), 1e6)) == pytest.approx(1.0, abs=1e-4)
    assert widening(np.zeros((2, 1)), np.full((2, 1), 3.0)) >= 1.0


def shifted(columns, rng, true):
    """Return one recording whose hull and noise pull every stretch in its own way, and draws of the hull."""
    hull = 0.3 * rng.normal(size=3)
    pull = (0.5 * rng.normal(size=(STRETCHES, 3)))[FOLD]
    error = columns @ (true + hull) + np.einsum("srp,sp->sr", columns, pull)
    return error + rng.normal(size=error.shape), 0.3 * rng.normal(size=(STRETCHES, 3))


def test_two_standard_errors_hold_95_percent_of_the_values_from_few_stretches(columns):
    """Without the factor for few stretches, and with noise taken as white, they hold less."""
    rng, true = np.random.default_rng(3), np.array([1.0, -0.5, 0.2])
    prior = Prior(np.zeros(3), np.full(3, 0.25))
    away, plain, white = [], [], []
    for _ in range(400):
        error, draws = shifted(columns, rng, true)
        normal = linear(columns, error)
        found = joint_posterior(normal, np.zeros(3), prior, ENDLESS, FOLD, draws, FREE)
        many = joint_posterior(normal, np.zeros(3), prior, ENDLESS, np.arange(SHOTS), np.zeros((99, 3)), FREE)
        off, errors = np.abs(found.mean - true), np.sqrt(np.diag(found.covariance))
        away.append(off <= 2.0 * errors)
        white.append(off <= 2.0 * np.sqrt(np.diag(np.linalg.inv(normal.matrix.sum(axis=0)))))
        plain.append(off <= 2.0 * np.sqrt(np.diag(many.covariance)))
    assert 0.93 <= np.mean(away) <= 0.98
    assert np.mean(plain) < 0.8
    assert np.mean(white) < 0.4


def test_a_held_entry_that_has_changed_does_not_bias_the_others(columns):
    """A second column resembles the first: held at 0, its change of 0.6 would move the first by 0.54."""
    rng, both = np.random.default_rng(4), columns.copy()
    both[..., 1] = 0.9 * both[..., 0] + 0.3 * both[..., 1]
    error = both @ np.array([1.0, 0.6, 0.0]) + rng.normal(size=both.shape[:2])
    normal, prior = linear(both, error), Prior(np.zeros(3), np.full(3, 0.25))
    held, draws = np.array([False, True, False]), np.full((STRETCHES, 3), 0.02)
    found = joint_posterior(normal, np.zeros(3), prior, ENDLESS, FOLD, draws, held)
    alone = joint_posterior(
        normal.of([0, 2]), np.zeros(2), Prior(np.zeros(2), np.full(2, 0.25)),
        (ENDLESS[0][:2], ENDLESS[1][:2]), FOLD, draws[:, :2], np.zeros(2, bool),
    )  # fmt: skip
    assert abs(found.mean[0] - 1.0) <= 2.0 * np.sqrt(found.covariance[0, 0])
    assert abs(alone.mean[0] - 1.0) > 4.0 * np.sqrt(alone.covariance[0, 0])
