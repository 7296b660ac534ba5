"""A* planner, compared with independent shortest paths, and the constraints of its paths."""

from itertools import pairwise

import networkx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from hydro.core.errors import DataError, UsageError
from hydro.rl.world.planner import Grid, astar, plan

TANK = Grid(24.0, 12.0)
NOWHERE = np.full((8, 2), np.nan)


def length(way):
    return np.linalg.norm(np.diff(np.asarray(way, float), axis=0), axis=1).sum()


def graph_of(free):
    """Return the graph of cells that may follow each other, without cut corners."""
    graph = networkx.Graph()
    graph.add_nodes_from(map(tuple, np.argwhere(free)))
    for x, y in list(graph):
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            there = x + dx, y + dy
            if there in graph and (x, there[1]) in graph and (there[0], y) in graph:
                graph.add_edge((x, y), there, weight=np.hypot(dx, dy))
    return graph


@given(
    arrays.arrays(bool, (9, 7), elements=st.booleans() | st.just(True)),
    st.integers(0, 62),
    st.integers(0, 62),
)
def test_way_is_as_short_as_dijkstras(free, start, goal):
    start, goal = divmod(start, 7), divmod(goal, 7)
    graph = graph_of(free)
    found = astar(free, start, goal)
    joined = start in graph and goal in graph and networkx.has_path(graph, start, goal)
    assert bool(len(found)) == joined
    if joined:
        cells = list(map(tuple, found))
        assert cells[0] == start
        assert cells[-1] == goal
        assert all(graph.has_edge(a, b) for a, b in pairwise(cells))
        best = networkx.dijkstra_path_length(graph, start, goal)
        assert length(found) == pytest.approx(best, abs=1e-9)


def test_open_water_is_crossed_straight():
    way = plan(TANK, [2.0, 3.0, 1.0], [20.0, 9.0, 5.0], NOWHERE, 0.1)
    np.testing.assert_allclose(way, [[2.0, 3.0, 1.0], [20.0, 9.0, 5.0]])


def test_one_pillar_costs_two_tangents_and_an_arc():
    """Compare with the shortest path around a circle of radius R between points at distance a each side."""
    apart, a = 0.1 + TANK.margin, 4.0
    way = plan(TANK, [8.0, 6.0, 2.0], [16.0, 6.0, 2.0], np.array([[12.0, 6.0]]), 0.1)
    tangent = np.sqrt(a**2 - apart**2)
    arc = apart * (np.pi - 2.0 * np.arccos(apart / a))
    assert 2.0 * tangent + arc - 0.1 < length(way) < (2.0 * tangent + arc) * 1.01


@given(st.integers(0, 10_000))
def test_ways_keep_the_margin_and_the_depths(seed):
    rng = np.random.default_rng(seed)
    pillars = np.column_stack([rng.uniform(5, 19, 5), rng.uniform(3, 9, 5)])
    start, goal = np.array([1.5, rng.uniform(2, 10), 2.0]), np.array([22.5, rng.uniform(2, 10), 6.0])
    way = plan(TANK, start, goal, pillars, 0.1)
    np.testing.assert_array_equal(way[[0, -1]], [start, goal])
    assert (np.diff(way[:, 2]) >= 0.0).all()
    dense = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(way)])
    apart = np.linalg.norm(dense[:, None, :2] - pillars, axis=2).min()
    if TANK.free(pillars, 0.1)[TANK.of(start[:2])] and len(
        astar(TANK.free(pillars, 0.1), TANK.of(start[:2]), TANK.of(goal[:2]))
    ):
        assert apart >= 0.1 + TANK.margin - TANK.cell - 1e-9


def test_less_margin_is_kept_where_there_is_no_other_way():
    gate = np.array([[12.0, y] for y in (0.5, 2.5, 4.5, 7.5, 9.5, 11.5)])  # 3 m between the middle two
    way = plan(Grid(24.0, 12.0, margin=1.6), [4.0, 6.0, 1.0], [20.0, 6.0, 1.0], gate, 0.1)
    assert abs(way[:, 1] - 6.0).max() < 1.0


def test_a_wall_of_pillars_cannot_be_passed():
    wall = np.column_stack([np.full(120, 12.0), np.linspace(0.0, 12.0, 120)])
    with pytest.raises(DataError, match="no path leads around"):
        plan(TANK, [4.0, 6.0, 1.0], [20.0, 6.0, 1.0], wall, 0.1)


@pytest.mark.parametrize("wrong", [{"cell": 0.0}, {"length": -1.0}, {"margin": -0.1}, {"cell": float("nan")}])
def test_a_grid_needs_cells(wrong):
    with pytest.raises(UsageError, match="a grid needs"):
        Grid(**{"length": 24.0, "width": 12.0} | wrong)


def test_places_outside_belong_to_the_nearest_cell():
    assert TANK.of([-3.0, 100.0]) == (0, TANK.shape[1] - 1)
    assert TANK.shape == (480, 240)


@given(st.integers(0, 1000), st.sampled_from([0.0, 0.5, 1.0]))
def test_free_cells_keep_their_distance_from_every_pillar_and_wall(seed, share):
    """Check the distance of every cell."""
    grid = Grid(6.0, 3.0, cell=0.1)
    pillars = np.random.default_rng(seed).uniform([-1.0, -1.0], [7.0, 4.0], (5, 2))
    free = grid.free(pillars, 0.25, share)
    centres = grid.centres(np.argwhere(np.ones(grid.shape, bool)))
    apart = np.hypot(*(centres[:, None] - pillars).transpose(2, 0, 1)).min(axis=1) - 0.25 - share * 1.2
    walls = np.minimum(centres, [6.0, 3.0] - centres).min(axis=1) - share * 0.6
    sure = (np.abs(apart) > 1e-9) & (np.abs(walls) > 1e-9)
    np.testing.assert_array_equal(free.ravel()[sure], ((apart > 0.0) & (walls > 0.0))[sure])
