"""Tasks lie within the tank, are as far as they should be, and depend on nothing but their numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import UsageError
from hydro.rl.environment import tasks
from hydro.rl.environment.config import Settings, course

SETTINGS = Settings()
numbers = st.integers(0, 10**6)


@given(stage=st.sampled_from(tasks.STAGES), level=st.integers(0, 8), seed=numbers, vehicle=numbers)
def test_every_task_can_be_flown(stage, level, seed, vehicle):
    task, world = SETTINGS.task, SETTINGS.world
    scene = tasks.scene(SETTINGS, stage, level, seed, vehicle, 3)
    size = np.array([world.length, world.width, world.depth])
    for end in (scene.start, scene.goal):
        assert (end >= task.margin - 1e-9).all()
        assert (end <= size - task.margin + 1e-9).all()
    standing = scene.pillars[np.isfinite(scene.pillars[:, 0])]
    assert len(standing) == (0 if stage == 1 else level)
    away = np.linalg.norm(scene.goal - scene.start)
    assert task.least - 1e-9 <= away
    if len(standing) == 0:
        assert away <= task.most + 1e-9
        return
    assert away >= course(task, level) - 1e-9
    for end in (scene.start, scene.goal):
        gaps = np.hypot(*(standing - end[:2]).T)
        assert gaps.min() > 1.2 + world.pillar_radius  # the planner's margin
    assert (standing > world.pillar_radius + 1.2).all()
    assert (standing < size[:2] - world.pillar_radius - 1.2).all()
    along = np.sort(standing[:, 0])
    assert (np.diff(along) >= task.spacing - 1e-9).all()


def test_a_slalom_changes_sides():
    scene = tasks.scene(SETTINGS, 2, 8, 0, 0, 0)
    side = np.sign(scene.pillars[:, 1] - scene.start[1])
    assert (side[1:] == -side[:-1]).all()


def test_a_task_is_its_own_whatever_was_drawn_before():
    again = tasks.scene(SETTINGS, 2, 5, 1, 2, 3)
    for other in ((9, 2, 3), (1, 9, 3), (1, 2, 9)):
        assert (tasks.scene(SETTINGS, 2, 5, *other).start != again.start).any()
    for one, two in zip(tasks.scene(SETTINGS, 2, 5, 1, 2, 3), again, strict=True):
        np.testing.assert_array_equal(one, two)


def test_both_ways_along_the_tank_and_all_headings_occur():
    drawn = [tasks.scene(SETTINGS, 2, 8, 0, k, 0) for k in range(60)]
    assert {np.sign(scene.goal[0] - scene.start[0]) for scene in drawn} == {-1.0, 1.0}
    for scene in drawn:  # a slalom begins with the bow towards it
        assert np.cos(scene.heading) * np.sign(scene.goal[0] - scene.start[0]) > 0.7
    headings = [tasks.scene(SETTINGS, 1, 0, 0, k, 0).heading for k in range(60)]
    assert min(headings) < -2.0
    assert max(headings) > 2.0


@pytest.mark.parametrize(
    ("stage", "level", "word"), [(0, 0, "no stage"), (4, 0, "no stage"), (2, 9, "level"), (3, 0, "guidance")]
)
def test_what_does_not_exist_is_refused(stage, level, word):
    with pytest.raises(UsageError, match=word):
        tasks.require_level(SETTINGS, stage, level, guided=False)
