"""A* path planner around pillars on a grid (Wu et al., III-D): 0.05 m cells, 1.2 m margin, 8 neighbours."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.errors import DataError, UsageError

Cells = NDArray[np.bool_]

RELAXED = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Shares of the margin that are tried in turn until a path exists."""

_NEIGHBOURS = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]])


@dataclass(frozen=True)
class Grid:
    """Settings of the planner's grid of cells in the horizontal plane.

    Attributes:
        length: Extent north, from 0 [m].
        width: Extent east, from 0 [m].
        cell: Edge of a cell [m].
        margin: Distance kept from the surface of pillars [m].
        wall: Distance kept from the walls [m].
    """

    length: float
    width: float
    cell: float = 0.05
    margin: float = 1.2
    wall: float = 0.6

    def __post_init__(self) -> None:
        """Check that the grid has cells.

        Raises:
            UsageError: An extent or the cell is not positive, or a margin is negative.
        """
        sizes = self.length, self.width, self.cell
        if not (all(each > 0.0 for each in sizes) and self.margin >= 0.0 and self.wall >= 0.0):
            raise UsageError("a grid needs length, width and cell above 0 m, and no negative margin")

    @property
    def shape(self) -> tuple[int, int]:
        """Number of cells north and east."""
        return math.ceil(self.length / self.cell - 1e-9), math.ceil(self.width / self.cell - 1e-9)

    def of(self, place: ArrayLike) -> tuple[int, int]:
        """Return the indices, north and east, of the cell at a position x, y [m] or nearest to it."""
        x, y = np.clip(np.floor(np.asarray(place, float) / self.cell), 0, np.array(self.shape) - 1)
        return int(x), int(y)

    def centres(self, cells: NDArray[np.int64]) -> Array:
        """Return the centres x, y [m] (K, 2) of K cells, given by their indices (K, 2)."""
        places: Array = self.cell * (cells.astype(np.float64) + 0.5)
        return places

    def free(self, pillars: Array, radius: float, share: float = 1.0) -> Cells:
        """Return a mask (X, Y) of the cells whose centres keep their distance from pillars and walls.

        Args:
            pillars: x y of the pillars' axes (P, 2) [m].
            radius: Radius of the pillars [m].
            share: Factor on both margins, `margin` and `wall`.
        """
        x, y = (self.cell * (np.arange(count, dtype=np.float64) + 0.5) for count in self.shape)
        wall = share * self.wall
        inside = ((x >= wall) & (x <= self.length - wall))[:, None] & ((y >= wall) & (y <= self.width - wall))
        _clear_of(inside, x, y, np.asarray(pillars, float), radius + share * self.margin)
        return inside


@jit
def _clear_of(free: Cells, x: Array, y: Array, pillars: Array, apart: float) -> None:
    """Mark cells closer than `apart` [m] to a pillar (P, 2) as occupied in `free` (X, Y).

    x (X,) and y (Y,) are the coordinates of the cell centres [m].
    """
    for p in range(len(pillars)):
        first, last = np.searchsorted(x, pillars[p, 0] - apart), np.searchsorted(x, pillars[p, 0] + apart)
        low, high = np.searchsorted(y, pillars[p, 1] - apart), np.searchsorted(y, pillars[p, 1] + apart)
        for i in range(max(first - 1, 0), min(last + 1, len(x))):
            for j in range(max(low - 1, 0), min(high + 1, len(y))):
                if (x[i] - pillars[p, 0]) ** 2 + (y[j] - pillars[p, 1]) ** 2 < apart**2:
                    free[i, j] = False


def plan(grid: Grid, start: ArrayLike, goal: ArrayLike, pillars: ArrayLike, radius: float) -> Array:
    """Return the shortest path around pillars; its depth changes linearly from start to goal.

    If the full margin leaves no path, or start or goal lie within it, the planner multiplies the margins by
    the greatest factor in `RELAXED` that gives a path.

    Args:
        grid: Cells and margins.
        start: Position of the start (3,), NED [m].
        goal: Position of the goal (3,), NED [m].
        pillars: Axes x, y (P, 2) [m]; rows of NaN are ignored.
        radius: Radius of the pillars [m].

    Returns:
        Corners of the path (K, 3), NED [m], K >= 2, from start to goal.  Corners are dropped where a straight
        line keeps the margin, up to one cell.

    Raises:
        DataError: No path exists without any margin.
    """
    start, goal = np.asarray(start, float), np.asarray(goal, float)
    standing = np.asarray(pillars, float)
    standing = np.ascontiguousarray(standing[np.isfinite(standing).all(axis=1)])
    if _clear(start[:2], goal[:2], standing, radius + grid.margin - grid.cell):
        return _with_depth(np.stack([start[:2], goal[:2]]), start[2], goal[2])
    for share in RELAXED:
        free = grid.free(standing, radius, share)
        cells = astar(free, grid.of(start[:2]), grid.of(goal[:2]))
        if len(cells):
            way = np.concatenate([start[None, :2], grid.centres(cells[1:-1]), goal[None, :2]])
            apart = radius + share * grid.margin - grid.cell
            return _with_depth(way[shorten_kernel(way, standing, apart)], start[2], goal[2])
    raise DataError("no path leads around the pillars from start to goal: leave more room between them")


def astar(free: Cells, start: tuple[int, int], goal: tuple[int, int]) -> NDArray[np.int64]:
    """Return the indices (K, 2) of the cells on a shortest path between two cells; empty if no path exists.

    A cell has eight neighbours.  A diagonal step costs sqrt(2) and requires both adjacent cells to be free.

    Args:
        free: Mask of the free cells (X, Y).
        start: Indices of the first cell.
        goal: Indices of the last cell.
    """
    return astar_kernel(free, _NEIGHBOURS, start[0], start[1], goal[0], goal[1])


@jit
def astar_kernel(
    free: Cells, neighbours: NDArray[np.int64], sx: int, sy: int, gx: int, gy: int
) -> NDArray[np.int64]:
    """Return the indices (K, 2) of the cells on a shortest path; the compiled part of `astar`.

    The octile heuristic is consistent, so a cell taken from the heap is final.

    Args:
        free: Mask of the free cells (X, Y).
        neighbours: Steps to the eight neighbours of a cell.
        sx: North index of the first cell.
        sy: East index of the first cell.
        gx: North index of the last cell.
        gy: East index of the last cell.
    """
    nx, ny = free.shape
    if not (free[sx, sy] and free[gx, gy]):
        return np.empty((0, 2), np.int64)
    cost = np.full(nx * ny, np.inf)
    came = np.full(nx * ny, -1, np.int64)
    final = np.zeros(nx * ny, np.bool_)
    keys, cells, size = np.empty(1024), np.empty(1024, np.int64), 1
    cost[sx * ny + sy] = keys[0] = 0.0
    cells[0] = sx * ny + sy
    while size:
        here = cells[0]
        size -= 1
        _sift_down(keys, cells, size)
        if final[here]:
            continue
        final[here] = True
        x, y = here // ny, here % ny
        if x == gx and y == gy:
            return _back(came, here, ny)
        for k in range(8):
            tx, ty = x + neighbours[k, 0], y + neighbours[k, 1]
            if tx < 0 or ty < 0 or tx >= nx or ty >= ny or not (free[tx, ty] and free[tx, y] and free[x, ty]):
                continue
            there = tx * ny + ty
            length = cost[here] + (1.0 if k < 4 else math.sqrt(2.0))
            if length < cost[there] - 1e-12:
                cost[there], came[there] = length, here
                if size == len(keys):
                    keys, cells = np.concatenate((keys, keys)), np.concatenate((cells, cells))
                far, near = max(abs(tx - gx), abs(ty - gy)), min(abs(tx - gx), abs(ty - gy))
                keys[size], cells[size] = length + far + (math.sqrt(2.0) - 1.0) * near, there
                size += 1
                _sift_up(keys, cells, size - 1)
    return np.empty((0, 2), np.int64)


@jit
def _sift_up(keys: Array, cells: NDArray[np.int64], k: int) -> None:
    """Restore the heap order after an entry was appended at position k."""
    key, cell = keys[k], cells[k]
    while k and keys[(k - 1) // 2] > key:
        keys[k], cells[k] = keys[(k - 1) // 2], cells[(k - 1) // 2]
        k = (k - 1) // 2
    keys[k], cells[k] = key, cell


@jit
def _sift_down(keys: Array, cells: NDArray[np.int64], size: int) -> None:
    """Replace the root of a binary heap of `size` by the entry after its end, and restore the order."""
    key, cell, k = keys[size], cells[size], 0
    while 2 * k + 1 < size:
        child = 2 * k + 1
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[k], cells[k] = keys[child], cells[child]
        k = child
    keys[k], cells[k] = key, cell


@jit
def _back(came: NDArray[np.int64], last: int, ny: int) -> NDArray[np.int64]:
    """Return the indices (K, 2) of the cells that lead to the cell `last`, first cell first."""
    count, cell = 1, last
    while came[cell] >= 0:
        cell = came[cell]
        count += 1
    way = np.empty((count, 2), np.int64)
    cell = last
    for k in range(count - 1, -1, -1):
        way[k, 0], way[k, 1] = cell // ny, cell % ny
        cell = came[cell]
    return way


@jit
def shorten_kernel(way: Array, pillars: Array, apart: float) -> NDArray[np.int64]:
    """Return the indices of those corners of a path that remain when straight lines replace detours.

    Each corner is joined to the furthest later corner that a straight line reaches at enough distance from
    the pillars.

    Args:
        way: Corners x y of the path (K, 2) [m].
        pillars: x y of the pillars' axes (P, 2) [m].
        apart: Least distance of the path from the pillars' axes [m].
    """
    kept = np.empty(len(way), np.int64)
    kept[0], count, k = 0, 1, 0
    while k < len(way) - 1:
        j = len(way) - 1
        while j > k + 1 and not _clear(way[k], way[j], pillars, apart):
            j -= 1
        kept[count], k = j, j
        count += 1
    return kept[:count]


@jit
def _clear(a: Array, b: Array, pillars: Array, apart: float) -> bool:
    """Return whether the line from a to b, (2,) each, keeps `apart` [m] from all pillars' axes (P, 2)."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    for p in range(len(pillars)):
        s = ((pillars[p, 0] - a[0]) * dx + (pillars[p, 1] - a[1]) * dy) / max(square, 1e-12)
        s = min(max(s, 0.0), 1.0)
        if (a[0] + s * dx - pillars[p, 0]) ** 2 + (a[1] + s * dy - pillars[p, 1]) ** 2 < apart * apart:
            return False
    return True


def _with_depth(way: Array, first: float, last: float) -> Array:
    """Add a depth that changes linearly with arc length to a path (K, 2); return (K, 3)."""
    along = np.r_[0.0, np.linalg.norm(np.diff(way, axis=0), axis=1).cumsum()]
    share = along / along[-1] if along[-1] > 0.0 else np.linspace(0.0, 1.0, len(way))
    return np.column_stack([way, first + share * (last - first)])
