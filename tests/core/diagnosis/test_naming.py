"""Ties and shares: equal rivals are told together, a clear winner alone, and a share has its interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from hydro.core.diagnosis import naming
from hydro.core.identification.normal_equations import Normal

SHOTS = 120
rng = np.random.default_rng(0)


@dataclass
class Rival:
    """Only what naming reads of a model."""

    penalised: np.ndarray
    normal: Normal


def rival(costs: np.ndarray) -> Rival:
    gram = rng.standard_normal((SHOTS, 3, 3))
    return Rival(
        costs, Normal(gram @ gram.transpose(0, 2, 1), 100, np.ones((SHOTS, 1)), np.zeros((SHOTS, 0, 3)))
    )


def test_equal_rivals_share_the_wins():
    costs = rng.chisquare(100, SHOTS)
    one, other = costs + rng.normal(0, 1, SHOTS), costs + rng.normal(0, 1, SHOTS)
    other += one.sum() / SHOTS - other.sum() / SHOTS
    found = naming.wins({"a": rival(one), "b": rival(other)}, "a")
    assert set(found) == {"a", "b"}
    assert found["a"] == pytest.approx(0.5, abs=0.1)
    assert sum(found.values()) == pytest.approx(1.0)


def test_a_clear_winner_stands_alone():
    costs = rng.chisquare(100, SHOTS)
    found = naming.wins({"worse": rival(costs + 5.0), "best": rival(costs)}, "best")
    assert found == {"best": 1.0}


def test_the_interval_of_a_share_covers_it_as_often_as_promised():
    covered = []
    for seed in range(150):
        draw = np.random.default_rng(seed)
        excess = draw.exponential(10.0, SHOTS)
        gain = excess * draw.uniform(0.1, 0.5, SHOTS)
        share, low, high = naming.share(gain, excess, 1)
        assert low <= share <= high
        covered.append(low <= 0.3 <= high)
    assert np.mean(covered) > 0.88


def test_a_share_lies_between_nothing_and_everything():
    assert naming.share(np.full(SHOTS, 3.0), np.full(SHOTS, 2.0), 4) == (1.0, 1.0, 1.0)
    assert naming.share(np.full(SHOTS, -1.0), np.full(SHOTS, 2.0), 4)[0] == 0.0
