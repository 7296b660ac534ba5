"""What every task is made of: a scene per episode, what its steps are worth, and when it is done.

A task has no state.  Its scene depends on the seed, the vehicle's number and its episode's number alone,
never on how others fly: the same tasks can be flown in the student and in the teacher.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import ClassVar, NamedTuple

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import UsageError
from hydro.rl.world.config import Reward, Settings

STILL = np.zeros(3)


class Scene(NamedTuple):
    """One episode's task.

    Attributes:
        start: x y z of CO, NED (3,) [m]; the vehicle is level and at rest.
        heading: psi at the start [rad].
        course: Where the goal is at every control step (K, 3), NED [m]; it stays where the last one is.
        pillars: x y of the pillars' axes (P, 2) [m].
        current: Velocity of the water (3,), NED [m/s].
    """

    start: Array
    heading: float
    course: Array
    pillars: Array
    current: Array = STILL

    @property
    def goal(self) -> Array:
        """Where the goal is at first (3,), NED [m]."""
        return np.asarray(self.course[0])


class Ends(NamedTuple):
    """When an episode is done.

    Attributes:
        steps: Control steps at most.
        radius: Distance to the goal that is near enough [m].
        tilt: Greatest angle between the attitude and level, bow to the north [rad].
        speed: Greatest speed over ground [m/s].
        turning: Greatest angular velocity [rad/s].
        settling: Of a task that holds, steps after which the error counts: the episode goes on to its end,
            and succeeds with a root mean square error of at most `radius`.  Below 0 of a task that arrives:
            the first step within all limits ends it.
    """

    steps: float
    radius: float
    tilt: float = math.inf
    speed: float = math.inf
    turning: float = math.inf
    settling: float = -1.0


class Task(ABC):
    """A task; a new one is a class in a file of its own, and its entry in `registry`.

    Attributes:
        name: What it is called.
        levels: What its level counts, in the plural; empty where there is one level alone.
        most: Its greatest level.
        guided: Whether the vehicle is shown a point ahead on a planned way for a target, and not the goal.
        patience: Its time, in multiples of `settings.task.steps`; about twice what a pilot by hand needs.
    """

    name: ClassVar[str]
    levels: ClassVar[str] = ""
    most: ClassVar[int] = 0
    guided: ClassVar[bool] = False
    patience: ClassVar[float] = 1.0

    @abstractmethod
    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Draw the scene of one episode; level 0 is open water, where levels count something."""

    def lead(self, settings: Settings) -> float:
        """Time by which the target that is shown is ahead of the goal [s]."""
        return 0.0

    def reward(self, settings: Settings) -> Reward:
        """Weights of the terms of `rl.environment.reward` that its steps are worth.

        By default those of the settings without the costs of nearness: there is nothing to come near to.  A
        success is worth more where there is more time for loitering.
        """
        given = settings.reward
        return replace(given, obstacle=0.0, near=0.0, success=self.patience * given.success)

    def ends(self, settings: Settings) -> Ends:
        """When an episode is done; by default within `settings.task.radius` of the goal."""
        return Ends(self.steps(settings), settings.task.radius)

    def steps(self, settings: Settings) -> int:
        """Control steps of an episode at most."""
        return round(self.patience * settings.task.steps)

    def require(self, level: int) -> None:
        """Refuse a level that does not exist.

        Raises:
            UsageError: It is not within 0 and `most`.
        """
        if not 0 <= level <= self.most:
            counted = f"{level} {self.levels}; choose 0 to {self.most}" if self.levels else "none"
            raise UsageError(f"level {level} of {self.name} asks for {counted}")


def with_obstacles(task: Task, settings: Settings) -> Reward:
    """The weights of a task in which there is something to keep clear of."""
    given = settings.reward
    return replace(given, success=task.patience * given.success)


def generator(seed: int, vehicle: int, episode: int) -> np.random.Generator:
    """What draws the scene of one episode of one vehicle of a fleet."""
    return np.random.default_rng([seed, vehicle, episode])


def open_water(settings: Settings, rng: np.random.Generator) -> Scene:
    """Start, heading and goal at random; the goal at a random distance in a random direction."""
    task, world = settings.task, settings.world
    low = np.full(3, task.margin)
    high = np.array([world.length, world.width, world.depth]) - task.margin
    while True:
        start = rng.uniform(low, high)
        way = rng.standard_normal(3)
        goal = start + rng.uniform(task.least, task.most) * way / np.linalg.norm(way)
        if (goal >= low).all() and (goal <= high).all():
            return Scene(start, rng.uniform(-np.pi, np.pi), goal[None], nowhere())


def depths(settings: Settings, rng: np.random.Generator) -> tuple[float, float]:
    """Depths of start and goal of a course along the tank, at most a metre apart [m]."""
    shallow, deep = settings.task.margin, settings.world.depth - settings.task.margin
    depth = rng.uniform(shallow, deep)
    return depth, min(max(depth + rng.uniform(-1.0, 1.0), shallow), deep)


def along(settings: Settings, ends: Array, pillars: Array, south: bool, rng: np.random.Generator) -> Scene:
    """A scene from the first to the second of two ends (2, 3), or turned round to lead to the south."""
    start, goal = ends[::-1] if south else ends
    heading = np.pi * south + rng.uniform(-settings.task.slant, settings.task.slant)
    return Scene(start, float(heading), goal[None], pillars)


def nowhere() -> Array:
    """No pillars."""
    return np.empty((0, 2))
