"""Blocks drawn anew: every recording is as long as the first, and means spread as theory says."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.evaluation.block_resampling import SAMPLES, block_sums, draws, interval, redrawn, weights

BLOCKS = 60
SUMS = np.column_stack([np.ones(BLOCKS), np.random.default_rng(3).normal(5.0, 2.0, BLOCKS)])


def means(kind: str) -> np.ndarray:
    """Means over blocks of what was drawn, one for each recording."""
    drawn = {
        "counted": lambda: draws(BLOCKS, 0) @ SUMS,
        "one by one": lambda: redrawn(SUMS, 0),
        "weighed": lambda: weights(BLOCKS, SAMPLES, 0) @ SUMS,
    }[kind]()
    return drawn[:, 1] / drawn[:, 0]


@pytest.mark.parametrize("kind", ["counted", "one by one", "weighed"])
def test_a_mean_spreads_by_its_standard_error(kind: str) -> None:
    """Rubin (1981): the weighed mean has the variance of the drawn one, times B / (B + 1)."""
    found, error = means(kind), SUMS[:, 1].std() / np.sqrt(BLOCKS)
    assert len(found) == SAMPLES
    assert found.mean() == pytest.approx(SUMS[:, 1].mean(), abs=4.0 * error / np.sqrt(SAMPLES))
    assert found.std() == pytest.approx(error, rel=0.1)
    low, high = interval(found)
    assert (high - low) == pytest.approx(2.0 * 1.96 * error, rel=0.15)


def test_every_recording_is_as_long_as_the_first() -> None:
    np.testing.assert_array_equal(draws(BLOCKS, 1).sum(axis=1), BLOCKS)
    np.testing.assert_array_equal(redrawn(SUMS, 1)[:, 0], BLOCKS)
    np.testing.assert_allclose(weights(BLOCKS, 7, 1).sum(axis=1), 1.0)
    assert not np.array_equal(draws(BLOCKS, 1), draws(BLOCKS, 2))


def test_the_last_block_takes_what_is_left() -> None:
    values = np.arange(14.0).reshape(7, 2)
    np.testing.assert_array_equal(block_sums(values, 3), [[6.0, 9.0], [24.0, 27.0], [12.0, 13.0]])
