"""Trajectory-tracking tasks: follow a point along a circle, a helix or a lemniscate."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace

import numpy as np

from hydro.core.columns import Array
from hydro.rl.tasks.station_keeping import HOLD
from hydro.rl.tasks.task import Ends, Scene, Task, nowhere
from hydro.rl.world.config import Reward, Settings

CORNERS = 4000  # corners of a figure; its length is the sum of their distances
START_DISTANCE = 0.5  # greatest distance of the start from the point [m]


class Trajectory(Task):
    """Task: follow a point that moves at constant speed along a figure.

    The target in the observation is the future position of the point.
    """

    patience = 2.0

    @abstractmethod
    def figure(self, settings: Settings, rng: np.random.Generator) -> Array:
        """Return random corners of the figure (CORNERS, 3) about the origin, NED [m].

        A figure is closed if its last corner lies next to the first; otherwise the point returns the same
        way.

        Args:
            settings: Sizes of tank and figure.
            rng: Generator of the random numbers.
        """

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a random scene: figure, its position and speed; the vehicle starts near the moving point.

        Its bow points about along the figure.

        Args:
            settings: Sizes of tank and figure.
            level: Not used.
            rng: Generator of the random numbers.
        """
        world, task = settings.world, settings.task
        corners = self.figure(settings, rng)
        turn, shift = rng.choice([-1.0, 1.0]), rng.integers(CORNERS)
        corners = np.roll(corners, shift, axis=0)[:: int(turn)] if self._closed(corners) else corners
        room = np.array([world.length, world.width, world.depth]) - task.margin
        centre = rng.uniform(task.margin - corners.min(axis=0), room - corners.max(axis=0))
        course = centre + self._at_constant_speed(settings, corners, rng.uniform(*settings.trajectory.speed))
        ahead = course[min(25, len(course) - 1)] - course[0]
        heading = np.arctan2(ahead[1], ahead[0]) + rng.uniform(-task.slant, task.slant)
        start = course[0] + rng.uniform(-START_DISTANCE, START_DISTANCE, 3) / np.sqrt(3.0)
        return Scene(start, float(heading), course, nowhere())

    def _at_constant_speed(self, settings: Settings, corners: Array, speed: float) -> Array:
        """Return positions of the point to follow at every control step (K, 3) [m], round after round.

        Args:
            settings: Control step and time limit.
            corners: Corners of the figure (CORNERS, 3) [m].
            speed: Speed of the point [m/s].
        """
        lead = round(settings.trajectory.lead / settings.period)
        steps = self.steps(settings) + lead + 1
        closed = (
            np.vstack([corners, corners[:1]])
            if self._closed(corners)
            else np.vstack([corners, corners[::-1]])
        )
        length = np.r_[0.0, np.linalg.norm(np.diff(closed, axis=0), axis=1).cumsum()]
        place = (speed * settings.period * np.arange(steps)) % length[-1]
        return np.column_stack([np.interp(place, length, closed[:, axis]) for axis in range(3)])

    @staticmethod
    def _closed(corners: Array) -> bool:
        """Return whether a figure ends where it begins."""
        step = np.linalg.norm(corners[1] - corners[0])
        return bool(np.linalg.norm(corners[-1] - corners[0]) < 2.0 * step)

    def lead(self, settings: Settings) -> float:
        """Return the time by which the target is ahead of the moving point [s].

        With this time a proportional controller keeps up with the point.
        """
        return settings.trajectory.lead

    def reward(self, settings: Settings) -> Reward:
        """Return the weights of an open-water task, with a cost of the distance from the moving point."""
        return replace(super().reward(settings), hold=HOLD)

    def ends(self, settings: Settings) -> Ends:
        """Return the end conditions of an episode.

        The root mean square error after the settling time decides success.
        """
        given = settings.trajectory
        return Ends(self.steps(settings), given.within, settling=given.settling / settings.period)


def _circle(settings: Settings, rng: np.random.Generator) -> Array:
    """Draw one round of a horizontal circle (CORNERS, 3) [m]."""
    angle = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    radius = rng.uniform(*settings.trajectory.radius)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(CORNERS)])


class Circle(Trajectory):
    """Task: follow a point along a horizontal circle."""

    name = "circle"

    def figure(self, settings: Settings, rng: np.random.Generator) -> Array:
        """Return one round of a circle with random radius about the origin, (CORNERS, 3), NED [m]."""
        return _circle(settings, rng)


class Helix(Trajectory):
    """Task: follow a point along a helix down or up through the water, and back."""

    name = "helix"

    def figure(self, settings: Settings, rng: np.random.Generator) -> Array:
        """Return two rounds of a helix between depths that fit into the tank, (CORNERS, 3), NED [m]."""
        round_ = _circle(settings, rng)[::2]
        twice = np.vstack([round_, round_])
        room = settings.world.depth - 2.0 * settings.task.margin
        twice[:, 2] = (
            rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 0.9) * room * np.linspace(-0.5, 0.5, len(twice))
        )
        return twice


class Lemniscate(Trajectory):
    """Task: follow a point along a horizontal figure of eight, the lemniscate of Gerono."""

    name = "lemniscate"

    def figure(self, settings: Settings, rng: np.random.Generator) -> Array:
        """Return one round of the lemniscate, long along the tank, (CORNERS, 3), NED [m]."""
        angle = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
        half = rng.uniform(*settings.trajectory.half)
        return np.column_stack(
            [half * np.sin(angle), half * np.sin(angle) * np.cos(angle), np.zeros(CORNERS)]
        )
