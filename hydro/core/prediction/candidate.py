"""A vehicle made ready to be held against a recording: its program, its velocity log, and its states there.

Rotors obey the commands alone and memories of the fluid the motion alone, so both are known at every row of
a recording before any of it is predicted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.compiled import jit
from hydro.core.effects import Program, assemble, sensor, velocity_log
from hydro.core.effects.catalogue import entries, with_role
from hydro.core.effects.layout import MOTION, POSITION, ROTATION, TIME, VELOCITY
from hydro.core.effects.program import (
    heed,
    in_sea,
    relative_to_water,
    remembering,
    seas,
    start,
    thrusters_of,
    wrench,
)
from hydro.core.effects.record import Role
from hydro.core.recording.arrays import Recording
from hydro.core.simulation.dynamics import accelerate, propel
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation_kernel
from hydro.core.vehicle.thrusters import TIME_CONSTANT, lag_states

COMMANDED = with_role(Role.COMMANDED)
"""Effects that may obey commands, which jump at a row."""


@dataclass(frozen=True)
class Candidate:
    """A vehicle in numbers.

    Attributes:
        program: Its forces and thrusters.
        log: Its velocity log, (13,) of `core.effects.sensor`.
        seas: What the waves of its file are drawn from (`program.seas`), which its program is without.
    """

    program: Program
    log: Array
    seas: tuple[Callable[[Array], Array], ...] = ()

    @property
    def thrusters(self) -> Array:
        """The thruster table, (n, COLUMNS)."""
        table: Array = thrusters_of(self.program.flat)
        return table

    def in_sea(self, harmonics: Array) -> Candidate:
        """The same in waves, rows of `core.effects.waves`, (H, COMPONENT)."""
        return replace(self, program=in_sea(self.program, harmonics))


def candidate(vehicle: Vehicle) -> Candidate:
    """Compile a vehicle.

    Raises:
        DataError: An effect that the catalogue does not admit.
    """
    listed = entries(vehicle)
    return Candidate(assemble(vehicle, listed), velocity_log(vehicle, listed), tuple(seas(vehicle, listed)))


def rotor_states(model: Candidate, record: Recording) -> Array:
    """Lag states of the thrusters just before every row, (N, n)."""
    out = np.empty(record.commands.shape)
    for (first, last), resumed in zip(record.segments, record.after_gap, strict=True):
        t = record.t[first:last]
        out[first:last] = lag_states(
            model.thrusters, record.commands[first:last], t, t, settled=bool(resumed)
        )
    return out


def rotor_states_around(model: Candidate, record: Recording) -> Array:
    """The same, but the mean of just before and just after: a rotor without lag jumps at a row."""
    before = rotor_states(model, record)
    if (model.thrusters[:, TIME_CONSTANT] > 0.0).all():
        return before
    after = np.empty_like(before)
    for (first, last), resumed in zip(record.segments, record.after_gap, strict=True):
        t = record.t[first:last]
        after[first:last] = lag_states(
            model.thrusters, record.commands[first:last], t, t + 1e-6 * record.dt, settled=bool(resumed)
        )
    return 0.5 * (before + after)


def true_velocity(model: Candidate, record: Recording, logged: Array) -> Array:
    """Velocity of CO behind what the candidate's velocity log wrote down, (N, 6)."""
    if not model.log.any():
        return logged
    return np.vstack([sensor.corrected(model.log, record.t[a:b], logged[a:b]) for a, b in record.segments])


def memories(model: Candidate, record: Recording, eta: Array, nu: Array) -> Array:
    """Internal states of the effects at every row of a known motion, (N, states).

    Each segment begins as if its first velocity had always been.
    """
    out = np.zeros((record.rows, model.program.states))
    if model.program.states:
        _remember(remembering(model.program.flat), eta, nu, record.t, record.segments, record.dt, out)
    return out


def accelerations(model: Candidate, record: Recording, eta: Array, nu: Array) -> Array:
    """Acceleration of CO over ground that the candidate's forces give along a known motion, (N, 6)."""
    rotors = rotor_states_around(model, record)
    return accelerations_at(np.arange(record.rows), model, record, eta, nu, rotors)


def accelerations_at(
    rows: Rows, model: Candidate, record: Recording, eta: Array, nu: Array, rotors: Array
) -> Array:
    """The same at some rows (K,), where the lag states of the thrusters are `rotors` (K, n); (K, 6)."""
    out = np.empty((rows.size, 6))
    memory = memories(model, record, eta, nu)[rows]
    along = (model.program.flat, eta[rows], nu[rows], record.t[rows])
    _accelerate_along(*along, record.commands[rows], rotors, memory, out)
    if any(name in COMMANDED for name in model.program.effects):
        before = np.empty_like(out)
        _accelerate_along(*along, commands_before(record)[rows], rotors, memory, before)
        out = 0.5 * (out + before)
    return out


def commands_before(record: Recording) -> Array:
    """Commands just before each row, those of the row before it; of a segment's first row its own. (N, n)."""
    previous = np.arange(-1, record.rows - 1)
    previous[record.segments[:, 0]] += 1
    return record.commands[previous]


@jit
def move(flat: Array, eta: Array, nu: Array, t: float, s: Array) -> None:
    """Write the state of motion `s` of one row of a recording."""
    s[TIME] = t
    s[POSITION : POSITION + 3] = eta[:3]
    s[VELOCITY : VELOCITY + 6] = nu
    rotation_kernel(eta[3], eta[4], eta[5], s[ROTATION : ROTATION + 9])
    relative_to_water(flat, s)


@jit
def _remember(flat: Array, eta: Array, nu: Array, t: Array, segments: Rows, dt: float, out: Array) -> None:
    """Heun's method from row to row."""
    count = out.shape[1]
    s, unused = np.zeros(MOTION), np.zeros(6)
    here, there = np.zeros(count), np.zeros(count)
    for m in range(segments.shape[0]):
        for k in range(segments[m, 0], segments[m, 1]):
            move(flat, eta[k], nu[k], t[k], s)
            if k == segments[m, 0]:
                start(flat, s, out[k])
            else:
                wrench(flat, s, out[k - 1] + dt * here, there, unused)
                out[k] = out[k - 1] + 0.5 * dt * (here + there)
            wrench(flat, s, out[k], here, unused)


@jit
def _accelerate_along(
    flat: Array, eta: Array, nu: Array, t: Array, commands: Array, rotors: Array, memory: Array, out: Array
) -> None:
    s, tau, rates = np.zeros(MOTION), np.zeros(6), np.zeros(memory.shape[1])
    for k in range(out.shape[0]):
        move(flat, eta[k], nu[k], t[k], s)
        heed(commands[k], s)
        tau[:] = 0.0
        propel(flat, s, rotors[k], tau)
        accelerate(flat, s, memory[k], rates, tau, out[k])
