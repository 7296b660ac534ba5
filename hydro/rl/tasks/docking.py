"""Docking task: arrive slowly, level and with the bow to the north."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro.rl.tasks.task import Ends, Scene, Task, nowhere
from hydro.rl.world.config import Reward, Settings

HASTE = 0.1
"""Weight of each m/s above the allowed speed."""


class Docking(Task):
    """Task: arrive at a dock level, with the bow to the north, and below a speed limit.

    Observations do not contain the heading of the dock, so all docks have the same.
    """

    name = "docking"

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a scene with the dock at a random place, and a start south of it with a random heading."""
        task, world, docking = settings.task, settings.world, settings.docking
        low = np.full(3, task.margin)
        high = np.array([world.length, world.width, world.depth]) - task.margin
        while True:
            dock = rng.uniform(low, high)
            bearing = np.pi + rng.uniform(-docking.bearing, docking.bearing)
            away = rng.uniform(task.least, task.most)
            start = dock + away * np.array([np.cos(bearing), np.sin(bearing), 0.0])
            start[2] += rng.uniform(-1.0, 1.0)
            if (start >= low).all() and (start <= high).all():
                return Scene(start, rng.uniform(-np.pi, np.pi), dock[None], nowhere())

    def reward(self, settings: Settings) -> Reward:
        """Return the weights of an open-water task, with an alignment reward and a cost of haste.

        The alignment takes half of the weight of the heading reward.
        """
        given = super().reward(settings)
        half = 0.5 * given.heading
        return replace(given, heading=half, alignment=half, haste=HASTE)

    def ends(self, settings: Settings) -> Ends:
        """Return the end conditions, which also limit tilt, speed and angular velocity at the dock."""
        given = settings.docking
        return Ends(self.steps(settings), given.within, given.tilt, given.speed, given.turning)
