"""What leads vehicles along a planned way: a point ahead, and the cost of being off the way."""

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
"""Weight of the new point in the exponential moving average."""
BACK, ON = 1.0, 5.0
"""How far behind and ahead of where a vehicle was on its way it is looked for [m]: a way may cross itself."""


class Guidance:
    """Ways of many vehicles, and how far each has come on its own.

    Attributes:
        ways: Corners of every vehicle's way (N, K, 3), NED; the last is repeated.
        off: How far from its way each was when it was looked for last (N,) [m].
    """

    def __init__(self, settings: Settings, count: int, margin: float = Grid.margin) -> None:
        """Make room for the ways of `count` vehicles in the world of the settings.

        Args:
            settings: All choices.
            count: Number of vehicles N.
            margin: Distance that ways keep from the surface of pillars where there is room [m].
        """
        self._lead = settings.task.ahead
        self._world, self._weight = settings.world, settings.reward.path
        self._grid = Grid(settings.world.length, settings.world.width, margin=margin)
        self.ways = np.zeros((count, 2, 3))
        self.off, self._along = np.zeros(count), np.zeros(count)
        self._ahead = np.full((count, 3), np.nan)

    def reset(self, mask: Mask, starts: Array, goals: Array, pillars: Array) -> None:
        """Plan anew for some vehicles (N,): starts and goals (N, 3), NED, pillars (N, P, 2)."""
        for k in np.flatnonzero(mask):
            way = plan(self._grid, starts[k], goals[k], pillars[k], self._world.pillar_radius)
            if (more := len(way) - self.ways.shape[1]) > 0:
                self.ways = np.pad(self.ways, ((0, 0), (0, more), (0, 0)), mode="edge")
            self.ways[k, : len(way)], self.ways[k, len(way) :] = way, way[-1]
        self._along[mask], self._ahead[mask] = 0.0, np.nan

    def targets(self, mask: Mask, positions: Array) -> tuple[Array, Array]:
        """Go on by one control step.

        Args:
            mask: Which vehicles do, (N,).
            positions: (N, 3), NED.

        Returns:
            Smoothed points ahead (N, 3) and weighted costs of being off the way (N,), eq. 9; rows of the
            others are as good as any.
        """
        cost = np.zeros(len(positions))
        follow_kernel(mask, positions, self.ways, self._along, self._ahead, self.off, cost, self._lead)
        return self._ahead.copy(), self._weight * cost

    def state(self) -> State:
        """Everything that the future depends on."""
        return {"ways": self.ways.copy(), "along": self._along.copy(), "ahead": self._ahead.copy()}

    def restore(self, state: State) -> None:
        """Go back to a state, bit for bit."""
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
    """Move every vehicle's place on its way and the smoothed point ahead of it.

    Args:
        mask: Which vehicles, (N,).
        positions: (N, 3).
        ways: Corners (N, K, 3).
        along: Where on its way each was (N,) [m]; rewritten.
        ahead: Smoothed points ahead (N, 3), NaN at the beginning; rewritten.
        off: Distances to the ways (N,) [m], written.
        cost: (N,) written, without weight.
        lead: How far along the way the point ahead lies [m].
    """
    point = np.empty(3)
    for k in range(len(mask)):
        if not mask[k]:
            continue
        off[k], along[k] = nearest(ways[k], positions[k], along[k] - BACK, along[k] + ON)
        cost[k] = cross_track_cost(off[k])
        at(ways[k], along[k] + lead, point)
        for i in range(3):
            if math.isnan(ahead[k, i]):
                ahead[k, i] = point[i]
            ahead[k, i] += ALPHA * (point[i] - ahead[k, i])


@jit
def nearest(way: Array, position: Array, low: float, high: float) -> tuple[float, float]:
    """Distance to a way (K, 3), and where on it [m], of the nearest point between two places on it."""
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
def at(way: Array, place: float, out: Array) -> None:
    """The point of a way (K, 3) at a place [m]; its last beyond the end."""
    out[:] = way[-1]
    for k in range(len(way) - 1):
        step = way[k + 1] - way[k]
        length = math.sqrt((step**2).sum())
        if place < length:
            out[:] = way[k] + max(place, 0.0) / length * step
            return
        place -= length
