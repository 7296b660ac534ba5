"""Imitation learning: expert corrections of the policy level by level, without loss of earlier levels."""

from dataclasses import replace

import numpy as np
import pytest
from fleets import vehicle

from hydro.commands.rl_flights import _flyers
from hydro.core.errors import UsageError
from hydro.io.schema import load
from hydro.rl.environment.helmsman import Manner, helmsman
from hydro.rl.tasks.registry import TASKS
from hydro.rl.training.build import Builder
from hydro.rl.training.config import RECIPES, Curriculum, SACConfig, TrainingConfig
from hydro.rl.training.demonstrations import DISTURBANCE, Disturbed, corrections, own_actions
from hydro.rl.training.train import Training
from hydro.rl.world.config import Episode, Settings

OPEN, ONE, FOUR, FOREST = ("point_to_point", 0), ("slalom", 1), ("slalom", 4), ("forest", 12)
TAUGHT = TrainingConfig(
    vehicles=4,
    record=40,
    evaluate=400,
    demonstrations=2,
    clone=2,
    corrections=2,
    curriculum=Curriculum(last=3, baffles=(1, 4), window=4, examine=40),
    sac=SACConfig(layers=(8,), batch=8, capacity=300, random=0),
    settings=Settings(task=Episode(steps=5)),
)


class Scripted(Training):
    """Training whose examinations follow a script: results by level, True once the list is exhausted."""

    def begun(self, script):
        self.script, self.asked = {level: list(words) for level, words in script.items()}, []
        return self

    def _evaluate(self, purpose, episodes, seed, level=None):
        level = level or self.curriculum.level
        if purpose != "exam":
            return 0.0
        passed = self.script.get(level) or [True]
        self.asked.append((level, passed[0]))
        self.script[level] = passed[1:]
        return float(passed[0])


def trained(script, **more):
    config = replace(TAUGHT, **more)
    training = Scripted(config, Builder(config, vehicle())).begun(script)
    while not training.finished:
        training.advance()
    return training


def test_the_pilot_teaches_with_the_room_that_is_asked_for():
    """With a larger margin to the end of a baffle, the expert steers more to the side."""

    def told(**manner):
        fleet = Builder(TAUGHT, vehicle())(1, 3)
        fleet.set_level("slalom", 4)
        return next(corrections(fleet, lambda seen: np.zeros((len(seen), 6)), Manner(**manner)))[1]

    assert np.abs(told(margin=0.4) - told(margin=1.6)).max() > 0.05
    np.testing.assert_array_equal(told(), told(margin=1.2))
    assert RECIPES["imitation"].margin > TrainingConfig().margin == 1.2
    with pytest.raises(UsageError, match="margin"):
        TrainingConfig(margin=-1.0)


def test_he_who_teaches_is_quicker_and_firmer_than_he_who_is_in_tables():
    """A turning hull at rest, with pitch and roll of 0.1 rad and a distant target."""
    seen = np.zeros((1, 36), dtype=np.float32)
    seen[0, :3], seen[0, 6:9], seen[0, 13:16] = (10.0, 0.1, 0.0), (0.01, 0.02, 0.03), (-0.98, 0.98, 9.71)
    plain, taught = helmsman(seen)[0], helmsman(seen, RECIPES["imitation"].manner)[0]
    np.testing.assert_allclose(taught[:3], 1.125 * plain[:3], rtol=1e-5)
    rates = 0.8 * seen[0, 6:9]
    np.testing.assert_allclose(taught[3:] + 2.0 * rates, 4.0 * (plain[3:] + rates), rtol=1e-4)
    for name in ("pace", "firmness"):
        with pytest.raises(UsageError, match=name):
            TrainingConfig(**{name: 0.0})


def test_who_flies_beside_a_policy_is_also_who_taught_it():
    """The expert needs a map and is omitted without one; the schema of results includes all pilots."""
    known = replace(TAUGHT, pace=2.0), replace(TAUGHT, demonstrations=0, clone=0, corrections=0, lessons=0)
    names = [
        [name for name, *_ in _flyers(None, TASKS["forest"], config, pilot=True, planless=planless)]
        for config, planless in ((known[0], False), (known[0], True), (known[1], False))
    ]
    pilots = ["helmsman", "helmsman with map"]
    assert names == [[*pilots, "pilot who taught"], pilots[:1], pilots]
    (known_by,) = (one for one in load("evaluations", 2).fields if one.name == "flown_by")
    assert set(names[0]) < set(known_by.constraints.enum or ())


def test_the_pilot_tells_what_he_would_do_where_another_comes_to():
    def idle(observations):
        return np.zeros((len(observations), 6))

    fleet = Builder(TAUGHT, vehicle())(3, 1)
    fleet.set_level("point_to_point")
    told = list(corrections(fleet, idle))
    assert len(told) == 5
    for seen, said in told:
        np.testing.assert_allclose(said, np.clip(helmsman(seen), -1.0, 1.0), atol=1e-6)
    assert np.linalg.norm(told[-1][0][:, 3:6], axis=1).max() < 0.3  # he has not swum
    own = list(own_actions(Builder(TAUGHT, vehicle())(3, 1), idle))
    assert all((done == 0.0).all() for _, done in own)
    np.testing.assert_array_equal(own[0][0], told[0][0])


def test_what_was_learnt_before_may_pass_a_level_without_a_lesson():
    training = trained({})
    assert [level for level, _ in training.asked] == [OPEN, ONE, FOUR, FOREST, OPEN, FOUR, FOREST]
    assert training.curriculum.done
    assert training.steps == 2 * 5
    assert training._learner._labels.levels == [OPEN]


def test_lessons_go_on_until_a_level_is_passed():
    """The slalom is examined first, then after the expert's flight and after the corrected policy flight."""
    training = trained({ONE: [False, False, True]})
    assert [level for level, _ in training.asked[:5]] == [OPEN, ONE, ONE, ONE, FOUR]
    assert training.steps == 2 * 5 + 2 * (2 * 10)
    assert training._learner._labels.levels == [OPEN, ONE]


def test_a_level_that_is_not_passed_at_once_takes_so_many_lessons():
    """There is no examination before the second correction; a forgotten level needs one lesson."""
    more = {"corrections": 3, "lessons": 2}
    training = trained({ONE: [False, False, True]}, **more)
    assert [level for level, _ in training.asked[:5]] == [OPEN, ONE, ONE, ONE, FOUR]
    assert training.steps == 2 * 5 + 3 * (2 * 10)
    training = trained({FOUR: [False, True, False, True]}, **more)
    assert training.steps == 2 * 5 + 2 * 10 + 2 * 10
    with pytest.raises(UsageError, match="lessons is 4"):
        replace(TAUGHT, lessons=4)


def test_what_the_last_policy_has_unlearnt_is_taught_again():
    """In the end one policy passes all levels."""
    training = trained({FOUR: [False, True, False, True], FOREST: [False, True]})
    assert [level for level, _ in training.asked] == [
        OPEN, ONE, FOUR, FOUR, FOREST, FOREST, OPEN, FOUR, FOUR, OPEN, FOUR, FOREST
    ]  # fmt: skip
    assert training.curriculum.done
    for task, level in (OPEN, FOUR, FOREST):
        kept, last = training.task_policies[task], training.policy()
        assert (kept.training["task"], kept.training["level"]) == (task, level)
        assert all(np.array_equal(kept.weights[name], last.weights[name]) for name in last.weights)


def test_a_policy_without_lessons_left_learns_by_itself_and_keeps_its_habits():
    """Its own experience replaces the expert labels, which did not suffice there."""
    training = trained({OPEN: [False] * 4}, curriculum=replace(TAUGHT.curriculum, last=1))
    assert [passed for _, passed in training.asked] == [False, False, False, False, True, True]
    shown = 3 * 2 * 5
    assert training.steps > shown + 40
    observations, said = training._learner._labels._labels[OPEN]
    done = np.tanh(training._learner._average.module(observations)[0].detach().numpy())
    np.testing.assert_allclose(said.numpy(), done, atol=1e-5)
    assert len(said) == 2 * 2  # of five steps of two vehicles the first and the fifth


def test_corrections_are_cloned():
    with pytest.raises(UsageError, match="give clone a number of batches"):
        TrainingConfig(demonstrations=3, corrections=1)


def test_every_other_vehicle_is_pushed_and_a_push_wanders():
    """Check the size of the disturbance by axis over many steps, and its autocorrelation."""

    def idle(observations):
        return np.zeros((len(observations), 6), np.float32)

    flying = Disturbed(idle, 0.6, seed=2)
    done = np.array([flying(np.zeros((40, 36), np.float32)) for _ in range(3000)])
    assert (done[:, ::2] == 0.0).all()
    pushes = done[:, 1::2]
    np.testing.assert_allclose(pushes.std(axis=(0, 1)), 0.6 * DISTURBANCE, rtol=0.1)
    alike = np.corrcoef(pushes[:-50].ravel(), pushes[50:].ravel())[0, 1]
    assert alike == pytest.approx(np.exp(-1.0), abs=0.1)
    again = Disturbed(idle, 0.6, seed=2)
    np.testing.assert_array_equal(again(np.zeros((40, 36), np.float32)), done[0])
