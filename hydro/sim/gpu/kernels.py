"""Kernels of a plant (a set of simulated vehicles) on a GPU, with one thread per vehicle.

`sim.flight` has the computation, which the processor shares.  This module has the parts that a GPU needs in
addition: the vehicle of a thread, and its local buffers, whose sizes are fixed at compilation.  Arguments are
blocks of arrays.  Inside a block, the simulator of numba-cuda passes plain arrays, which compiled code
accepts.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from hydro.core.columns import Array, Mask
from hydro.core.compiled import copy_kernel
from hydro.core.effects.layout import MOTION, TIME
from hydro.core.simulation.dynamics import BODY, Motion
from hydro.core.simulation.held import FELT, WITH_HELD
from hydro.core.simulation.integrate import Thrusters
from hydro.sim.craft import Control, Crafts
from hydro.sim.flight import Fleet, Pace, begin, fly
from hydro.sim.plant import Readings
from hydro.sim.residual.control import Room, Tables, attend

BLOCK = 128
"""Number of threads per block."""


class Sizes(NamedTuple):
    """Sizes for which a kernel is compiled.

    Attributes:
        states: Number of internal states of the effects.
        thrusters: Number of thrusters.
        past: Number of stored commands.
        work: Length of the residual network's workspace, 0 without a network.
        scratch: Length of the further buffer of the network's control step.
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
    """Initial states of vehicles, in a plant of N.

    Attributes:
        mask: Vehicles that start, (N,).
        pose: Initial poses (N, 7), see `sim.plant.Plant`.
        velocity: Initial velocities u v w p q r, FRD, (N, 6) [m/s, rad/s].
    """

    mask: Mask
    pose: Array
    velocity: Array


class Orders(NamedTuple):
    """Commands that N vehicles on a GPU follow in the control step that starts.

    Attributes:
        commands: Commands of n thrusters in [-1, 1], (N, n).
    """

    commands: Array


def launch(kernel: Any, count: int, *blocks: Any) -> None:
    """Run a kernel with one thread for each of `count` vehicles, and `blocks` as its arguments."""
    kernel[-(-count // BLOCK), min(BLOCK, count)](*blocks)


@functools.cache
def _network_step(sizes: Sizes) -> Any:
    """Return a device function that evaluates the network at a control step and holds its wrench."""
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
    """Return the CUDA kernel that starts vehicles at given states, with thrusters at rest and clocks at 0.

    Its arguments are `(crafts, control, fleet, readings, pace, start)`.

    Args:
        sizes: Sizes for which the kernel is compiled.
    """
    size, thrusters, moving = BODY + sizes.states, sizes.thrusters, sizes.motion
    networked, renew = sizes.work > 0, _network_step(sizes)

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
    """Return the CUDA kernel that simulates vehicles for one control step.

    Its arguments are `(crafts, control, fleet, readings, pace, orders)`; diverged vehicles do not move.

    Args:
        sizes: Sizes for which the kernel is compiled.
    """
    size, thrusters, past, moving = BODY + sizes.states, sizes.thrusters, sizes.past, sizes.motion
    networked, renew = sizes.work > 0, _network_step(sizes)

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
