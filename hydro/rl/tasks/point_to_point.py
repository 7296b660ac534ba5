"""Point-to-point task in open water: the first stage of the curriculum."""

from __future__ import annotations

import numpy as np

from hydro.rl.tasks.task import Scene, Task, open_water
from hydro.rl.world.config import Settings


class PointToPoint(Task):
    """Task: reach a random goal in open water from a random start and heading."""

    name = "point_to_point"

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a random scene without pillars: start, heading and goal.

        Args:
            settings: Sizes of tank and course.
            level: Not used.
            rng: Generator of the random numbers.
        """
        return open_water(settings, rng)
