"""Path following: a smoothed point ahead on a planned path, and the cross-track cost."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask
from hydro.core.compiled import jit
from hydro.rl.environment.reward import cross_track_cost
from hydro.rl.world.config import Settings
from hydro.rl.world.planner import Grid, plan

State = dict[str, NDArray[np.generic]]

ALPHA = 0.15
"""Weight of the new point ahead in the exponential moving average, per control step."""
SEARCH_BACK, SEARCH_AHEAD = 1.0, 5.0
"""Search window for the nearest point, behind and ahead of the last one along the path [m].

The window is limited because a path may cross itself.
"""


class Guidance:
    """Planned paths of N vehicles, and the progress of each along its path.

    Attributes:
        ways: The K corners of the path of each vehicle, (N, K, 3), NED [m]; shorter paths repeat their last
            corner.
        off: Distance of each vehicle from its path at the last call of `targets` (N,) [m].
    """

    def __init__(self, settings: Settings, count: int, margin: float = Grid.margin) -> None:
        """Allocate the paths of `count` vehicles in the world of the settings.

        Args:
            settings: All choices.
            count: Number of vehicles N.
            margin: Distance that paths keep from the surface of pillars, if there is room [m].
        """
        self._lead = settings.task.ahead
        self._world, self._weight = settings.world, settings.reward.path
        self._grid = Grid(settings.world.length, settings.world.width, margin=margin)
        self.ways = np.zeros((count, 2, 3))
        self.off, self._along = np.zeros(count), np.zeros(count)
        self._ahead = np.full((count, 3), np.nan)

    def reset(self, mask: Mask, starts: Array, goals: Array, pillars: Array) -> None:
        """Plan new paths from start to goal, around pillars, for the vehicles of a mask.

        Args:
            mask: Vehicles that get a new path (N,).
            starts: Starts (N, 3), NED [m].
            goals: Goals (N, 3), NED [m].
            pillars: North and east of the pillars' axes (N, P, 2) [m], NaN in unused rows.
        """
        for k in np.flatnonzero(mask):
            way = plan(self._grid, starts[k], goals[k], pillars[k], self._world.pillar_radius)
            if (more := len(way) - self.ways.shape[1]) > 0:
                self.ways = np.pad(self.ways, ((0, 0), (0, more), (0, 0)), mode="edge")
            self.ways[k, : len(way)], self.ways[k, len(way) :] = way, way[-1]
        self._along[mask], self._ahead[mask] = 0.0, np.nan

    def targets(self, mask: Mask, positions: Array) -> tuple[Array, Array]:
        """Advance the vehicles of a mask along their paths by one control step; return their target points.

        Args:
            mask: Vehicles that advance (N,).
            positions: Positions of CO (N, 3), NED [m].

        Returns:
            Smoothed points ahead (N, 3), NED [m], and weighted cross-track costs (N,) (eq. 9 of Wu et al.).
            Rows outside the mask have no meaning.
        """
        cost = np.zeros(len(positions))
        places = np.ascontiguousarray(positions)  # the kernel is compiled again for each layout of an array
        follow_kernel(mask, places, self.ways, self._along, self._ahead, self.off, cost, self._lead)
        return self._ahead.copy(), self._weight * cost

    def state(self) -> State:
        """Return the complete state as arrays by name, for `restore`."""
        return {"ways": self.ways.copy(), "along": self._along.copy(), "ahead": self._ahead.copy()}

    def restore(self, state: State) -> None:
        """Set the state that `state` returned, and continue bit for bit."""
        kept = (np.array(state[name], dtype=np.float64) for name in ("ways", "along", "ahead"))
        self.ways, self._along, self._ahead = kept


@jit
def follow_kernel(
    mask: Mask,
    positions: Array,
    ways: Array,
    along: Array,
    ahead: Array,
    off: Array,
    cost: Array,
    lead: float,
) -> None:
    """Update, for every vehicle, the position along its path and the smoothed point ahead on the path.

    Args:
        mask: Vehicles to update (N,).
        positions: Positions of CO (N, 3), NED [m].
        ways: The K corners of each path (N, K, 3), NED [m].
        along: Arc length of each vehicle on its path (N,) [m]; rewritten.
        ahead: Smoothed points ahead (N, 3), NED [m], NaN at the beginning; rewritten.
        off: Distances from the paths (N,) [m], written.
        cost: Unweighted cross-track costs (N,), written.
        lead: Arc length from a vehicle to the point ahead [m].
    """
    point = np.empty(3)
    for k in range(len(mask)):
        if not mask[k]:
            continue
        off[k], along[k] = nearest(ways[k], positions[k], along[k] - SEARCH_BACK, along[k] + SEARCH_AHEAD)
        cost[k] = cross_track_cost(off[k])
        point_at(ways[k], along[k] + lead, point)
        for i in range(3):
            if math.isnan(ahead[k, i]):
                ahead[k, i] = point[i]
            ahead[k, i] += ALPHA * (point[i] - ahead[k, i])


@jit
def nearest(way: Array, position: Array, low: float, high: float) -> tuple[float, float]:
    """Return the point of a path nearest to a position, within a range of arc lengths.

    Args:
        way: Corners of the path (K, 3), NED [m].
        position: (3,), NED [m].
        low: Least arc length of the point [m].
        high: Greatest arc length of the point [m].

    Returns:
        Distance from the position to that point, and the point's arc length [m].
    """
    best, where, begun = np.inf, 0.0, 0.0
    for k in range(len(way) - 1):
        step = way[k + 1] - way[k]
        length = math.sqrt((step**2).sum())
        first, last = max(low - begun, 0.0), min(high - begun, length)
        if length > 0.0 and first <= last:
            s = min(max(((position - way[k]) * step).sum() / length, first), last)
            off = math.sqrt(((way[k] + s / length * step - position) ** 2).sum())
            if off < best:
                best, where = off, begun + s
        begun += length
    return (best, where) if best < np.inf else (math.sqrt(((way[0] - position) ** 2).sum()), 0.0)


@jit
def point_at(way: Array, place: float, out: Array) -> None:
    """Write to `out` (3,) the point of a path `way` (K, 3) at the arc length `place` [m]; at most its end."""
    out[:] = way[-1]
    for k in range(len(way) - 1):
        step = way[k + 1] - way[k]
        length = math.sqrt((step**2).sum())
        if place < length:
            out[:] = way[k] + max(place, 0.0) / length * step
            return
        place -= length
