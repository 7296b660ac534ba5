"""Station-keeping task: hold a position in a current."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro.rl.tasks.task import Ends, Scene, Task, nowhere
from hydro.rl.world.config import Reward, Settings

CLEAR = 1.5
"""Distance of the station from floor, surface and walls, beyond the margin of the start [m]."""
HOLD = 0.05
"""Weight of the distance from a goal that is held or followed."""


class StationKeeping(Task):
    """Task: hold a position in open water against a current until the end of the episode."""

    name = "station_keeping"

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a random scene: position to hold, current, and a start nearby.

        Args:
            settings: Sizes of tank and current.
            level: Not used.
            rng: Generator of the random numbers.
        """
        world, station = settings.world, settings.station
        size = np.array([world.length, world.width, world.depth])
        margin = settings.task.margin
        place = rng.uniform(np.full(3, margin + CLEAR), size - margin - CLEAR)
        way = rng.standard_normal(3)
        start = place + rng.uniform(0.0, station.away) * way / np.linalg.norm(way)
        start = np.clip(start, margin, size - margin)
        towards, speed = rng.uniform(-np.pi, np.pi), rng.uniform(*station.current)
        current = speed * np.array([np.cos(towards), np.sin(towards), 0.0])
        return Scene(start, rng.uniform(-np.pi, np.pi), place[None], nowhere(), current)

    def reward(self, settings: Settings) -> Reward:
        """Return the weights of an open-water task, with a cost of the distance and no heading reward."""
        return replace(super().reward(settings), hold=HOLD, heading=0.0)

    def ends(self, settings: Settings) -> Ends:
        """Return the end conditions of an episode.

        The root mean square error after the settling time decides success.
        """
        station = settings.station
        return Ends(self.steps(settings), station.within, settling=station.settling / settings.period)
