"""Axes that a step predicts significantly worse."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.columns import VELOCITY
from hydro.core.diagnosis.settings import AXIS_LEVEL
from hydro.core.evaluation.velocity_errors import Squares
from hydro.core.explanation.axes import worse_axes

SHOTS, ROWS = 120, 250


def squares(rng: np.random.Generator, sizes: np.ndarray) -> Squares:
    """Sums of squared errors of normal predictions with these standard deviations, (6,)."""
    counts = np.full((SHOTS, 6), float(ROWS))
    return Squares(rng.chisquare(ROWS, (SHOTS, 6)) * sizes**2, counts)


def test_a_worse_axis_is_named_even_if_the_total_error_falls():
    rng = np.random.default_rng(1)
    before = squares(rng, np.full(6, 0.10))
    after = squares(rng, np.array([0.05, 0.05, 0.05, 0.12, 0.05, 0.05]))
    assert worse_axes(before, after) == (VELOCITY[3],)
    assert worse_axes(after, before) == tuple(v for v in VELOCITY if v != VELOCITY[3])


def test_a_significant_rise_below_the_limit_does_not_count():
    rng = np.random.default_rng(2)
    before = squares(rng, np.full(6, 0.1))
    after = Squares(before.sums * 1.01**2, before.counts)
    assert worse_axes(before, after) == ()


def test_equal_predictions_are_called_worse_at_the_nominal_level():
    wrong = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        sizes = np.full(6, 0.1) * np.exp(0.5 * rng.standard_normal((SHOTS, 1)))
        before, after = squares(rng, sizes), squares(rng, sizes)
        wrong += bool(worse_axes(before, after))
    assert wrong <= 300 * AXIS_LEVEL


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_stretches_name_no_axis(count):
    one = Squares(np.ones((count, 6)), np.ones((count, 6)))
    assert worse_axes(one, one) == ()


def test_an_axis_without_samples_is_left_out():
    rng = np.random.default_rng(3)
    before, after = squares(rng, np.full(6, 0.1)), squares(rng, np.full(6, 0.2))
    counts = before.counts.copy()
    counts[:, 4] = 0.0
    found = worse_axes(Squares(before.sums, counts), Squares(after.sums, counts))
    assert found == ("u", "v", "w", "p", "r")
