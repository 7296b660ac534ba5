"""Slalom task between baffles: the second stage of the curriculum."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import UsageError
from hydro.rl.tasks.task import Scene, Task, along, depths, open_water, with_obstacles
from hydro.rl.world.config import Reward, Settings


class Slalom(Task):
    """Task: pass baffles (walls of pillars) that start alternately from both long walls of the tank.

    Each baffle reaches past the middle of the tank.
    """

    name = "slalom"
    levels = "baffles"
    most = 4
    patience = 2.0

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a random scene with baffles across a course to north or south, at random distances.

        Args:
            settings: Sizes of tank, course and baffles.
            level: Number of baffles; 0 gives open water.
            rng: Generator of the random numbers.

        Raises:
            UsageError: The tank is too short for that many baffles.
        """
        if level == 0:
            return open_water(settings, rng)
        task, world, slalom = settings.task, settings.world, settings.slalom
        spare = world.length - 2.0 * (task.margin + slalom.run_up) - (level - 1) * slalom.spacing
        if spare < 0.0:
            raise UsageError(
                f"a slalom of {level} baffles needs a tank {-spare:.3g} m longer: lengthen world.length, or "
                "take fewer baffles"
            )
        south = bool(rng.random() < 0.5)
        # The spare length is shared by the gaps: before the first baffle, between them, and behind the last.
        gaps = np.diff(np.r_[0.0, np.sort(rng.uniform(0.0, spare, level)), spare])
        north = task.margin + slalom.run_up + np.cumsum(gaps[:-1]) + slalom.spacing * np.arange(level)
        from_west = (np.arange(level) + rng.integers(2)) % 2 == 0
        pillars = np.concatenate(
            [
                _baffle(settings, x, float(rng.uniform(*slalom.reach)), west)
                for x, west in zip(north, from_west, strict=True)
            ]
        )
        shy = task.margin + 1.0  # distance from the side walls [m], for room to turn
        sides = rng.uniform(shy, world.width - shy, 2)
        depth, other = depths(settings, rng)
        ends = np.array([[task.margin, sides[0], depth], [world.length - task.margin, sides[1], other]])
        return along(settings, ends, pillars, south, rng)

    def reward(self, settings: Settings) -> Reward:
        """Return the weights of the reward's terms, including the costs of being close to obstacles."""
        return with_obstacles(self, settings)


def _baffle(settings: Settings, north: float, reach: float, from_west: bool) -> Array:
    """Return north and east of the axes of the P pillars of one baffle (P, 2) [m].

    Args:
        settings: Radius and spacing of the pillars, width of the tank.
        north: North coordinate of the baffle [m].
        reach: Length of the baffle from its wall [m].
        from_west: Whether the baffle starts at the west wall.
    """
    radius, gap = settings.world.pillar_radius, settings.slalom.gap
    east = np.arange(reach - radius, -radius, -gap)[::-1]
    return np.column_stack([np.full(len(east), north), east if from_west else settings.world.width - east])
