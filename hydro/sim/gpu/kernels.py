"""The kernels of a plant on a GPU: vehicles begin, and fly one control step; one thread a vehicle.

All that is computed stands in `sim.flight`, which the processor runs too.  Here is what a GPU needs besides:
which vehicle a thread is, and room of its own, whose size is known when the kernel is compiled.  Arguments
are blocks of arrays: what a simulated kernel is given in a block are plain arrays, which compiled code takes.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask
from hydro.core.compiled import copy_kernel
from hydro.core.effects.layout import MOTION
from hydro.core.simulation.dynamics import BODY, Motion
from hydro.core.simulation.integrate import Thrusters
from hydro.sim.flight import Fleet, Pace, begin, fly
from hydro.sim.plant import Readings

BLOCK = 128
"""Threads of a block."""


class Crafts(NamedTuple):
    """Which vehicle each of N is.

    Attributes:
        programs: Of P vehicles (P, L), the shorter ones with zeros behind them.
        tables: Their thruster tables (P, n, columns).
        kind: Row of each one's program (N,).
        facets: (8, 0): the file alone says what the water does.
    """

    programs: Array
    tables: Array
    kind: NDArray[np.int32]
    facets: Array


class Start(NamedTuple):
    """Which of N vehicles are put where.

    Attributes:
        mask: Which (N,).
        pose: (N, 7), see `sim.plant.Plant`.
        velocity: (N, 6).
    """

    mask: Mask
    pose: Array
    velocity: Array


class Orders(NamedTuple):
    """What N vehicles are told: the commands (N, n) of the control step that begins."""

    commands: Array


def grid(count: int) -> tuple[int, int]:
    """Blocks for so many vehicles, and the threads of each."""
    return -(-count // BLOCK), min(BLOCK, count)


@functools.cache
def start_kernel(states: int, thrusters: int) -> Any:
    """The kernel that puts vehicles of so many internal states and thrusters somewhere, at rest, clocks at 0.

    It is launched with `(crafts, fleet, readings, pace, start)`.
    """
    size = BODY + states

    @cuda.jit  # type: ignore[untyped-decorator]
    def start(crafts: Crafts, fleet: Fleet, readings: Readings, pace: Pace, placed: Start) -> None:
        k = cuda.grid(1)
        if k >= placed.mask.size or not placed.mask[k]:
            return
        y, work = cuda.local.array(size, np.float64), cuda.local.array((4, size), np.float64)
        s, lags = cuda.local.array(MOTION, np.float64), cuda.local.array((3, thrusters), np.float64)
        for i in range(MOTION):
            s[i] = 0.0
        state, craft = fleet.y[k], crafts.kind[k]
        state[:] = 0.0
        copy_kernel(placed.pose[k], state[:7])
        copy_kernel(placed.velocity[k], state[7:BODY])
        fleet.lags[k, :] = 0.0
        fleet.commands[k, :, :] = 0.0
        fleet.time[k], readings.diverged[k] = 0.0, False
        motion = Motion(crafts.programs[craft], crafts.facets, y, s, work)
        begin(k, motion, crafts.tables[craft], lags, fleet, pace, readings)

    return start


@functools.cache
def step_kernel(states: int, thrusters: int, past: int) -> Any:
    """The kernel that flies such vehicles, which remember `past` commands, for one control step.

    It is launched with `(crafts, fleet, readings, pace, orders)`; who has diverged stays where he is.
    """
    size = BODY + states

    @cuda.jit  # type: ignore[untyped-decorator]
    def step(crafts: Crafts, fleet: Fleet, readings: Readings, pace: Pace, orders: Orders) -> None:
        k = cuda.grid(1)
        if k >= readings.diverged.size or readings.diverged[k]:
            return
        y, work = cuda.local.array(size, np.float64), cuda.local.array((4, size), np.float64)
        s, lags = cuda.local.array(MOTION, np.float64), cuda.local.array((3, thrusters), np.float64)
        target, decay = cuda.local.array(thrusters, np.float64), cuda.local.array(thrusters, np.float64)
        upcoming, due = cuda.local.array(thrusters, np.int64), cuda.local.array(2, np.float64)
        clock = cuda.local.array(past, np.float64)
        for i in range(MOTION):
            s[i] = 0.0
        given = fleet.commands[k]
        for i in range(past - 1):
            copy_kernel(given[i + 1], given[i])
        copy_kernel(orders.commands[k], given[past - 1])
        craft = crafts.kind[k]
        motion = Motion(crafts.programs[craft], crafts.facets, y, s, work)
        crew = Thrusters(crafts.tables[craft], target, upcoming, decay, lags, due)
        fly(k, motion, crew, clock, fleet, pace, readings)

    return step
