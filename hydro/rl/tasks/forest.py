"""A forest of pillars at random, with a planned way to follow: the third stage of the curriculum."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from hydro.core.columns import Array
from hydro.core.errors import UsageError
from hydro.rl.tasks.task import Scene, Task, along, depths, open_water, with_obstacles
from hydro.rl.world.config import Reward, Settings
from hydro.rl.world.planner import Grid

TRIES = 200


class Forest(Task):
    """Pillars at random places, from one end of the tank to the other, along a plan.

    There is a way that keeps the planner's whole margin from pillars and walls, and the straight line is
    blocked.
    """

    name = "forest"
    levels = "pillars"
    most = 20
    guided = True
    patience = 2.0

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Start and goal at the ends of the tank, pillars in between by throwing darts, until all holds.

        Raises:
            UsageError: No such forest is found.
        """
        if level == 0:
            return open_water(settings, rng)
        task, world = settings.task, settings.world
        grid = Grid(world.length, world.width)
        for _ in range(TRIES):
            south = bool(rng.random() < 0.5)
            sides = rng.uniform(task.margin, world.width - task.margin, 2)
            depth, other = depths(settings, rng)
            ends = np.array([[task.margin, sides[0], depth], [world.length - task.margin, sides[1], other]])
            pillars = _darts(settings, level, ends[:, :2], rng)
            if len(pillars) < level or not _blocked(settings, pillars, ends[:, :2]):
                continue
            if _leads(grid, world.pillar_radius, pillars, ends[:, :2]):
                return along(settings, ends, pillars, south, rng)
        raise UsageError(
            f"no forest of {level} pillars with a way through it is found: take fewer, or less "
            "settings.forest.spacing"
        )

    def reward(self, settings: Settings) -> Reward:
        """With costs of nearness."""
        return with_obstacles(self, settings)


def _darts(settings: Settings, count: int, ends: Array, rng: np.random.Generator) -> Array:
    """Axes at random (P, 2), none too near to another or to an end (2, 2); fewer where there is no room."""
    world, forest = settings.world, settings.forest
    found = np.empty((0, 2))
    for dart in rng.uniform(world.pillar_radius, [world.length, world.width], (40 * count, 2)):
        near = np.hypot(*(found - dart).T).min(initial=np.inf) < forest.spacing
        if not near and np.hypot(*(ends - dart).T).min() >= forest.clear:
            found = np.vstack([found, dart])
            if len(found) == count:
                break
    return found


def _blocked(settings: Settings, pillars: Array, ends: Array) -> bool:
    """Whether a pillar stands in the straight line from end to end (2, 2)."""
    way = ends[1] - ends[0]
    share = np.clip((pillars - ends[0]) @ way / (way @ way), 0.0, 1.0)
    off = np.hypot(*(ends[0] + share[:, None] * way - pillars).T)
    return bool(off.min() < settings.forest.blocked)


def _leads(grid: Grid, radius: float, pillars: Array, ends: Array) -> bool:
    """Whether a way with the whole margin leads from end to end (2, 2).

    Both then lie in one piece of the free cells. Cells that touch at a corner alone are not joined, as the
    planner has it.
    """
    pieces, _ = ndimage.label(grid.free(pillars, radius))
    first, last = (pieces[grid.of(end)] for end in ends)
    return bool(first == last != 0)
