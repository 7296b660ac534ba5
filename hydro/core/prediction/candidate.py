"""Compiled vehicle for comparison with a recording: its program, DVL errors and internal states.

Rotor states depend on the commands alone, and fluid memory states on the motion alone.  So both are known at
every row of a recording before any prediction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.compiled import copy_kernel, jit, kernel
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
    with_thrusters,
    wrench,
)
from hydro.core.effects.record import Role
from hydro.core.recording.arrays import Recording
from hydro.core.simulation.dynamics import respond
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation_kernel
from hydro.core.vehicle.thrusters import TIME_CONSTANT, lag_states

COMMANDED = with_role(Role.COMMANDED)
"""Names of effects that may depend on commands, which jump at a row."""


@dataclass(frozen=True)
class Candidate:
    """Vehicle, compiled for comparison with a recording.

    Attributes:
        program: Compiled forces and thrusters, in calm water.
        log: Errors of the DVL, and the reference point of the logged position, (16,), see
            `core.effects.sensor`.
        seas: Generators of wave harmonics, one for each wave effect of the vehicle file, see
            `effects.program.seas`.
    """

    program: Program
    log: Array
    seas: tuple[Callable[[Array], Array], ...] = ()

    @property
    def thrusters(self) -> Array:
        """Thruster table of the n thrusters, (n, COLUMNS)."""
        table: Array = thrusters_of(self.program.flat)
        return table

    def with_thrusters(self, rows: Array) -> Candidate:
        """Return a copy of the compiled vehicle with additional thrusters, after its own.

        Args:
            rows: Constants of the n additional thrusters, as in `vehicle.thrusters`, (n, COLUMNS).
        """
        return replace(self, program=with_thrusters(self.program, rows))

    def in_sea(self, harmonics: Array) -> Candidate:
        """Return a copy of the compiled vehicle in waves.

        Args:
            harmonics: H harmonics of a sea, rows of `core.effects.waves`, (H, COMPONENT).
        """
        return replace(self, program=in_sea(self.program, harmonics))


def candidate(vehicle: Vehicle) -> Candidate:
    """Return a vehicle compiled for comparison with a recording.

    Raises:
        DataError: An effect is not valid in the catalogue.
    """
    listed = entries(vehicle)
    return Candidate(assemble(vehicle, listed), velocity_log(vehicle, listed), tuple(seas(vehicle, listed)))


def rotor_states(model: Candidate, record: Recording) -> Array:
    """Return the lag states of n thrusters just before the command of each of N rows, (N, n).

    A lag state is a thrust [N] before losses, or a normalised rotor speed.

    Args:
        model: Compiled vehicle, with its thrusters.
        record: Recording, with its commands.
    """
    out = np.empty(record.commands.shape)
    for (first, last), resumed in zip(record.segments, record.after_gap, strict=True):
        t = record.t[first:last]
        out[first:last] = lag_states(
            model.thrusters, record.commands[first:last], t, t, settled=bool(resumed)
        )
    return out


def rotor_states_around(model: Candidate, record: Recording) -> Array:
    """Return the lag states of n thrusters in N rows, means of just before and just after the row, (N, n).

    A lag state is a thrust [N] or a normalised rotor speed.  That of a thruster without lag jumps at a row.

    Args:
        model: Compiled vehicle, with its thrusters.
        record: Recording of N rows, with its commands.
    """
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
    """Return the velocity of CO over ground, corrected for DVL errors, body axes, (N, 6) [m/s, rad/s].

    Args:
        model: Vehicle, with the DVL errors to correct.
        record: Recording of N rows, for its times and segments.
        logged: Logged velocity, (N, 6) [m/s, rad/s].
    """
    if not model.log.any():
        return logged
    return np.vstack([sensor.corrected(model.log, record.t[a:b], logged[a:b]) for a, b in record.segments])


def memories(model: Candidate, record: Recording, eta: Array, nu: Array) -> Array:
    """Return the internal states of a vehicle's effects along a given motion, in every row, (N, states).

    Each segment starts in the steady state of its first velocity.

    Args:
        model: Compiled vehicle.
        record: Recording of N rows, for its times and segments.
        eta: Pose, NED, (N, 6) [m, rad].
        nu: Velocity of CO, body axes, (N, 6) [m/s, rad/s].
    """
    out = np.zeros((record.rows, model.program.states))
    if model.program.states:
        _remember(remembering(model.program.flat), eta, nu, record.t, record.segments, record.dt, out)
    return out


def accelerations(model: Candidate, record: Recording, eta: Array, nu: Array) -> Array:
    """Return the acceleration that a model gives in every row of a motion, (N, 6) [m/s^2, rad/s^2].

    It is that of CO over ground, body axes.

    Args:
        model: Compiled vehicle, with its forces.
        record: Recording of N rows, with its commands.
        eta: Pose, NED, (N, 6) [m, rad].
        nu: Velocity of CO, body axes, (N, 6) [m/s, rad/s].
    """
    rotors = rotor_states_around(model, record)
    return accelerations_at(np.arange(record.rows), model, record, eta, nu, rotors)


def accelerations_at(
    rows: Rows, model: Candidate, record: Recording, eta: Array, nu: Array, rotors: Array
) -> Array:
    """Return the acceleration that a model gives in K rows of a motion, (K, 6) [m/s^2, rad/s^2].

    It is that of CO over ground, body axes.

    Args:
        rows: Numbers of the K rows, (K,).
        model: Compiled vehicle, with its forces.
        record: Recording of N rows, with its commands.
        eta: Pose, NED, (N, 6) [m, rad].
        nu: Velocity of CO, body axes, (N, 6) [m/s, rad/s].
        rotors: Lag states of n thrusters in these rows, (K, n).
    """
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
    """Return the commands of n thrusters in the row before each of N rows, (N, n).

    The first row of a segment keeps its own commands.
    """
    previous = np.arange(-1, record.rows - 1)
    previous[record.segments[:, 0]] += 1
    return record.commands[previous]


@kernel
def move(flat: Array, eta: Array, nu: Array, t: float, s: Array) -> None:
    """Write to `s` the state of motion that the effects read, from pose and velocity.

    Args:
        flat: Compiled effects of a vehicle, see `effects.program`.
        eta: Pose, NED, (6,) [m, rad].
        nu: Velocity of CO, body axes, (6,) [m/s, rad/s].
        t: Time of the session [s].
        s: Output: state of motion, in the layout of `core.effects.layout`.
    """
    s[TIME] = t
    copy_kernel(eta, s[POSITION : POSITION + 3])
    copy_kernel(nu, s[VELOCITY : VELOCITY + 6])
    rotation_kernel(eta[3], eta[4], eta[5], s[ROTATION : ROTATION + 9])
    relative_to_water(flat, s)


@jit
def _remember(flat: Array, eta: Array, nu: Array, t: Array, segments: Rows, dt: float, out: Array) -> None:
    """Integrate the internal states of effects by Heun's method from row to row, into `out` (N, states)."""
    count = out.shape[1]
    s, unused = np.zeros(MOTION), np.zeros(6)
    here, there, ahead = np.zeros(count), np.zeros(count), np.zeros(count)
    for m in range(segments.shape[0]):
        for k in range(segments[m, 0], segments[m, 1]):
            move(flat, eta[k], nu[k], t[k], s)
            if k == segments[m, 0]:
                start(flat, s, out[k])
            else:
                for i in range(count):
                    ahead[i] = out[k - 1, i] + dt * here[i]
                wrench(flat, s, ahead, there, unused)
                for i in range(count):
                    out[k, i] = out[k - 1, i] + 0.5 * dt * (here[i] + there[i])
            wrench(flat, s, out[k], here, unused)


@jit
def _accelerate_along(
    flat: Array, eta: Array, nu: Array, t: Array, commands: Array, rotors: Array, memory: Array, out: Array
) -> None:
    """Write the acceleration at every row of a motion to `out` (K, 6)."""
    s, tau, rates = np.zeros(MOTION), np.zeros(6), np.zeros(memory.shape[1])
    for k in range(out.shape[0]):
        move(flat, eta[k], nu[k], t[k], s)
        heed(commands[k], s)
        respond(flat, s, rotors[k], memory[k], rates, tau, out[k])
