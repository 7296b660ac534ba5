"""Reward: potential shaping, signs of the terms, and a higher return for success than for loitering."""

import dataclasses
import itertools
from dataclasses import replace

import numpy as np
import pytest
from fleets import QUIET, fleet, neutral, put
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import UsageError
from hydro.core.vehicle.frames import rotation
from hydro.rl.environment import reward
from hydro.rl.world.config import Episode, Reward, Settings, World

W = reward.weights(Reward())


def test_weights_stand_in_the_order_of_their_names():
    for name, weight in dataclasses.asdict(Reward()).items():
        assert W[getattr(reward, name.upper())] == weight


@given(distances=st.lists(st.floats(0.0, 30.0), min_size=2, max_size=50))
def test_shaping_sums_to_its_ends(distances):
    total = sum(reward.shaping(W, before, after) for before, after in itertools.pairwise(distances))
    ends = W[reward.SHAPING] / W[reward.DISTANCE] * (distances[0] - distances[-1])
    assert total == pytest.approx(ends, abs=1e-9)


@given(distances=st.lists(st.floats(0.0, 30.0), min_size=2, max_size=50), gamma=st.floats(0.9, 0.999))
def test_discounted_shaping_sums_to_its_ends_in_the_return(distances, gamma):
    w = reward.weights(Reward(discount=gamma))
    total = sum(
        gamma**k * reward.shaping(w, before, after)
        for k, (before, after) in enumerate(itertools.pairwise(distances))
    )
    ends = distances[0] - gamma ** (len(distances) - 1) * distances[-1]
    assert total == pytest.approx(w[reward.SHAPING] / w[reward.DISTANCE] * ends, abs=1e-8)


def test_shaping_of_a_flown_episode_sums_to_its_ends():
    shaped = Reward(heading=0.0, upright=0.0, energy=0.0, action=0.0, smoothness=0.0)
    flown = fleet(replace(QUIET, reward=shaped), craft=neutral())
    flown.reset()
    start, total = np.linalg.norm(flown.goals[0] - flown.starts[0]), 0.0
    rng = np.random.default_rng(0)
    for _ in range(20):
        step = flown.step(rng.uniform(-1, 1, (1, 6)), renew=False)
        total += float(step.reward[0])
    assert total == pytest.approx(
        shaped.shaping / shaped.distance * (start - step.info.distance[0]), abs=1e-5
    )
    assert step.info.episode_return[0] == pytest.approx(total, abs=1e-5)


@pytest.mark.parametrize(
    ("attitude", "way", "heading", "upright"),
    [
        ((0, 0, 0), (5, 0), 1.0, 1.0),
        ((0, 0, np.pi / 2), (5, 0), 0.5, 1.0),
        ((0, 0, np.pi), (5, 0), 0.0, 1.0),
        ((0, 0, np.pi / 2), (0, 5), 1.0, 1.0),
        ((np.pi, 0, 0), (5, 0), 1.0, 0.0),
        ((0, 0.4, 0), (5, 0), 1.0, 0.5 * (np.cos(0.4) + 1)),
        ((0, 0, 0), (0.3, 0.3), 0.0, 1.0),  # above or below the target: the bow may point anywhere
    ],
)
def test_heading_and_upright(attitude, way, heading, upright):
    earned = reward.posture(W, rotation(*attitude).ravel(), *map(float, way))
    assert earned == pytest.approx(W[reward.HEADING] * heading + W[reward.UPRIGHT] * upright)


def test_the_cost_of_obstacles_is_the_papers():
    assert reward.obstacle_cost(W, 0.4) == pytest.approx(W[reward.OBSTACLE])
    assert reward.obstacle_cost(W, 2.4) == pytest.approx(W[reward.OBSTACLE] * np.exp(-3.0))
    assert reward.obstacle_cost(W, 4.1) == 0.0
    assert reward.obstacle_cost(W, 0.39) == pytest.approx(0.01 * W[reward.COLLISION])
    assert reward.obstacle_cost(W, 0.39) > reward.obstacle_cost(W, 0.41)


def test_standing_as_a_dock_does_pays_within_two_metres_of_it():
    w = reward.weights(Reward(alignment=0.3))
    for yaw, pay in ((0.0, 1.0), (np.pi / 2, 0.5), (np.pi, 0.0)):
        bow = rotation(0.0, 0.0, yaw).ravel()
        assert reward.alignment(w, bow, 1.9) == pytest.approx(0.3 * pay, abs=1e-12)
        assert reward.alignment(w, bow, 2.1) == 0.0


def test_effort_costs():
    still, full = np.zeros(6), np.ones(6)
    assert reward.effort_cost(W, 0.0, still, still) == 0.0
    assert reward.effort_cost(W, 1.0, full, full) == pytest.approx(W[reward.ENERGY] + W[reward.ACTION])
    assert reward.effort_cost(W, 0.0, still, full) == pytest.approx(W[reward.SMOOTHNESS])


def test_arriving_pays_more_than_any_loitering():
    flown = fleet(QUIET, craft=neutral())
    put(flown, at=(12.0, 6.0, 4.0), goal=(12.6, 6.0, 4.0))
    step = flown.step(np.array([[1.0, 0, 0, 0, 0, 0]]), renew=False)
    while not step.terminated[0]:
        step = flown.step(np.array([[1.0, 0, 0, 0, 0, 0]]), renew=False)
    assert step.info.success[0]
    assert step.reward[0] > 500 * (Reward().heading + Reward().upright)


def test_pillars_cost_where_a_task_has_them_alone():
    earned = {}
    for stage, task in ((1, "point_to_point"), (2, "pillar_row")):
        flown = fleet(QUIET, craft=neutral())
        flown.set_level(task, 0)
        put(flown, goal=(18.0, 6.0, 4.0), pillars=[(14.0, 6.0)])
        earned[stage] = flown.step(np.zeros((1, 6)), renew=False).reward[0]
    assert earned[1] - earned[2] == pytest.approx(
        reward.obstacle_cost(W, 14.0 - Settings().world.pillar_radius - 12.7), rel=1e-3
    )


@pytest.mark.parametrize(
    ("choices", "word"),
    [
        ({"reward": Reward(success=5.0)}, "loiter|without arriving"),
        ({"world": World(length=9.0)}, "world.length"),
        ({"history": 0}, "history"),
        ({"period": 0.041}, "control step"),
    ],
)
def test_choices_that_contradict_each_other_are_refused(choices, word):
    with pytest.raises(UsageError, match=word):
        replace(Settings(), **choices)


def test_a_tank_may_be_as_long_as_open_water_and_no_longer():
    task = Episode(margin=1.0, most=8.0)
    assert replace(Settings(), task=task, world=World(length=10.0)).world.length == 10.0
    with pytest.raises(UsageError, match=r"world\.length"):
        replace(Settings(), task=task, world=World(length=9.99))
