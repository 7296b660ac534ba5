"""Waypoint task: the goal moves on at each waypoint, and the pilot of fins passes them all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fleets import QUIET, fleet

from hydro.core.errors import UsageError
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.rl.tasks.registry import TASKS
from hydro.rl.tasks.task import generator
from hydro.rl.training.evaluate import fly, summary
from hydro.rl.training.pilots import WithMap
from hydro.rl.training.trials import TRIALS
from hydro.rl.world.config import Settings, World

SEA = replace(QUIET, world=World(length=120.0, width=60.0, depth=20.0))
"""A tank of several turning circles of the REMUS 100."""
HOVER = np.zeros((1, 6))


def course(count=1, settings=SEA, **more):
    subject = fleet(settings, count, **more)
    subject.set_level("waypoints")
    subject.reset()
    return subject


def place(subject, at):
    """Place the only vehicle at rest, within its episode."""
    pose = subject.plant.pose.copy()
    pose[0, :3] = at
    subject.plant.reset(np.ones(1, bool), pose, np.zeros((1, 6)))


def test_a_waypoint_that_is_passed_gives_way_to_the_next_without_a_reward():
    subject = course()
    first, second = subject._courses[0, :2].copy()
    place(subject, first - [5.0, 0.0, 0.0])
    far = subject.step(HOVER, renew=False)
    np.testing.assert_array_equal(subject.goals[0], first)
    place(subject, first)
    passed = subject.step(HOVER, renew=False)
    np.testing.assert_array_equal(subject.goals[0], second)
    assert not (far.terminated | passed.terminated)[0]
    assert passed.info.reward_terms[0, 0] == pytest.approx(0.0, abs=1e-9), "no shaping by the change itself"
    assert passed.info.distance[0] == pytest.approx(np.linalg.norm(second - first), abs=0.1)


def test_only_the_last_waypoint_ends_the_episode():
    subject = course()
    for number, waypoint in enumerate(subject._courses[0].copy()):
        place(subject, waypoint)
        done = subject.step(HOVER, renew=False)
        assert bool(done.terminated[0]) == (number == 3)
    assert done.info.success[0]


def test_a_course_goes_on_from_a_state():
    one, two = course(), course(seed=5)
    place(one, one.goals[0])
    one.step(HOVER, renew=False)
    two.restore(one.state())
    assert two._waypoint[0] == one._waypoint[0] == 1
    np.testing.assert_array_equal(two.step(HOVER, renew=False).obs, one.step(HOVER, renew=False).obs)


def test_legs_and_turns_are_those_of_the_settings():
    drawn = TASKS["waypoints"].scene(SEA, 0, generator(0, 0, 0))
    points = np.vstack([drawn.start, drawn.course])
    legs = np.diff(points, axis=0)
    level = np.linalg.norm(legs[:, :2], axis=1)
    low, high = SEA.waypoints.leg
    assert (level > low - 1e-9).all()
    assert (level < high + 1e-9).all()
    assert (np.abs(legs[:, 2]) <= SEA.waypoints.slope * level + 1e-9).all()
    assert drawn.passed == SEA.waypoints.within
    assert TASKS["waypoints"].scene(QUIET, 0, generator(0, 0, 0)).passed < 0.5, "less in a small tank"
    assert (np.abs(legs[:, 1]) <= np.sin(SEA.waypoints.turn) * level + 1e-9).all()


def test_the_pilot_of_fins_passes_every_waypoint():
    craft = files.read(bundled("vehicles") / "remus100_fins.toml")[0]
    subject = course(6, craft=craft, seed=1)
    found = summary(fly(WithMap(subject), subject))
    assert found["success"] == 1.0
    assert found["diverged"] == 0.0
    assert 0.1 < found["tracking_error"] < SEA.waypoints.leg[0], "not from the first leg alone"


def test_thrusters_fly_a_short_course_in_the_ordinary_tank():
    subject = course(2, Settings())
    assert summary(fly(WithMap(subject), subject))["success"] == 1.0


def test_half_the_time_is_half_the_steps_of_a_course():
    task = TASKS["waypoints"]
    assert task.steps(TRIALS["half_time"].of(SEA)) == task.steps(SEA) // 2


def test_the_only_level_is_zero():
    with pytest.raises(UsageError, match="the only level is 0"):
        TASKS["waypoints"].require(1)
