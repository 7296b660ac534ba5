"""Base class of tasks: random scene of an episode, weights of its reward, and its end conditions.

A task has no state.  Its scene depends only on the seed, the index of the vehicle and the number of its
episode.  Thus the same scenes can be flown in the MuJoCo model and in the reference simulator.
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

NO_CURRENT = np.zeros(3)


class Scene(NamedTuple):
    """Scene of one episode.

    Attributes:
        start: x y z of CO, NED (3,) [m]; the vehicle is level and at rest.
        heading: Initial psi [rad].
        course: Position of the goal at every control step (K, 3), NED [m]; after the last row it stays there.
            If `passed` is above 0, the K waypoints in order instead.
        pillars: x y of the pillars' axes (P, 2) [m].
        current: Velocity of the water (3,), NED [m/s].
        passed: Distance at which a waypoint is passed and the next one becomes the goal [m]; 0 for a goal
            that moves with time.
    """

    start: Array
    heading: float
    course: Array
    pillars: Array
    current: Array = NO_CURRENT
    passed: float = 0.0

    @property
    def goal(self) -> Array:
        """Initial position of the goal (3,), NED [m]."""
        return np.asarray(self.course[0])


class Ends(NamedTuple):
    """End of an episode, and the limits of success.

    A task that arrives succeeds and ends at the first step within all limits, and fails after `steps` steps.
    A task that holds or follows a point runs for `steps` steps, and succeeds if the root mean square distance
    to the point is at most `radius`.

    Attributes:
        steps: Greatest number of control steps.
        radius: Greatest distance to the goal or target [m].
        tilt: Greatest angle of rotation from roll, pitch and yaw of zero [rad].
        speed: Greatest speed over ground [m/s].
        turning: Greatest angular velocity [rad/s].
        settling: Number of first steps whose distance does not count in a task that holds or follows; below 0
            in a task that arrives.
    """

    steps: float
    radius: float
    tilt: float = math.inf
    speed: float = math.inf
    turning: float = math.inf
    settling: float = -1.0


class Task(ABC):
    """Base class of a task; a new task is a class in its own file and an entry in `registry`.

    Attributes:
        name: Name of the task.
        levels: Unit of its level, in the plural; empty if the task has only one level.
        most: Greatest level.
        guided: Whether the target is a point ahead on a planned path instead of the goal.
        patience: Time limit in multiples of `settings.task.steps`; about twice the time of the hand-written
            pilot.
    """

    name: ClassVar[str]
    levels: ClassVar[str] = ""
    most: ClassVar[int] = 0
    guided: ClassVar[bool] = False
    patience: ClassVar[float] = 1.0

    @abstractmethod
    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a random scene of one episode.

        Args:
            settings: Sizes of tank and course.
            level: Difficulty, such as the number of pillars; 0 is open water if the task has levels.
            rng: Generator of the random numbers.
        """

    def lead(self, settings: Settings) -> float:
        """Return the time by which the target in the observation is ahead of the moving goal [s]."""
        return 0.0

    def reward(self, settings: Settings) -> Reward:
        """Return the weights of the terms of `rl.environment.reward`.

        The default removes the costs of being close to obstacles, because there are none.  The reward of
        success is multiplied by `patience`, because a longer episode leaves more time for loitering.
        """
        given = settings.reward
        return replace(given, obstacle=0.0, near=0.0, success=self.patience * given.success)

    def ends(self, settings: Settings) -> Ends:
        """Return the end conditions of an episode.

        By default success within `settings.task.radius` of the goal.
        """
        return Ends(self.steps(settings), settings.task.radius)

    def steps(self, settings: Settings) -> int:
        """Return the greatest number of control steps of an episode."""
        return round(self.patience * settings.task.steps)

    def require(self, level: int) -> None:
        """Check that a level exists.

        Raises:
            UsageError: The level is not within 0 and `most`.
        """
        if not 0 <= level <= self.most:
            choice = f"choose 0 to {self.most} {self.levels}" if self.levels else "the only level is 0"
            raise UsageError(f"level {level} of {self.name} does not exist: {choice}")


def with_obstacles(task: Task, settings: Settings) -> Reward:
    """Return the weights of the reward of a task with obstacles, with the costs of being close to them."""
    given = settings.reward
    return replace(given, success=task.patience * given.success)


def generator(seed: int, vehicle: int, episode: int) -> np.random.Generator:
    """Return the random generator of the scene for one episode of one vehicle of a fleet.

    Args:
        seed: Seed of the fleet.
        vehicle: Index of the vehicle.
        episode: Number of the episode.
    """
    return np.random.default_rng([seed, vehicle, episode])


def open_water(settings: Settings, rng: np.random.Generator) -> Scene:
    """Return a random scene without pillars; the goal is at a random place relative to the start."""
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
    """Return random depths of start and goal [m], at most one metre apart, within the settings' margins."""
    shallow, deep = settings.task.margin, settings.world.depth - settings.task.margin
    depth = rng.uniform(shallow, deep)
    return depth, min(max(depth + rng.uniform(-1.0, 1.0), shallow), deep)


def along(settings: Settings, ends: Array, pillars: Array, south: bool, rng: np.random.Generator) -> Scene:
    """Return a scene whose course leads along the tank, from one end to the other.

    Args:
        settings: Greatest angle between the course and the initial heading.
        ends: South and north end of the course (2, 3), NED [m].
        pillars: x y of the pillars' axes (P, 2) [m].
        south: Whether the course leads from the north end to the south end.
        rng: Generator of the initial heading.
    """
    start, goal = ends[::-1] if south else ends
    heading = np.pi * south + rng.uniform(-settings.task.slant, settings.task.slant)
    return Scene(start, float(heading), goal[None], pillars)


def nowhere() -> Array:
    """Return an array of pillars without any row, (0, 2)."""
    return np.empty((0, 2))
