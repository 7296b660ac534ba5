"""Point-to-point task in open water: the first stage of the curriculum."""

from __future__ import annotations

import numpy as np

from hydro.rl.tasks.task import Scene, Task, open_water
from hydro.rl.world.config import Settings


class PointToPoint(Task):
    """Random start, heading and goal in open water."""

    name = "point_to_point"

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a scene with random start, heading and goal."""
        return open_water(settings, rng)
