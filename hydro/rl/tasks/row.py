"""Pillar-row task: pillars on alternating sides of a straight course; the vehicle may go around them all."""

from __future__ import annotations

import numpy as np

from hydro.core.errors import UsageError
from hydro.rl.tasks.task import Scene, Task, along, depths, open_water, with_obstacles
from hydro.rl.world.config import Reward, Settings


class PillarRow(Task):
    """Task: pass a row of pillars, as many as the level, or go around the row."""

    name = "pillar_row"
    levels = "pillars"
    most = 8

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a random scene with pillars at equal distances, on alternating sides of a course.

        The course leads north or south along the tank.

        Args:
            settings: Sizes of tank, course and row.
            level: Number of pillars; 0 gives open water.
            rng: Generator of the random numbers.
        """
        if level == 0:
            return open_water(settings, rng)
        task, world, row = settings.task, settings.world, settings.row
        length = max(rng.uniform(task.least, task.most), course(settings, level))
        south = bool(rng.random() < 0.5)
        middle = rng.uniform(world.width / 3.0, 2.0 * world.width / 3.0)
        first = rng.uniform(task.margin, world.length - task.margin - length)
        depth, other = depths(settings, rng)

        places = (
            np.linspace(row.run_up, length - row.run_up, level) if level > 1 else np.array([0.5 * length])
        )
        sides = rng.choice([-1.0, 1.0]) * (-1.0) ** np.arange(level)
        pillars = np.column_stack(
            [first + (length - places if south else places), middle + sides * rng.uniform(*row.sway, level)]
        )
        ends = np.array([[first, middle, depth], [first + length, middle, other]])
        return along(settings, ends, pillars, south, rng)

    def reward(self, settings: Settings) -> Reward:
        """Return the weights of the reward's terms, including the costs of being close to obstacles."""
        return with_obstacles(self, settings)


def course(settings: Settings, pillars: int) -> float:
    """Return the least length of a course past `pillars` pillars, with the settings' spacing [m]; 0 for none.

    Raises:
        UsageError: The course is longer than the tank.
    """
    length = 2.0 * settings.row.run_up + (pillars - 1) * settings.row.spacing if pillars else 0.0
    room = settings.world.length - 2.0 * settings.task.margin
    if length > room:
        raise UsageError(
            f"a row of {pillars} pillars is {length:g} m long, and the tank leaves {room:g} m; lengthen "
            "world.length"
        )
    return length
