"""Guidance along a planned path: look-ahead point, its smoothing, and the cost of path deviation."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.rl.environment.guidance import ALPHA, Guidance, nearest
from hydro.rl.environment.reward import cross_track_cost
from hydro.rl.world.config import Settings

AHEAD = Settings().task.ahead
START, GOAL = np.array([4.0, 6.0, 2.0]), np.array([16.0, 6.0, 2.0])
ALL = np.array([True])
NOWHERE = np.full((1, 8, 2), np.nan)


def north(metres):
    return np.array([metres, 0.0, 0.0])


def guided(pillars=NOWHERE):
    guidance = Guidance(Settings(), 1)
    guidance.reset(ALL, START[None], GOAL[None], pillars)
    return guidance


@pytest.mark.parametrize("margin", [0.5, 1.6])
def test_ways_keep_the_margin_that_is_asked_for(margin):
    pillars = np.array([[[10.0, 6.0], *[[np.nan, np.nan]] * 7]])
    guidance, settings = Guidance(Settings(), 1, margin), Settings()
    guidance.reset(ALL, START[None], GOAL[None], pillars)
    way = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(guidance.ways[0])])
    nearest_by = np.linalg.norm(way[:, :2] - pillars[0, 0], axis=1).min() - settings.world.pillar_radius
    assert margin - 0.1 < nearest_by < margin + 0.1


def test_the_point_ahead_lies_on_the_way_and_ends_at_the_goal():
    ahead, cost = guided().targets(ALL, START[None])
    np.testing.assert_allclose(ahead, START[None] + north(AHEAD))
    assert cost == 0.0
    ahead, _ = guided().targets(ALL, START[None] + north(4.5))
    np.testing.assert_allclose(ahead, START[None] + north(4.5 + AHEAD))
    guidance = guided()
    for x in np.arange(4.0, 16.0, 0.5):
        ahead, _ = guidance.targets(ALL, np.array([[x, 6.0, 2.0]]))
    for _ in range(200):
        ahead, _ = guidance.targets(ALL, GOAL[None])
    np.testing.assert_allclose(ahead, [GOAL], atol=1e-9)


def test_a_jump_is_followed_with_the_gain_of_the_average():
    guidance = guided()
    first, _ = guidance.targets(ALL, START[None])
    second, _ = guidance.targets(ALL, START[None] + north(1.0))
    np.testing.assert_allclose(second - first, [[ALPHA, 0.0, 0.0]], atol=1e-12)


@given(st.floats(-5.0, 5.0))
def test_the_cost_is_square_then_straight_without_a_step_or_a_kink(e):
    expected = e**2 if abs(e) < 1.0 else 2.0 * abs(e) - 1.0
    assert cross_track_cost(e) == pytest.approx(expected)
    slope = (cross_track_cost(e + 1e-6) - cross_track_cost(e - 1e-6)) / 2e-6
    assert slope == pytest.approx(np.clip(2.0 * e, -2.0, 2.0), abs=1e-5)


@given(st.floats(0.0, 2.0), st.floats(-2.0, 2.0))
def test_the_cost_is_of_the_distance_to_the_way(across, deeper):
    _, cost = guided().targets(ALL, START[None] + np.array([3.0, across, deeper]))
    weight = Settings().reward.path
    assert cost[0] == pytest.approx(weight * cross_track_cost(np.hypot(across, deeper)), rel=1e-9)


@given(st.integers(0, 1000))
def test_the_nearest_place_is_none_farther_than_any_other(seed):
    rng = np.random.default_rng(seed)
    way, position = rng.uniform(0, 5, (5, 3)), rng.uniform(0, 5, 3)
    off, where = nearest(way, position, 0.0, np.inf)
    dense = np.concatenate([np.linspace(a, b, 2000) for a, b in pairwise(way)])
    assert off == pytest.approx(np.linalg.norm(dense - position, axis=1).min(), abs=5e-3)
    assert 0.0 <= where <= np.linalg.norm(np.diff(way, axis=0), axis=1).sum() + 1e-9


def test_a_vehicle_is_looked_for_near_where_it_was():
    """On a path that crosses itself, the nearest point may belong to a much later part."""
    way = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    _, where = nearest(way, np.array([2.0, 0.8, 0.0]), 1.0, 7.0)
    assert where == pytest.approx(2.0)


def test_others_stand_still_and_states_come_back():
    guidance = Guidance(Settings(), 2)
    both = np.ones(2, bool)
    pillars = np.full((2, 8, 2), np.nan)
    pillars[1, 0] = 10.0, 6.0
    guidance.reset(both, np.tile(START, (2, 1)), np.tile(GOAL, (2, 1)), pillars)
    places = np.tile(START, (2, 1))
    guidance.targets(both, places)
    kept = guidance.state()
    after, _ = guidance.targets(np.array([True, False]), places + north(1.0))
    np.testing.assert_array_equal(after[1], kept["ahead"][1])
    assert after[0, 0] > kept["ahead"][0, 0]
    other = Guidance(Settings(), 2)
    other.restore(kept)
    again, _ = other.targets(np.array([True, False]), places + north(1.0))
    np.testing.assert_array_equal(again, after)
