"""Errors of predictions: rotation vectors within bounds, and the last samples of each prediction."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.evaluation.replay_error import (
    BEYOND,
    SETTLED,
    _batches,
    _bounded,
    _settle,
    last_samples,
    root_mean_square,
)

AXIS = np.array([0.6, 0.0, -0.8])


@pytest.mark.parametrize("angle", [0.0, 1e-12, 0.1, 1.0, 3.0, np.pi])
def test_twice_a_quaternions_vector_part_becomes_the_rotation_vector(angle):
    error = np.full((1, 12), 0.25)
    error[0, 3:6] = 2.0 * np.sin(0.5 * angle) * AXIS
    found = _bounded(error.copy())[0]
    np.testing.assert_allclose(found[3:6], angle * AXIS, rtol=1e-7, atol=1e-15)
    np.testing.assert_array_equal(found[[0, 1, 2, 6, 7, 8, 9, 10, 11]], 0.25)


def test_errors_of_a_prediction_that_diverges_are_bounded():
    error = np.zeros((3, 12))
    error[0] = np.nan
    error[1], error[2] = np.inf, -1e9
    error[2, 3:6] = 0.0
    found = _bounded(error)
    np.testing.assert_array_equal(found[0], BEYOND)
    np.testing.assert_array_equal(found[1], BEYOND)
    np.testing.assert_array_equal(found[2], np.where(np.isin(np.arange(12), (3, 4, 5)), 0.0, -BEYOND))


def test_the_last_sample_of_each_channel_ends_a_prediction():
    errors = np.arange(12.0).reshape(2, 3, 2)
    np.testing.assert_array_equal(last_samples(errors, None), errors[:, -1])
    seen = np.array([[[1, 0], [0, 1], [0, 0]], [[1, 0], [1, 0], [1, 0]]], bool)
    np.testing.assert_array_equal(last_samples(errors, seen), [[0.0, 3.0], [10.0, np.nan]])


def test_the_root_mean_square_leaves_out_what_has_no_sample():
    errors = np.array([[3.0, np.nan, np.nan], [4.0, -2.0, np.nan]])
    np.testing.assert_allclose(root_mean_square(errors), [np.sqrt(12.5), 2.0, np.nan])


def test_batches_hold_each_prediction_once_and_one_length_each():
    lengths = np.repeat([5, 7, 5], [130, 64, 1])
    batches = _batches(lengths)
    np.testing.assert_array_equal(np.concatenate(batches), np.arange(195))
    assert [len(batch) for batch in batches] == [64, 64, 2, 64, 1]
    assert all(len(set(lengths[batch])) == 1 for batch in batches)


def test_draws_settle_by_the_standard_error_of_their_sum():
    """Two draws d either side of the mean: the error of the mean is d; four predictions add their squares."""
    mean, known, count = 2.0, np.array([0.5]), 4
    bound = SETTLED * (mean * count + known[0]) / np.sqrt(count)
    for share, settled in ((0.99, True), (1.01, False)):
        sums = mean + share * bound * np.array([-1.0, 1.0]).reshape(1, 2, 1).repeat(count, axis=0)
        typical, open_ = np.zeros((count, 1)), np.ones(count, bool)
        still = _settle(sums, known, open_, typical)
        assert still.all() != settled
        np.testing.assert_allclose(typical, mean)


def test_the_median_counts_where_draws_do_not_settle_and_closed_predictions_stay():
    sums = np.array([[[1.0], [2.0], [600.0]], [[7.0], [8.0], [9.0]]])
    typical, open_ = np.array([[0.0], [5.0]]), np.array([True, False])
    still = _settle(sums, np.zeros(1), open_, typical)
    np.testing.assert_array_equal(typical, [[2.0], [5.0]])
    np.testing.assert_array_equal(still, [True, False])
