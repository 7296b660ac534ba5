"""Which manoeuvre to fly next, by prediction.

Rivals are vehicles that explain a recording about as well, by different effects.  Each short manoeuvre of a
library is simulated; the one in which the rivals would differ most, in units of the sensors' noise, is the
one to fly.  They are compared as a diagnosis would compare them: over shots of two seconds whose beginnings
are free (`identification.multiple_shooting`), so that what a little other beginning could imitate does not
count.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from hydro.core.columns import DOF, Array, command_columns
from hydro.core.effects import Program, assemble, inertia_matrix
from hydro.core.effects.sensor import DELAY
from hydro.core.errors import DataError
from hydro.core.identification import multiple_shooting
from hydro.core.identification.candidate import candidate
from hydro.core.identification.normal_equations import eliminate
from hydro.core.identification.parameters import LONGEST_SENSOR_DELAY, free
from hydro.core.recording.arrays import Recording
from hydro.core.simulation.dynamics import NO_HULL
from hydro.core.simulation.excitation import HEAVE, LOG_RATE, PITCH, ROLL, SURGE, SWAY, YAW
from hydro.core.simulation.simulate import trajectory
from hydro.core.simulation.steady_motion import fluid_wrench, wrench_limits
from hydro.core.vehicle.control_allocation import Mixing, mixing, mixing_kernel
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import quaternion_from_euler
from hydro.core.vehicle.rigid_body import balance
from hydro.core.vehicle.thrusters import DEADBAND

FLIGHT_LENGTH = 30.0
"""Length of every manoeuvre [s]."""
DEPTH = 5.0
"""Depth at which a manoeuvre begins where nothing else is said [m]."""
CHIRP = (0.05, 2.0)
"""First and last frequency of a chirp [Hz]."""
STATIC_TILT = np.deg2rad(15.0)
"""Tilt at which a vehicle is held, as far as its thrusters can [rad]."""
SINGLE = 0.6
"""Command of a thruster on its own."""
LEAST_SHARE = 0.02  # of the authority: the torque of a slow turn on a vehicle without damping


@dataclass(frozen=True)
class Manoeuvre:
    """A command table with a name.

    Attributes:
        name: In one or two words.
        words: What to fly, for a pilot.
        commands: (N, n) in [-1, 1]; row k is held on [t_k, t_k+1), t_k = k / `excitation.RATE`.
    """

    name: str
    words: str
    commands: Array

    @property
    def t(self) -> Array:
        """Times of the rows [s], (N,)."""
        times: Array = np.arange(len(self.commands)) / LOG_RATE
        return times

    def table(self) -> pl.DataFrame:
        """The commands as `hydro simulate` reads them: session, t, cmd_1 ... cmd_n."""
        given = dict(zip(command_columns(self.commands.shape[1]), self.commands.T, strict=True))
        session = [self.name.replace(" ", "_")] * len(self.commands)
        return pl.DataFrame({"session": session, "t": self.t} | given)


@dataclass(frozen=True)
class Flight:
    """A manoeuvre and what it would show.

    Attributes:
        manoeuvre: What to fly.
        difference: Predicted difference between the two rivals hardest to part, in standard deviations of
            the noise: the root of the sum of squares over all that is logged.
    """

    manoeuvre: Manoeuvre
    difference: float


def best(rivals: Sequence[Vehicle], noise: ArrayLike, *, start: ArrayLike | None = None) -> Flight:
    """The manoeuvre that tells rivals apart.

    Args:
        rivals: Two vehicles or more with the same thrusters; the manoeuvres are those of the first.
        noise: Standard deviations of position, attitude, velocity and rates, (12,) [m, rad, m/s, rad/s].
        start: Pose at which it begins, at rest, (6,); by default level, heading north, 5 m deep.

    Raises:
        DataError: Fewer than two rivals, or no manoeuvre that their thrusters can fly and that stays finite.
    """
    if len(rivals) < 2:
        raise DataError("give at least two vehicles to tell apart")
    flights = []
    for manoeuvre, gram in _grams(rivals[0], rivals[1:], noise, start):
        size = np.diag(gram)
        apart = size[:, None] + size - 2.0 * gram
        pairs = [*size, *apart[np.triu_indices(len(size), 1)]]
        flights.append(Flight(manoeuvre, float(np.sqrt(max(min(pairs), 0.0)))))
    return max(flights, key=lambda flight: flight.difference)


def showing(
    vehicle: Vehicle, changed: Mapping[str, Vehicle], noise: ArrayLike, *, start: ArrayLike | None = None
) -> dict[str, Flight]:
    """The manoeuvre in which each change of a vehicle would show most.

    Args:
        vehicle: The vehicle.
        changed: The vehicle with an effect of `plain` size, by the effect's name.
        noise: As for `best`.
        start: As for `best`.

    Raises:
        DataError: No manoeuvre that the vehicle's thrusters can fly and that stays finite.
    """
    found: dict[str, Flight] = {}
    for manoeuvre, gram in _grams(vehicle, list(changed.values()), noise, start):
        for name, size in zip(changed, np.sqrt(np.maximum(np.diag(gram), 0.0)), strict=True):
            if name not in found or size > found[name].difference:
                found[name] = Flight(manoeuvre, float(size))
    return found


def plain(vehicle: Vehicle, effect: str, entries: Sequence[int] | None = None) -> Vehicle:
    """The vehicle with more of an effect, by as much as would be plain to see.

    Args:
        vehicle: The vehicle.
        effect: Name in the catalogue.
        entries: Which of its free entries, in the order of `parameters.free`; by default all.

    Raises:
        DataError: The name is not in the catalogue, or the file has several of the effect.
    """
    unknown = free(vehicle, [effect])
    chosen = range(len(unknown.entries)) if entries is None else entries
    values = unknown.starts[0].copy()
    values[list(chosen)] += unknown.scales[list(chosen)]
    return unknown.at(unknown.within(values))


def library(vehicle: Vehicle) -> tuple[Manoeuvre, ...]:
    """The manoeuvres that a vehicle's thrusters can fly, open loop.

    Raises:
        DataError: The vehicle has no thrusters, or an effect or thruster of its file is at fault.
    """
    program = assemble(vehicle)
    mixed = mixing(vehicle, inertia_matrix(vehicle))
    mixes = (_mixed(mixed, *demand) for demand in _demands(vehicle, program, mixed))
    felt = mixed.table[:, DEADBAND]
    flown = [one for one in mixes if (np.abs(one.commands) > felt).any()]
    if len(vehicle.thruster):
        words = "each thruster on its own, half ahead and half astern, in turn"
        flown.append(Manoeuvre("single thrusters", words, _single(len(vehicle.thruster))))
    if not flown:
        raise DataError(f"vehicle {vehicle.name} has no thrusters, so that there is nothing to fly")
    return tuple(flown)


def _demands(vehicle: Vehicle, program: Program, mixed: Mixing) -> Iterator[tuple[str, str, Array]]:
    """Name, words and demanded wrench (N, 6) of each manoeuvre whose axes the vehicle has."""
    stiffness, axes = max(float(balance(vehicle)[3]), 0.0), set(mixed.axes)
    limits = wrench_limits(program, NO_HULL, np.full(2, stiffness))
    # A vehicle file without damping knows no greatest speed.
    full = np.where(limits > 0.0, np.minimum(mixed.authority, limits), mixed.authority)

    def held(*parts: Mapping[int, float]) -> Array:
        """Shares of the greatest wrench, each held for an equal part of the time."""
        shares = np.zeros((len(parts), 6))
        for row, part in zip(shares, parts, strict=True):
            row[list(part)] = list(part.values())
        return np.repeat(shares * full, _rows() // len(parts) + 1, axis=0)[: _rows()]

    if {SURGE, YAW} <= axes:  # a turn of 360 degrees
        drag = abs(fluid_wrench(program, NO_HULL, 2.0 * np.pi / FLIGHT_LENGTH * np.eye(6)[YAW])[YAW])
        turn = min(max(float(drag / full[YAW]), LEAST_SHARE), 0.5)
        words = "hold one thrust ahead and turn slowly through all headings"
        yield "heading sweep", words, held({SURGE: 0.4, YAW: turn})
    for axis, there, back in ((SURGE, "ahead", "astern"), (SWAY, "to starboard", "to port")):
        if axis in axes:
            words = f"full thrust {there}, then full thrust {back}"
            yield f"full speed in {DOF[axis]}", words, held({axis: 1.0}, {axis: -1.0})
    for axis in (SURGE, SWAY, HEAVE, YAW):
        if axis in axes:
            words = f"steps of {DOF[axis]} thrust, both ways, and coast down without thrust after each"
            yield f"{DOF[axis]} step and coast", words, held({axis: 0.8}, {}, {axis: -0.8}, {})
            words = f"a chirp on {DOF[axis]} from {CHIRP[0]:g} to {CHIRP[1]:g} Hz"
            yield f"{DOF[axis]} chirp", words, np.outer(0.6 * _chirp(), full * np.eye(6)[axis])
    if HEAVE in axes:
        words = "dive and hold, at two depths"
        yield "dives", words, held({HEAVE: 0.5}, {}, {HEAVE: 0.5}, {})
    if {SURGE, SWAY} <= axes:
        drifts = [{SURGE: u, SWAY: side * u} for u in (0.35, 0.9) for side in (0.5, -1.0)]
        words = "straight runs at two drift angles, at a third of the thrust and at nine tenths"
        yield "drift angles", words, held(*drifts)
    tilts = [axis for axis in (ROLL, PITCH) if axis in axes]
    if tilts:
        share = [min(stiffness * np.sin(STATIC_TILT) / full[axis], 1.0) for axis in tilts]
        poses = [{a: sign * s} for a, s in zip(tilts, share, strict=True) for sign in (1.0, -1.0)]
        words = "hold still at tilts of 15 degrees, both ways in " + " and ".join(DOF[a] for a in tilts)
        yield "static tilts", words, held(*poses)


def _rows() -> int:
    return round(FLIGHT_LENGTH * LOG_RATE)


def _chirp() -> Array:
    """Logarithmic sine sweep of amplitude 1, (N,)."""
    t, growth = np.arange(_rows()) / LOG_RATE, np.log(CHIRP[1] / CHIRP[0]) / FLIGHT_LENGTH
    swept: Array = np.sin(2.0 * np.pi * CHIRP[0] * np.expm1(growth * t) / growth)
    return swept


def _single(thrusters: int) -> Array:
    """Commands (N, n) of one thruster after the other."""
    turn = np.arange(_rows()) * 2 * thrusters // _rows()
    out = np.zeros((_rows(), thrusters))
    out[np.arange(_rows()), turn // 2] = np.where(turn % 2, -SINGLE, SINGLE)
    return out


def _mixed(mixed: Mixing, name: str, words: str, demand: Array) -> Manoeuvre:
    commands = np.zeros((len(demand), len(mixed.table)))
    for tau, row in zip(demand, commands, strict=True):
        mixing_kernel(mixed.allocation, mixed.table, tau, row)
    return Manoeuvre(name, words, commands)


def _grams(
    reference: Vehicle, others: Sequence[Vehicle], noise: ArrayLike, start: ArrayLike | None
) -> Iterator[tuple[Manoeuvre, Array]]:
    """Each manoeuvre, with the products (R, R) of how the others would differ from the reference in it."""
    sigma = np.asarray(noise, float)
    pose = np.array([0.0, 0.0, DEPTH, 0.0, 0.0, 0.0]) if start is None else np.asarray(start, float)
    models = [candidate(vehicle) for vehicle in (reference, *others)]
    lead = LONGEST_SENSOR_DELAY if any(model.log[DELAY] for model in models) else 0.0
    flown = 0
    for manoeuvre in library(reference):
        try:
            motion = trajectory(models[0].program, manoeuvre.commands, manoeuvre.t, eta=pose, steps=1)
        except DataError:  # a motion that diverges is none to propose
            continue
        record = _record(manoeuvre, motion)
        shots = multiple_shooting.make_shots(record, lead=lead, sigma=sigma)
        state = np.hstack([motion[:, :3], quaternion_from_euler(*motion[:, 3:6].T), motion[:, 6:]])
        shots = replace(shots, first=state[shots.starts])
        own, *rest = (multiple_shooting.prepare(model, shots) for model in models)
        shots = replace(shots, measured=multiple_shooting.predict(own, shots))
        moved = [
            multiple_shooting.displaced(shots.first, step[None]) for step in np.diag(multiple_shooting.NUDGE)
        ]
        columns = [multiple_shooting.residuals(own, shots, first) for first in moved]
        columns += [multiple_shooting.residuals(other, shots) for other in rest]
        flat = np.stack([column.reshape(len(column), -1) for column in columns], axis=-1)
        flat[..., : multiple_shooting.CHANNELS] /= multiple_shooting.NUDGE
        if not np.isfinite(flat).all():
            continue
        left, _ = eliminate(
            flat.transpose(0, 2, 1) @ flat, multiple_shooting.CHANNELS, multiple_shooting.TRUST**-2
        )
        flown += 1
        yield manoeuvre, left.sum(axis=0)
    if not flown:
        raise DataError(f"every manoeuvre of vehicle {reference.name} diverges; check its damping")


def _record(manoeuvre: Manoeuvre, motion: Array) -> Recording:
    """A predicted motion (N, 12) as a recording of one session."""
    rows = len(motion)
    return Recording(
        t=manoeuvre.t,
        eta=motion[:, :6].copy(),
        nu=motion[:, 6:].copy(),
        commands=np.ascontiguousarray(manoeuvre.commands),
        segments=np.array([[0, rows]], np.int64),
        after_gap=np.zeros(1, bool),
        session=np.zeros(1, np.int64),
        dt=1.0 / LOG_RATE,
    )
