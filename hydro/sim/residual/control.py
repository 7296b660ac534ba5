"""Residual network inside the simulation: evaluated once per control step, its wrench held until the next.

Each control step runs a Kalman filter for nu_dot, the network, and the conditioning of its wrench.  The
wrench is on the left-hand side of the equations of motion, like the label.

A wrench held for 40 ms is 20 ms late on average, and late drag is too small while the vehicle accelerates.
So the network is evaluated half a control step ahead, at nu + nu_dot dt/2 with the control step dt: the held
wrench is that of the middle of the interval in which it acts.

A passive model (`learn.networks.structured`) is not held as a wrench, because a wrench that was right 40 ms
ago can add energy.  Its damping matrix D is held, its inertia is constant, and the wrench follows the
velocity between control steps.  A conditioning that changes the held wrench loses this property.

All states between control steps are MuJoCo activations.  So they are saved, copied, reset and rolled out with
the rest of the state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array, Array32
from hydro.core.compiled import copy_kernel, jit, kernel, within
from hydro.core.distillation import history
from hydro.core.effects.layout import TIME
from hydro.core.errors import UsageError
from hydro.core.recording.smoothing import Design, filter_axis, gains
from hydro.core.residual.layers import COLUMNS, damping
from hydro.core.residual.mirrors import SCRATCH
from hydro.core.residual.network import Network, Weights, network_kernel
from hydro.core.simulation import held
from hydro.core.simulation.dynamics import observe_state
from hydro.core.vehicle.rigid_body import coriolis_kernel
from hydro.sim.residual.conditioning import COUNTS, OFF, PARAMETERS, Conditioning, condition_kernel

NOISELESS = 1e6
"""q dt^3 / R of a filter that trusts every sample, because a simulated velocity has no noise."""

CLOCK_TOLERANCE = 1e-6
"""Tolerance of the clock at the start of a control step, as a share of the step."""
CACHE_LINE = 8
"""Number of doubles in a cache line; the block of parameters and its weights are aligned to one."""

# States of one vehicle's control.
TICK = 0  # number of control steps so far
HELD = 1  # held wrench, 6
FILTER = 7  # nu and nu_dot of each axis, 12
LOW_PASS = 19  # state of the low-pass, 6
COUNTED = 25  # counts of the conditioning, 8
STATES = COUNTED + COUNTS
UNCONDITIONED = LOW_PASS  # without conditioning: MuJoCo processes all activations in every step
# Then follow the past velocities of a network with memory, and the states of a passive one:
DAMPING, OFFSET, PASSIVE_STATES = 0, 36, 42  # D, and D nu + C(nu) nu at the control step

# Entries of the block of parameters.
AT_PERIOD, AT_GAINS, AT_GAIN_ROWS, AT_PROGRAM, AT_STEPS, AT_INPUTS, AT_ROOM = range(7)
AT_PHYSFEAT, AT_MEMORY, AT_SCALERS, AT_WEIGHTS, AT_WEIGHT_COUNT, AT_CONDITIONING = range(7, 13)
AT_STATES = 13  # number of all states
AT_INERTIA, AT_ROOT, AT_ROOT_WEIGHTS = 14, 15, 16  # of a passive model; inertia is 0 for others
AT_LEAD = 17  # lead [s]
AT_PAST = 18  # index of the past velocities in the states
HEADER = 19

OWN_SCRATCH = 18
"""Number of scratch entries of `renew` in addition to those of its network: a state and a wrench."""


@dataclass(frozen=True)
class Control:
    """Residual network inside a simulation, with its settings.

    Attributes:
        network: The network.
        period: Control step [s].
        design: Filter for nu_dot, for any sample time; by default one that trusts every sample.
        conditioning: Conditioning of the network's wrench.
        lead: Time by which the network is evaluated ahead, as a fraction of the control step; 0 as in Wu et
            al. A passive model needs no lead and gets none.
    """

    network: Network
    period: float = 0.04
    design: Design | None = None
    conditioning: Conditioning = OFF
    lead: float = 0.5

    def __post_init__(self) -> None:
        """Check that the control step is that of the network's memory.

        Raises:
            UsageError: It is another.
        """
        wanted = self.network.period
        if wanted is not None and abs(self.period - wanted) > 1e-9:
            raise UsageError(
                f"the network has past velocities {wanted:g} s apart: its control step cannot be "
                f"{self.period:g} s"
            )

    @property
    def states(self) -> int:
        """Number of states that one vehicle's network keeps between control steps."""
        return self.past + self.network.memory + (0 if self.network.passive is None else PASSIVE_STATES)

    @property
    def scratch(self) -> int:
        """Length of the buffer that a control step overwrites, without the workspace of the network."""
        return OWN_SCRATCH + self.network.inputs + SCRATCH

    @property
    def past(self) -> int:
        """Index of the first past velocity in the states."""
        return UNCONDITIONED if self.conditioning == OFF else STATES

    def encode(self) -> Array:
        """Return the network, its filter and its conditioning as one array of numbers, for `tables_of`.

        Weights are packed, two float32 to a double.
        """
        design = self.design or Design(self.period, (NOISELESS,) * 6, (0.0,) * 6)
        forward = gains(design.at(self.period)).forward
        network = self.network
        odd = np.zeros(len(network.weights) % 2, dtype=np.float32)
        weights = np.concatenate([network.weights, odd]).view(np.float64)
        header = np.zeros(HEADER)
        header[[AT_PERIOD, AT_GAIN_ROWS]] = self.period, len(forward)
        header[[AT_STEPS, AT_WEIGHT_COUNT]] = len(network.program), len(network.weights)
        header[[AT_INPUTS, AT_ROOM]] = network.inputs, network.room
        header[[AT_PHYSFEAT, AT_MEMORY]] = network.physfeat, network.memory
        header[AT_STATES], header[AT_PAST] = self.states, self.past
        header[AT_LEAD] = self.lead * self.period
        inertia = np.empty(0)
        if network.passive is not None:
            header[[AT_ROOT, AT_ROOT_WEIGHTS]] = network.passive
            header[AT_LEAD] = 0.0
            inertia = network.weights[network.passive[1] :][:36].astype(np.float64)
        blocks = [header]
        for entry, block in (
            (AT_INERTIA, inertia),
            (AT_GAINS, forward.ravel()),
            (AT_PROGRAM, network.program.ravel()),
            (AT_SCALERS, network.scalers),
            (AT_CONDITIONING, np.empty(0) if self.conditioning == OFF else self.conditioning.parameters()),
            (AT_WEIGHTS, weights),
        ):
            if entry == AT_WEIGHTS:
                blocks.append(line_padding(blocks))
            header[entry] = sum(map(len, blocks)) if len(block) else 0
            blocks.append(block)
        return np.concatenate(blocks)


def line_padding(blocks: Sequence[Array]) -> Array:
    """Return zeros to append to blocks of numbers, so that the next block begins at a CPU cache line."""
    return np.zeros(-sum(map(len, blocks)) % CACHE_LINE)


@within
def due(block: Array, states: Array, time: float) -> bool:
    """Return whether the network's next control step begins at or before `time` [s].

    Args:
        block: Parameters of the control, from `Control.encode`.
        states: States of the control between its steps.
        time: Time since the start [s].
    """
    return bool(time >= (states[TICK] - CLOCK_TOLERANCE) * block[AT_PERIOD])


def steps_since(states: Array, begun: Array, period: float) -> Array:
    """Return the number of control steps of each of V vehicles since its start (V,).

    Args:
        states: States of the vehicles' controls (V, STATES).
        begun: Start time of each vehicle (V,) [s].
        period: Control step [s].
    """
    tick = states[:, TICK]
    return np.asarray(np.where(tick > 0.0, tick - np.floor(begun / period + CLOCK_TOLERANCE), 0.0))


class Tables(NamedTuple):
    """Parameters of a residual network in a simulation, as arrays for `renew`.

    Attributes:
        block: Result of `Control.encode`.
        gains: Gains of the filter, (rows, 6, 2), see `core.recording.smoothing.Gains`.
        program: Program of the network, (steps, COLUMNS).
        weights: Weights of the network.
    """

    block: Array
    gains: Array
    program: Array
    weights: Array32


class Room(NamedTuple):
    """Buffers that a control step of a residual network overwrites.

    Attributes:
        work: Workspace of the network, (`Network.room`,).
        scratch: Further buffer, (`Control.scratch`,).
    """

    work: Array32
    scratch: Array


@jit
def tables_of(block: Array, weights: Array32) -> Tables:
    """Return views of the parts of a block from `Control.encode`, together with the weights."""
    begin, rows = int(block[AT_GAINS]), int(block[AT_GAIN_ROWS])
    at, steps = int(block[AT_PROGRAM]), int(block[AT_STEPS])
    return Tables(
        block,
        block[begin : begin + 12 * rows].reshape(rows, 6, 2),
        block[at : at + steps * COLUMNS].reshape(steps, COLUMNS),
        weights,
    )


@jit
def control_kernel(block: Array, weights: Array32, states: Array, time: float, nu: Array) -> None:
    """Start a control step: compute the network's wrench, and hold it in `states` until the next step.

    Args:
        block: Parameters of the control, from `Control.encode`.
        weights: Weights of the network.
        states: States of the control; written.
        time: Time since the start [s].
        nu: Velocity, FRD, (6,) [m/s, rad/s].
    """
    room = Room(
        np.empty(int(block[AT_ROOM]), np.float32), np.empty(OWN_SCRATCH + int(block[AT_INPUTS]) + SCRATCH)
    )
    renew(tables_of(block, weights), states, time, nu, room)


@kernel
def renew(tables: Tables, states: Array, time: float, nu: Array, room: Room) -> None:
    """Start a control step: compute the network's wrench, hold it in `states`, and count the step.

    Args:
        tables: Parameters of the control.
        states: States of the control; written.
        time: Time [s].
        nu: Velocity, FRD, (6,) [m/s, rad/s].
        room: Buffers; overwritten.
    """
    block, work, scratch = tables.block, room.work, room.scratch
    first, row, last = states[TICK] == 0.0, int(states[TICK]), len(tables.gains) - 1
    for i in range(6):
        axis = states[FILTER + 2 * i : FILTER + 2 * i + 2]
        filter_axis(row, axis, nu[i], tables.gains[min(row, last), i], block[AT_PERIOD])
    states[TICK] = math.floor(time / block[AT_PERIOD] + CLOCK_TOLERANCE) + 1.0

    past = int(block[AT_PAST])
    memory = states[past : past + int(block[AT_MEMORY])]
    if first:
        history.begin(nu, memory)
    state, wrench = scratch[:12], scratch[12:OWN_SCRATCH]
    for i in range(6):
        dot = states[FILTER + 2 * i + 1]
        state[i] = nu[i] + block[AT_LEAD] * dot
        state[6 + i] = dot
    begin = int(block[AT_SCALERS])
    network = Weights(
        tables.program,
        tables.weights,
        block[AT_PHYSFEAT] > 0.0,
        block[begin : begin + 2 * int(block[AT_INPUTS]) + 12],
    )
    network_kernel(network, state, memory, work, scratch[OWN_SCRATCH:], wrench)
    history.remember(state[:6], memory)
    if block[AT_INERTIA] > 0.0:
        passive = states[past + memory.size : past + memory.size + PASSIVE_STATES]
        root = work[int(block[AT_ROOT]) : int(block[AT_ROOT]) + 36]
        damping(tables.weights, int(block[AT_ROOT_WEIGHTS]), root, nu, passive[DAMPING : DAMPING + 36])
        passive[OFFSET : OFFSET + 6] = 0.0
        _add_passive(block, passive, nu, passive[OFFSET : OFFSET + 6])
    begin = int(block[AT_CONDITIONING])
    if begin:
        condition_kernel(
            wrench,
            nu,
            block[begin : begin + PARAMETERS],
            states[LOW_PASS : LOW_PASS + 6],
            states[COUNTED : COUNTED + COUNTS],
            states[HELD : HELD + 6],
        )
    else:
        copy_kernel(wrench, states[HELD : HELD + 6])


@kernel
def hold(block: Array, states: Array, inertia: Array, s: Array) -> None:
    """Write the network's held wrench to a state of motion, in the layout of `core.simulation.held`.

    Args:
        block: Parameters of the control.
        states: States of the control.
        inertia: Inertia whose Coriolis and centripetal forces are cancelled, (36,), row by row.
        s: State of motion (`held.WITH_HELD`,), written; `held.FELT` is not changed.
    """
    copy_kernel(inertia, s[held.CANCELLED : held.CANCELLED + 36])
    copy_kernel(states[HELD : HELD + 6], s[held.WRENCH : held.WRENCH + 6])
    at, first = int(block[AT_INERTIA]), int(block[AT_PAST]) + int(block[AT_MEMORY])
    for i in range(36):
        s[held.DAMPING + i] = states[first + DAMPING + i] if at else 0.0
        s[held.CANCELLED + i] -= block[at + i] if at else 0.0
    for i in range(6):
        s[held.WRENCH + i] -= states[first + OFFSET + i] if at else 0.0


@kernel
def attend(
    flat: Array, y: Array, tables: Tables, states: Array, inertia: Array, s: Array, room: Room
) -> None:
    """Start a control step if it is due, and write the held wrench to `s`, for a motion without MuJoCo.

    Args:
        flat: Program of the vehicle.
        y: State of motion, see `core.simulation.dynamics`.
        tables: Parameters of the control.
        states: States of the control; written.
        inertia: Inertia whose Coriolis and centripetal forces are cancelled, (36,), row by row.
        s: State of motion (`held.WITH_HELD`,) with its time and `held.FELT`; the rest is written.
        room: Buffers; overwritten.
    """
    observe_state(flat, y, s)
    if due(tables.block, states, s[TIME]):
        at = int(s[held.FELT])
        renew(tables, states, s[TIME], s[at : at + 6], room)
    hold(tables.block, states, inertia, s)


@within
def exert(block: Array, states: Array, nu: Array, part: Array, tau: Array) -> None:
    """Subtract the network's held wrench from the wrench `tau` on the vehicle, in place.

    Args:
        block: Parameters of the control.
        states: States of the control.
        nu: Velocity, FRD, (6,) [m/s, rad/s]; only a passive network's wrench depends on it.
        part: Buffer (6,), overwritten.
        tau: Wrench on the vehicle, (6,) [N, N m], written.
    """
    for i in range(6):
        tau[i] -= states[HELD + i]
    if block[AT_INERTIA] > 0.0:
        first = int(block[AT_PAST]) + int(block[AT_MEMORY])
        passive = states[first : first + PASSIVE_STATES]
        for i in range(6):
            part[i] = -passive[OFFSET + i]
        _add_passive(block, passive, nu, part)
        for i in range(6):
            tau[i] -= part[i]


@kernel
def _add_passive(block: Array, passive: Array, nu: Array, tau: Array) -> None:
    """Add D nu + C(nu) nu of a passive model to `tau` (6,), with the held damping matrix D.

    Args:
        block: Parameters of the control, with the inertia of C.
        passive: States of the passive model, with D.
        nu: Velocity (6,) [m/s, rad/s].
        tau: Wrench (6,) [N, N m], changed in place.
    """
    begin = int(block[AT_INERTIA])
    coriolis_kernel(block[begin : begin + 36], nu, tau)
    for i in range(6):
        for j in range(6):
            tau[i] += passive[DAMPING + 6 * i + j] * nu[j]
