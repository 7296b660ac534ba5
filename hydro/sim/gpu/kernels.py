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

from hydro.core.columns import Array, Array32, Mask
from hydro.core.compiled import copy_kernel
from hydro.core.effects.layout import MOTION, TIME
from hydro.core.simulation.dynamics import BODY, Motion
from hydro.core.simulation.held import FELT, WITH_HELD
from hydro.core.simulation.integrate import Thrusters
from hydro.sim.flight import Fleet, Pace, begin, fly
from hydro.sim.plant import Readings
from hydro.sim.residual.control import Room, Tables, attend

BLOCK = 128
"""Threads of a block."""


class Crafts(NamedTuple):
    """Which vehicle each of N is.

    Attributes:
        programs: Of P vehicles (P, L), the shorter ones with zeros behind them.
        tables: Their thruster tables (P, n, columns).
        kind: Row of each one's program (N,).
        facets: (8, 0): the file alone says what the water does.
        inertia: (P, 36) whose Coriolis and centripetal forces a residual network takes away.
    """

    programs: Array
    tables: Array
    kind: NDArray[np.int32]
    facets: Array
    inertia: Array


class Control(NamedTuple):
    """A residual network and what N vehicles remember of it; empty arrays where there is none.

    Attributes:
        block: Parameters; this and the next three as `sim.residual.control.Tables` has them.
        gains: Of the filter.
        program: Of the network.
        weights: Of the network.
        states: What each vehicle remembers (N, states).
        felt: Where the velocity that it is asked about stands in a state of motion.
    """

    block: Array
    gains: Array
    program: Array
    weights: Array32
    states: Array
    felt: int


class Sizes(NamedTuple):
    """What a kernel is compiled for.

    Attributes:
        states: Internal states of the effects.
        thrusters: Their number.
        past: Commands that they remember.
        work: Workspace of the residual network, 0 without one.
        scratch: Numbers that its control needs besides.
    """

    states: int
    thrusters: int
    past: int
    work: int = 0
    scratch: int = 0

    @property
    def motion(self) -> int:
        """Length of a state of motion."""
        return WITH_HELD if self.work else MOTION


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


def launch(kernel: Any, count: int, *blocks: Any) -> None:
    """Run a kernel for so many vehicles."""
    kernel[-(-count // BLOCK), min(BLOCK, count)](*blocks)


@functools.cache
def _renewing(sizes: Sizes) -> Any:
    """What has a vehicle's network begin a control step, and holds its wrench behind the state of motion."""
    room, more = max(1, sizes.work), max(1, sizes.scratch)

    @cuda.jit(device=True)  # type: ignore[untyped-decorator]
    def renew(k: int, crafts: Crafts, control: Control, fleet: Fleet, s: Array) -> None:
        work, scratch = cuda.local.array(room, np.float32), cuda.local.array(more, np.float64)
        s[TIME], s[FELT] = fleet.time[k], float(control.felt)
        tables = Tables(control.block, control.gains, control.program, control.weights)
        program, inertia = crafts.programs[crafts.kind[k]], crafts.inertia[crafts.kind[k]]
        attend(program, fleet.y[k], tables, control.states[k], inertia, s, Room(work, scratch))

    return renew


@functools.cache
def start_kernel(sizes: Sizes) -> Any:
    """The kernel that puts vehicles somewhere, at rest, clocks at 0.

    It is launched with `(crafts, control, fleet, readings, pace, start)`.
    """
    size, thrusters, moving = BODY + sizes.states, sizes.thrusters, sizes.motion
    networked, renew = sizes.work > 0, _renewing(sizes)

    @cuda.jit  # type: ignore[untyped-decorator]
    def start(
        crafts: Crafts, control: Control, fleet: Fleet, readings: Readings, pace: Pace, placed: Start
    ) -> None:
        k = cuda.grid(1)
        if k >= placed.mask.size or not placed.mask[k]:
            return
        y, work = cuda.local.array(size, np.float64), cuda.local.array((4, size), np.float64)
        s, lags = cuda.local.array(moving, np.float64), cuda.local.array((3, thrusters), np.float64)
        for i in range(moving):
            s[i] = 0.0
        state, craft = fleet.y[k], crafts.kind[k]
        state[:] = 0.0
        copy_kernel(placed.pose[k], state[:7])
        copy_kernel(placed.velocity[k], state[7:BODY])
        fleet.lags[k, :] = 0.0
        fleet.commands[k, :, :] = 0.0
        fleet.time[k], readings.diverged[k] = 0.0, False
        if networked:
            control.states[k, :] = 0.0
            renew(k, crafts, control, fleet, s)
        motion = Motion(crafts.programs[craft], crafts.facets, y, s, work)
        begin(k, motion, crafts.tables[craft], lags, fleet, pace, readings)

    return start


@functools.cache
def step_kernel(sizes: Sizes) -> Any:
    """The kernel that flies vehicles for one control step.

    It is launched with `(crafts, control, fleet, readings, pace, orders)`; who has diverged stays where he
    is.
    """
    size, thrusters, past, moving = BODY + sizes.states, sizes.thrusters, sizes.past, sizes.motion
    networked, renew = sizes.work > 0, _renewing(sizes)

    @cuda.jit  # type: ignore[untyped-decorator]
    def step(
        crafts: Crafts, control: Control, fleet: Fleet, readings: Readings, pace: Pace, orders: Orders
    ) -> None:
        k = cuda.grid(1)
        if k >= readings.diverged.size or readings.diverged[k]:
            return
        y, work = cuda.local.array(size, np.float64), cuda.local.array((4, size), np.float64)
        s, lags = cuda.local.array(moving, np.float64), cuda.local.array((3, thrusters), np.float64)
        target, decay = cuda.local.array(thrusters, np.float64), cuda.local.array(thrusters, np.float64)
        upcoming, due = cuda.local.array(thrusters, np.int64), cuda.local.array(2, np.float64)
        clock = cuda.local.array(past, np.float64)
        for i in range(moving):
            s[i] = 0.0
        given = fleet.commands[k]
        for i in range(past - 1):
            copy_kernel(given[i + 1], given[i])
        copy_kernel(orders.commands[k], given[past - 1])
        craft = crafts.kind[k]
        if networked:
            renew(k, crafts, control, fleet, s)
        motion = Motion(crafts.programs[craft], crafts.facets, y, s, work)
        crew = Thrusters(crafts.tables[craft], target, upcoming, decay, lags, due)
        fly(k, motion, crew, clock, fleet, pace, readings)

    return step
