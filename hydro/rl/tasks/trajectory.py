"""Trajectory tracking: a point that moves along a circle, a helix or a lemniscate."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace

import numpy as np

from hydro.core.columns import Array
from hydro.rl.tasks.station_keeping import HOLD
from hydro.rl.tasks.task import Ends, Scene, Task, nowhere
from hydro.rl.world.config import Reward, Settings

FINE = 4000  # points along a figure by which its length is measured
BESIDE = 0.5  # greatest distance of the start from the point [m]


class Trajectory(Task):
    """A point to be followed at an even speed; what is shown for a target is where it will be."""

    patience = 2.0

    @abstractmethod
    def figure(self, settings: Settings, rng: np.random.Generator) -> Array:
        """The corners of one round of the figure (FINE, 3) about the origin, closed or not [m]."""

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Draw figure, place and speed; the vehicle begins beside the point, bow along the way."""
        world, task = settings.world, settings.task
        corners = self.figure(settings, rng)
        turn, shift = rng.choice([-1.0, 1.0]), rng.integers(FINE)
        corners = np.roll(corners, shift, axis=0)[:: int(turn)] if self._closed(corners) else corners
        room = np.array([world.length, world.width, world.depth]) - task.margin
        centre = rng.uniform(task.margin - corners.min(axis=0), room - corners.max(axis=0))
        course = centre + self._even(settings, corners, rng.uniform(*settings.trajectory.speed))
        ahead = course[min(25, len(course) - 1)] - course[0]
        heading = np.arctan2(ahead[1], ahead[0]) + rng.uniform(-task.slant, task.slant)
        start = course[0] + rng.uniform(-BESIDE, BESIDE, 3) / np.sqrt(3.0)
        return Scene(start, float(heading), course, nowhere())

    def _even(self, settings: Settings, corners: Array, speed: float) -> Array:
        """Where the point is at every control step (K, 3), round after round at one speed [m/s]."""
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
        """Whether a figure ends where it begins."""
        step = np.linalg.norm(corners[1] - corners[0])
        return bool(np.linalg.norm(corners[-1] - corners[0]) < 2.0 * step)

    def lead(self, settings: Settings) -> float:
        """By which a proportional law does not lag behind."""
        return settings.trajectory.lead

    def reward(self, settings: Settings) -> Reward:
        """With a cost of the distance."""
        return replace(super().reward(settings), hold=HOLD)

    def ends(self, settings: Settings) -> Ends:
        """The error counts once the vehicle has gathered way."""
        given = settings.trajectory
        return Ends(self.steps(settings), given.within, settling=given.settling / settings.period)


def _circle(settings: Settings, rng: np.random.Generator) -> Array:
    """One round of a level circle (FINE, 3)."""
    angle = np.linspace(0.0, 2.0 * np.pi, FINE, endpoint=False)
    radius = rng.uniform(*settings.trajectory.radius)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(FINE)])


class Circle(Trajectory):
    """A level circle."""

    name = "circle"

    def figure(self, settings: Settings, rng: np.random.Generator) -> Array:
        """One round."""
        return _circle(settings, rng)


class Helix(Trajectory):
    """A helix down or up through the water, and back."""

    name = "helix"

    def figure(self, settings: Settings, rng: np.random.Generator) -> Array:
        """Two rounds of a circle between the depths that the tank allows."""
        round_ = _circle(settings, rng)[::2]
        twice = np.vstack([round_, round_])
        room = settings.world.depth - 2.0 * settings.task.margin
        twice[:, 2] = (
            rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 0.9) * room * np.linspace(-0.5, 0.5, len(twice))
        )
        return twice


class Lemniscate(Trajectory):
    """A level figure of eight, that of Gerono."""

    name = "lemniscate"

    def figure(self, settings: Settings, rng: np.random.Generator) -> Array:
        """One round, long ways along the tank."""
        angle = np.linspace(0.0, 2.0 * np.pi, FINE, endpoint=False)
        half = rng.uniform(*settings.trajectory.half)
        return np.column_stack([half * np.sin(angle), half * np.sin(angle) * np.cos(angle), np.zeros(FINE)])
