"""Scenes of all tasks: inside the tank, true to their definition, and determined by their seeds alone."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hydro.rl
from hydro.core.errors import UsageError
from hydro.rl.tasks.registry import STAGES, TASKS, task_of
from hydro.rl.tasks.row import course
from hydro.rl.tasks.task import generator
from hydro.rl.world.config import Episode, Settings, World
from hydro.rl.world.planner import Grid, plan

SETTINGS = Settings()
SIZE = np.array([SETTINGS.world.length, SETTINGS.world.width, SETTINGS.world.depth])
numbers = st.integers(0, 10**6)


def scene(name, level=None, seed=0, vehicle=0, episode=0, settings=SETTINGS):
    task = TASKS[name]
    return task.scene(settings, task.most if level is None else level, generator(seed, vehicle, episode))


@settings(deadline=None)
@given(name=st.sampled_from(list(TASKS)), share=st.floats(0.0, 1.0), seed=numbers, vehicle=numbers)
def test_every_task_can_be_flown(name, share, seed, vehicle):
    task = TASKS[name]
    level = round(share * min(task.most, 12))
    drawn = scene(name, level, seed, vehicle)
    margin = SETTINGS.task.margin
    for place in (*drawn.course, drawn.start):
        assert (place > margin - 0.6).all()
        assert (place < SIZE - margin + 0.6).all()
    for end in (drawn.start, drawn.goal):
        gaps = np.hypot(*(drawn.pillars - end[:2]).T)
        assert gaps.min(initial=np.inf) > 1.2 + SETTINGS.world.pillar_radius  # the planner's margin
    assert len(drawn.pillars) <= SETTINGS.world.pillars
    if name in ("forest", "pillar_row"):
        assert len(drawn.pillars) == level


def test_every_task_has_an_environment():
    assert set(hydro.rl.IDS.values()) == set(TASKS)
    assert set(STAGES) <= set(TASKS)


def test_a_slalom_has_no_way_but_between_its_baffles():
    """Baffles alternate from wall to beyond the middle, without gaps for a hull of half a metre."""
    for vehicle in range(20):
        drawn = scene("slalom", vehicle=vehicle)
        norths = np.unique(drawn.pillars[:, 0])
        assert len(norths) == 4
        assert (np.diff(norths) >= SETTINGS.slalom.spacing - 1e-9).all()
        run_up = SETTINGS.task.margin + SETTINGS.slalom.run_up
        assert run_up - 1e-9 <= norths[0] < norths[-1] <= SIZE[0] - run_up + 1e-9
        walls = []
        for north in norths:
            east = np.sort(drawn.pillars[drawn.pillars[:, 0] == north, 1])
            radius = SETTINGS.world.pillar_radius
            assert (np.diff(east) - 2.0 * radius < 0.2).all()
            west = east[0] < radius + 0.6
            walls.append(west)
            edge = east[-1] + radius if west else SIZE[1] - east[0] + radius
            assert edge > SIZE[1] / 2.0
        assert all(one != other for one, other in pairwise(walls))


@pytest.mark.parametrize("level", [2, 4])
def test_in_a_tank_just_long_enough_baffles_stand_as_close_as_they_may(level):
    margin, slalom = SETTINGS.task.margin, SETTINGS.slalom
    length = 2.0 * (margin + slalom.run_up) + (level - 1) * slalom.spacing
    least = replace(SETTINGS, world=replace(SETTINGS.world, length=length + 1e-9))
    for vehicle in range(3):
        norths = np.unique(scene("slalom", level, vehicle=vehicle, settings=least).pillars[:, 0])
        expected = margin + slalom.run_up + slalom.spacing * np.arange(level)
        np.testing.assert_allclose(norths, expected, atol=1e-6)


def test_the_way_through_a_slalom_keeps_the_whole_margin_and_weaves():
    from hydro.rl.training.evaluate import alternating

    grid, radius = Grid(*SIZE[:2]), SETTINGS.world.pillar_radius
    for vehicle in range(6):
        drawn = scene("slalom", vehicle=vehicle)
        way = plan(grid, drawn.start, drawn.goal, drawn.pillars, radius)
        assert clearance(way, drawn.pillars) > radius + grid.margin - 2.0 * grid.cell
        fine = np.vstack([np.linspace(a, b, 200) for a, b in pairwise(way)])
        assert alternating(fine, drawn.pillars) == 1.0


def test_a_forest_blocks_the_straight_line_and_has_a_way_of_the_whole_margin():
    grid, radius = Grid(*SIZE[:2]), SETTINGS.world.pillar_radius
    for vehicle, level in ((0, 8), (1, 8), (2, 12), (3, 12), (4, 20)):
        drawn = scene("forest", level, vehicle=vehicle)
        apart = np.hypot(*(drawn.pillars[:, None] - drawn.pillars).transpose(2, 0, 1))
        assert apart[~np.eye(level, dtype=bool)].min() >= SETTINGS.forest.spacing
        straight = np.stack([drawn.start, drawn.goal])
        assert clearance(straight, drawn.pillars) < 0.6
        way = plan(grid, drawn.start, drawn.goal, drawn.pillars, radius)
        assert clearance(way, drawn.pillars) > radius + grid.margin - 2.0 * grid.cell
        assert (way[1:-1, :2] > grid.wall - grid.cell).all()


def clearance(way, pillars):
    """Return the minimum distance of a path (K, 3) to the axes of pillars, by dense sampling."""
    fine = np.vstack([np.linspace(a, b, 500) for a, b in pairwise(way)])
    return np.hypot(*(fine[:, None, :2] - pillars).transpose(2, 0, 1)).min()


def test_a_row_changes_sides():
    drawn = scene("pillar_row")
    ordered = drawn.pillars[np.argsort(drawn.pillars[:, 0])]
    side = np.sign(ordered[:, 1] - drawn.start[1])
    assert (side[1:] == -side[:-1]).all()
    assert abs(drawn.goal[0] - drawn.start[0]) >= course(SETTINGS, 8) - 1e-9


@pytest.mark.parametrize("name", ["circle", "helix", "lemniscate"])
def test_a_trajectory_is_even_and_within_the_tank(name):
    drawn = scene(name, vehicle=7)
    steps = np.linalg.norm(np.diff(drawn.course, axis=0), axis=1) / SETTINGS.period
    low, high = SETTINGS.trajectory.speed
    assert low - 0.01 < np.median(steps) < high + 0.01
    assert np.percentile(steps, 98) - np.percentile(steps, 2) < 0.02 * np.median(steps)
    assert len(drawn.course) > TASKS[name].steps(SETTINGS)


def test_first_headings_lie_about_the_way_along_a_trajectory():
    off = []
    for vehicle in range(30):
        drawn = scene("circle", vehicle=vehicle)
        way = drawn.course[25] - drawn.course[0]
        off.append(drawn.heading - np.arctan2(way[1], way[0]))
    assert np.abs(off).max() <= SETTINGS.task.slant + 1e-9
    assert min(-np.min(off), np.max(off)) > 0.5 * SETTINGS.task.slant


def test_a_circle_keeps_its_radius_and_a_helix_its_depth_does_not():
    course = scene("circle").course
    laps = course[: round(2.0 * np.pi * 3.5 / 0.3 / 0.04)]
    middle = (laps.max(axis=0) + laps.min(axis=0)) / 2.0
    radius = np.linalg.norm((laps - middle)[:, :2], axis=1)
    assert np.ptp(course[:, 2]) == 0.0
    assert np.ptp(radius) < 0.2 * radius.mean() or len(laps) == len(course)
    assert np.ptp(scene("helix").course[:, 2]) > 1.0


def test_a_dock_lies_to_the_north_and_a_station_in_a_current():
    for vehicle in range(20):
        drawn = scene("docking", vehicle=vehicle)
        assert drawn.goal[0] - drawn.start[0] > 3.0 * np.cos(SETTINGS.docking.bearing) - 1e-9
        low, high = SETTINGS.station.current
        assert low <= np.linalg.norm(scene("station_keeping", vehicle=vehicle).current) <= high


def test_a_scene_is_its_own_whatever_was_drawn_before():
    again = scene("forest", 8, 1, 2, 3)
    for other in ((9, 2, 3), (1, 9, 3), (1, 2, 9)):
        assert (scene("forest", 8, *other).start != again.start).any()
    for one, two in zip(scene("forest", 8, 1, 2, 3), again, strict=True):
        np.testing.assert_array_equal(one, two)


def test_both_ways_along_the_tank_and_all_headings_occur():
    drawn = [scene("slalom", vehicle=k) for k in range(60)]
    assert {np.sign(one.goal[0] - one.start[0]) for one in drawn} == {-1.0, 1.0}
    for one in drawn:  # it begins with the bow towards the goal
        assert np.cos(one.heading) * np.sign(one.goal[0] - one.start[0]) > 0.7
    headings = [scene("point_to_point", vehicle=k).heading for k in range(60)]
    assert min(headings) < -2.0
    assert max(headings) > 2.0


def test_loitering_pays_less_than_arriving_in_every_task():
    for task in TASKS.values():
        given, ends = task.reward(SETTINGS), task.ends(SETTINGS)
        if ends.settling < 0.0:
            per_step = given.heading + given.upright + given.alignment
            assert given.success > task.steps(SETTINGS) * per_step, task.name


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: task_of("slaloms"), "no task 'slaloms': choose one of slalom"),
        (lambda: TASKS["slalom"].require(9), "level 9 of slalom does not exist: choose 0 to 4 baffles"),
        (lambda: TASKS["docking"].require(1), "level 1 of docking"),
        (lambda: scene("slalom", settings=replace(SETTINGS, world=World(length=15.0))), "lengthen world"),
        (lambda: scene("pillar_row", settings=replace(SETTINGS, world=World(length=15.0))), "lengthen world"),
        (
            lambda: scene("forest", 20, settings=Settings(world=World(length=12.0), task=Episode(most=6.0))),
            "no forest of 20 pillars",
        ),
    ],
)
def test_what_does_not_exist_is_refused(call, word):
    with pytest.raises(UsageError, match=word):
        call()


def test_hyphens_are_as_good_as_underscores():
    assert task_of("station-keeping") is TASKS["station_keeping"]


def test_the_page_on_own_tasks_has_a_task_that_flies():
    from pathlib import Path

    from fleets import fleet

    page = (Path(__file__).resolve().parents[3] / "docs" / "own-task.md").read_text()
    scope = {}
    exec(page.split("```python")[1].split("```")[0], scope)
    flown = fleet(count=3)
    flown.set_level(scope["Dive"]())
    flown.reset()
    np.testing.assert_allclose(flown.goals - flown.starts, [[0.0, 0.0, 3.0]] * 3)
    flown.step(np.zeros((3, 6)))
