"""Forest task: fly through pillars at random places along a planned path; third stage of the curriculum."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from hydro.core.columns import Array
from hydro.core.errors import UsageError
from hydro.rl.tasks.task import Scene, Task, along, depths, open_water, with_obstacles
from hydro.rl.world.config import Reward, Settings
from hydro.rl.world.planner import Grid

TRIES = 200  # greatest number of forests drawn until one meets all conditions


class Forest(Task):
    """Task: fly through pillars at random places between both ends of the tank, along a planned path.

    A path that keeps the full margin of the planner exists, and a pillar blocks the straight line.
    """

    name = "forest"
    levels = "pillars"
    most = 20
    guided = True
    patience = 2.0

    def scene(self, settings: Settings, level: int, rng: np.random.Generator) -> Scene:
        """Return a random scene with start and goal at the ends of the tank and a forest of pillars.

        A path with the planner's full margin exists, and a pillar blocks the straight line.

        Args:
            settings: Sizes of tank, course and forest.
            level: Number of pillars; 0 gives open water.
            rng: Generator of the random numbers.

        Raises:
            UsageError: No such forest was found.
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
            pillars = _random_pillars(settings, level, ends[:, :2], rng)
            if len(pillars) < level or not _blocked(settings, pillars, ends[:, :2]):
                continue
            if _connected(grid, world.pillar_radius, pillars, ends[:, :2]):
                return along(settings, ends, pillars, south, rng)
        raise UsageError(
            f"no forest of {level} pillars with a path through it was found: take fewer pillars, or reduce "
            "settings.forest.spacing"
        )

    def reward(self, settings: Settings) -> Reward:
        """Return the weights of the reward's terms, including the costs of being close to obstacles."""
        return with_obstacles(self, settings)


def _random_pillars(settings: Settings, count: int, ends: Array, rng: np.random.Generator) -> Array:
    """Draw random axes of pillars (P, 2) [m], NED, that keep their distances from each other and from `ends`.

    P is less than `count` if the tank is full.

    Args:
        settings: Sizes of the tank and least distances.
        count: Wanted number of pillars.
        ends: North and east of start and goal (2, 2) [m].
        rng: Random generator.
    """
    world, forest = settings.world, settings.forest
    found = np.empty((0, 2))
    for place in rng.uniform(world.pillar_radius, [world.length, world.width], (40 * count, 2)):
        near = np.hypot(*(found - place).T).min(initial=np.inf) < forest.spacing
        if not near and np.hypot(*(ends - place).T).min() >= forest.clear:
            found = np.vstack([found, place])
            if len(found) == count:
                break
    return found


def _blocked(settings: Settings, pillars: Array, ends: Array) -> bool:
    """Return whether a pillar (P, 2) blocks the straight line between start and goal, `ends` (2, 2) [m]."""
    way = ends[1] - ends[0]
    share = np.clip((pillars - ends[0]) @ way / (way @ way), 0.0, 1.0)
    off = np.hypot(*(ends[0] + share[:, None] * way - pillars).T)
    return bool(off.min() < settings.forest.blocked)


def _connected(grid: Grid, radius: float, pillars: Array, ends: Array) -> bool:
    """Return whether a path with the full margin connects start and goal, the rows of `ends` (2, 2) [m].

    A path exists if both lie in the same connected component of free cells.  Cells that touch only at a
    corner are not connected, as in the planner.
    """
    pieces, _ = ndimage.label(grid.free(pillars, radius))
    first, last = (pieces[grid.of(end)] for end in ends)
    return bool(first == last != 0)
