"""Where an episode starts and leads, and which pillars stand in between, in the curriculum's three stages.

1. point to point: start, heading and goal at random in open water;
2. pillars: a slalom of as many as its level says, between start and goal on a course along the tank;
3. guided: the same scenes, with a planned path to follow.

A task depends on the seed, the vehicle's number and its episode's number alone, never on how others fly: the
same tasks can be flown in the student and in the teacher.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import UsageError
from hydro.rl.environment.config import Settings, course

POINT_TO_POINT, PILLARS, GUIDED = STAGES = (1, 2, 3)


class Scene(NamedTuple):
    """One episode's task.

    Attributes:
        start: x y z of CO, NED (3,) [m]; the vehicle is level and at rest.
        heading: psi at the start [rad].
        goal: (3,), NED [m].
        pillars: x y of the pillars' axes (P, 2) [m], NaN where there is none.
    """

    start: Array
    heading: float
    goal: Array
    pillars: Array


def require_level(settings: Settings, stage: int, level: int, *, guided: bool) -> None:
    """Refuse a stage or level that does not exist; `guided`: there is something to lead along a path.

    Raises:
        UsageError: The stage is not 1, 2 or 3, or 3 without guidance, or the level not within 0 and the
            world's pillars.
    """
    if stage not in STAGES:
        raise UsageError(f"there is no stage {stage}; choose 1 (point to point), 2 (pillars) or 3 (guided)")
    if stage == GUIDED and not guided:
        raise UsageError("stage 3 needs guidance along a path; give the fleet some")
    if not 0 <= level <= settings.world.pillars:
        raise UsageError(
            f"level {level} asks for {level} pillars; choose 0 to {settings.world.pillars} (world.pillars)"
        )


def scene(settings: Settings, stage: int, level: int, seed: int, vehicle: int, episode: int) -> Scene:
    """The task of one episode of one vehicle.

    Args:
        settings: The world and the distances.
        stage: 1, 2 or 3.
        level: Number of pillars; no effect in stage 1.
        seed: Seed of the fleet.
        vehicle: Number of the vehicle.
        episode: Number of its episode.
    """
    rng = np.random.default_rng([seed, vehicle, episode])
    if stage == POINT_TO_POINT or level == 0:
        return _open_water(settings, rng)
    return _slalom(settings, level, rng)


def _open_water(settings: Settings, rng: np.random.Generator) -> Scene:
    """Start, heading and goal at random; the goal at a random distance in a random direction."""
    task, world = settings.task, settings.world
    low = np.full(3, task.margin)
    high = np.array([world.length, world.width, world.depth]) - task.margin
    while True:
        start = rng.uniform(low, high)
        way = rng.standard_normal(3)
        goal = start + rng.uniform(task.least, task.most) * way / np.linalg.norm(way)
        if (goal >= low).all() and (goal <= high).all():
            return Scene(start, rng.uniform(-np.pi, np.pi), goal, _nowhere(settings))


def _slalom(settings: Settings, level: int, rng: np.random.Generator) -> Scene:
    """Pillars at even distances along a course north or south, on alternating sides of it."""
    task, world = settings.task, settings.world
    length = max(rng.uniform(task.least, task.most), course(task, level))
    south = rng.random() < 0.5
    middle = rng.uniform(world.width / 3.0, 2.0 * world.width / 3.0)
    first = rng.uniform(task.margin, world.length - task.margin - length)
    shallow, deep = task.margin, world.depth - task.margin
    depth = rng.uniform(shallow, deep)
    other = min(max(depth + rng.uniform(-1.0, 1.0), shallow), deep)

    along = np.linspace(task.run_up, length - task.run_up, level) if level > 1 else np.array([0.5 * length])
    sides = rng.choice([-1.0, 1.0]) * (-1.0) ** np.arange(level)
    pillars = _nowhere(settings)
    pillars[:level, 0] = first + (length - along if south else along)
    pillars[:level, 1] = middle + sides * rng.uniform(*task.sway, level)
    ends = np.array([[first, middle, depth], [first + length, middle, other]])
    start, goal = ends[::-1] if south else ends
    heading = np.pi * south + rng.uniform(-task.slant, task.slant)
    return Scene(start, float(heading), goal, pillars)


def _nowhere(settings: Settings) -> Array:
    """No pillars."""
    return np.full((settings.world.pillars, 2), np.nan)
