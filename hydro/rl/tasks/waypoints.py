"""Waypoint task: pass waypoints along the tank one after another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro.core.columns import Array
from hydro.rl.tasks.task import Ends, Scene, Task, nowhere
from hydro.rl.world.config import Reward, Settings


class WaypointCourse(Task):
    """Task: pass waypoints in order; the next waypoint becomes the goal when the vehicle is near enough.

    A vehicle that steers with fins needs a tank several turning circles wide, see `config.Waypoints`.
    """

    name = "waypoints"

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a random scene with waypoints along the tank; the bow points about to the first waypoint.

        Args:
            settings: Sizes of tank and course.
            level: Not used.
            rng: Generator of the random numbers.
        """
        course = settings.waypoints
        low, high = limits(settings)
        legs = rng.uniform(*leg_lengths(settings), course.count)
        run = legs.sum()
        south = bool(rng.random() < 0.5)
        sign = -1.0 if south else 1.0
        first = rng.uniform(low[0], high[0] - run)
        here = np.array([first + run * south, *rng.uniform(low[1:], high[1:])])
        points = [here]
        for length in legs:
            bearing = rng.uniform(-course.turn, course.turn)
            step = length * np.array([sign * np.cos(bearing), np.sin(bearing), 0.0])
            if not low[1] <= here[1] + step[1] <= high[1]:  # away from the wall
                step[1] = -step[1]
            step[2] = rng.uniform(-course.slope, course.slope) * length
            here = np.clip(here + step, low, high)
            points.append(here)
        way = points[1] - points[0]
        heading = np.arctan2(way[1], way[0]) + rng.uniform(-settings.task.slant, settings.task.slant)
        return Scene(points[0], float(heading), np.array(points[1:]), nowhere(), passed=nearness(settings))

    def steps(self, settings: Settings) -> int:
        """Return the number of control steps for the longest course at the allowed pace."""
        course = settings.waypoints
        return round(course.count * leg_lengths(settings)[1] / course.pace / settings.period)

    def reward(self, settings: Settings) -> Reward:
        """Return the weights of a task without obstacles; the success reward grows with the time limit."""
        given = settings.reward
        times = max(1.0, self.steps(settings) / settings.task.steps)
        return replace(given, obstacle=0.0, near=0.0, success=times * given.success)

    def ends(self, settings: Settings) -> Ends:
        """Return the end conditions of an episode.

        The last waypoint is reached at the distance of all waypoints.
        """
        return Ends(self.steps(settings), nearness(settings))


def limits(settings: Settings) -> tuple[Array, Array]:
    """Return the least and greatest coordinates of waypoints, (3,) each, NED [m]."""
    world, margin = settings.world, settings.task.margin
    size = np.array([world.length, world.width, world.depth])
    low = margin + np.minimum(settings.waypoints.clear, 0.25 * (size - 2.0 * margin))
    return low, size - low


def leg_lengths(settings: Settings) -> tuple[float, float]:
    """Return the least and greatest distance of successive waypoints [m], shortened to fit the tank."""
    course = settings.waypoints
    low, high = limits(settings)
    share = min(1.0, float(high[0] - low[0]) / (course.count * course.leg[1]))
    return share * course.leg[0], share * course.leg[1]


def nearness(settings: Settings) -> float:
    """Return the distance at which a waypoint is passed [m]: at most a quarter of the shortest leg."""
    return min(settings.waypoints.within, 0.25 * leg_lengths(settings)[0])
