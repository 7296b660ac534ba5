"""Curriculum: conditions for the next level, and for divergence of the learning."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import UsageError
from hydro.rl.training.config import Curriculum
from hydro.rl.training.curriculum import CurriculumProgress
from hydro.rl.training.divergence import UPDATES, Watch


def test_the_levels_lead_from_open_water_through_pillars_to_guidance():
    open_water = ("point_to_point", 0)
    assert Curriculum().levels == (open_water,)
    through = tuple(("slalom", baffles) for baffles in (0, 2, 4))
    assert Curriculum(last=3, baffles=(0, 2, 4), pillars=9).levels == (open_water, *through, ("forest", 9))


def test_a_task_may_be_learnt_alone():
    assert Curriculum(task="docking").levels == (("docking", 0),)
    assert Curriculum(task="slalom").levels == (("slalom", 4),)


def test_training_is_examined_only_when_a_full_window_succeeds_often_enough():
    curriculum = CurriculumProgress(Curriculum(last=2))
    for _ in range(149):
        curriculum.note(True)
    assert not curriculum.ready
    curriculum.note(True)
    assert curriculum.ready
    for _ in range(16):
        curriculum.note(False)
    assert not curriculum.ready  # 134 of 150 are 89.3 %
    curriculum.note(True)  # the oldest goes, which was a success
    assert not curriculum.ready


def test_an_examination_asks_for_more_than_training_which_explores():
    curriculum = CurriculumProgress(Curriculum(last=2))
    for k in range(150):
        curriculum.note(k >= 15)
    assert curriculum.ready
    assert not curriculum.examined(0.96)
    assert curriculum.examined(0.97)


@given(st.lists(st.booleans(), max_size=60))
def test_the_window_is_of_the_last_episodes(outcomes):
    curriculum = CurriculumProgress(Curriculum(window=20))
    for outcome in outcomes:
        curriculum.note(outcome)
    last = outcomes[-20:]
    assert curriculum.share == (sum(last) / len(last) if last else 0.0)


def test_an_examination_passes_the_level_or_empties_the_window():
    curriculum = CurriculumProgress(Curriculum(last=2, baffles=(0,)))
    for _ in range(150):
        curriculum.note(True)
    assert not curriculum.examined(0.96)
    assert curriculum.level == ("point_to_point", 0)
    assert not curriculum.ready
    assert curriculum.examined(0.98)
    assert curriculum.level == ("slalom", 0)
    assert not curriculum.done
    assert curriculum.examined(1.0)
    assert curriculum.done
    assert curriculum.level == ("slalom", 0)


def test_a_longer_curriculum_goes_on_where_the_shorter_one_ended():
    short = CurriculumProgress(Curriculum(last=1))
    short.examined(1.0)
    longer = CurriculumProgress(Curriculum(last=3))
    longer.restore(short.state())
    assert longer.level == ("slalom", 0)


def test_what_was_passed_stays_passed_in_another_curriculum():
    before = CurriculumProgress(Curriculum(last=2, baffles=(0, 1, 2)))
    for _ in range(3):
        before.examined(1.0)
    after = CurriculumProgress(Curriculum(last=2, baffles=(0, 3, 4)))
    after.restore(before.state())
    assert after.level == ("slalom", 3)
    assert not after.done


def test_what_is_forgotten_is_ahead_again_and_then_all_is_behind():
    curriculum = CurriculumProgress(Curriculum(last=3, baffles=(1, 4), pillars=12))
    assert curriculum.ends == {"point_to_point": 0, "slalom": 4, "forest": 12}
    for _ in range(4):
        curriculum.examined(1.0)
    assert curriculum.done
    curriculum.forget(("slalom", 4))
    assert not curriculum.done
    assert curriculum.level == ("slalom", 4)
    assert curriculum.examined(1.0)
    assert curriculum.done


@pytest.mark.parametrize(
    "wrong",
    [
        {"last": 0},
        {"last": 4},
        {"baffles": ()},
        {"baffles": (-1,), "last": 2},
        {"task": "no-such"},
        {"share": 0.0},
        {"ready": 1.1},
        {"window": 0},
    ],
)
def test_a_curriculum_without_levels_is_refused(wrong):
    with pytest.raises(UsageError):
        Curriculum(**wrong)


def fed(*pieces):
    watch = Watch()
    for loss, times in pieces:
        for _ in range(times):
            watch.loss(loss)
    return watch


def test_losses_far_above_their_median_for_long_are_divergence():
    assert fed((1.0, 5000), (150.0, UPDATES)).verdict == "critic"
    assert fed((1.0, 5000), (150.0, UPDATES - 1)).verdict == ""
    assert fed((1.0, 5000), (150.0, UPDATES - 1), (1.0, 1), (150.0, UPDATES - 1)).verdict == ""
    assert fed((1.0, 5000), (90.0, 3 * UPDATES)).verdict == ""


def test_losses_that_are_no_numbers_are_divergence():
    assert fed((1.0, 10), (math.nan, 1)).verdict == "numerical"


def test_success_that_falls_to_nothing_and_stays_there_is_divergence():
    watch = Watch()
    for share in (0.0, 0.4, 0.0):
        watch.evaluation(share)
    assert watch.verdict == ""
    for share in (0.5, 0.0):
        watch.evaluation(share)
    assert watch.verdict == "success"
    watch.evaluation(0.1)
    assert watch.verdict == ""


def test_states_come_back():
    watch = fed((1.0, 5500), (150.0, 400))
    other = Watch()
    other.restore(watch.state())
    for each in (watch, other):
        for _ in range(700):
            each.loss(150.0)
    assert vars(other) == vars(watch)
    assert watch.exploded
