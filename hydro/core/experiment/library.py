"""Library of open-loop manoeuvres that a vehicle's thrusters can run, as named command tables.

Each manoeuvre excites the differences between some effects.  Heading sweeps show a current, coasting
separates the kinds of damping, and drift angles show lift.  Static tilts show weight and trim, chirps show
lags and added mass, and single thrusters show their gains.  Sines on all axes show effects that need several
motions at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from hydro.core.columns import DOF, Array, command_columns
from hydro.core.effects import Program, assemble, inertia_matrix
from hydro.core.errors import DataError
from hydro.core.recording.supply import given_commands
from hydro.core.simulation.dynamics import NO_HULL
from hydro.core.simulation.excitation import HEAVE, LOG_RATE, PITCH, ROLL, SURGE, SWAY, YAW
from hydro.core.simulation.steady_motion import fluid_wrench, wrench_limits
from hydro.core.vehicle.control_allocation import Mixing, mixing, mixing_kernel
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import balance
from hydro.core.vehicle.thrusters import DEADBAND, POWER, thruster_table

FLIGHT_LENGTH = 30.0
"""Default duration of a manoeuvre [s]."""
CHIRP = (0.05, 2.0)
"""First and last frequency of a chirp [Hz]."""
STATIC_TILT = np.deg2rad(15.0)
"""Tilt at which a manoeuvre holds the vehicle, or the largest that the thrusters reach [rad]."""
LEVELS = (0.1, 0.3, 0.6, 1.0)
"""Shares of the greatest thrust: their steady speeds separate linear drag from drag that grows with speed."""
SINGLE = 0.6
"""Command of a thruster that runs alone [1]: fast enough to show its gain, below saturation."""
ALL_AXES = 0.6
"""Share of the greatest thrust on each axis when all axes are excited at once."""
FASTEST = 0.5
"""Highest frequency of a multisine [Hz]."""
LEAST_SHARE = 0.02
"""Minimum share of the yaw authority in a slow turn, for a vehicle without damping."""


@dataclass(frozen=True)
class Manoeuvre:
    """Manoeuvre: a table of thruster commands with a name.

    Attributes:
        name: Name of one or two words.
        words: Instructions for a pilot.
        commands: Effective commands (`recording.supply`) of n thrusters in N rows, in [-1, 1], (N, n).  Row k
            is held on [t_k, t_k+1), t_k = k / `excitation.LOG_RATE`.
        vehicle: Vehicle whose thrust curves convert effective to real commands; None if `commands` are real
            commands.
    """

    name: str
    words: str
    commands: Array
    vehicle: Vehicle | None = None

    @property
    def t(self) -> Array:
        """Times of the rows [s], (N,)."""
        times: Array = np.arange(len(self.commands)) / LOG_RATE
        return times

    @property
    def seconds(self) -> float:
        """Duration of the manoeuvre [s]."""
        return len(self.commands) / LOG_RATE

    def thrusting(self, share: float, powers: Array) -> Manoeuvre:
        """Return a new manoeuvre with all thrusts scaled by a factor.

        Args:
            share: Factor on every thrust (not on the commands), 0 to 1.
            powers: Exponents p of the n thrust curves, thrust ~ |command|^p, (n,), from `powers`.
        """
        commands = np.sign(self.commands) * np.abs(self.commands) * share ** (1.0 / powers)
        return replace(self, commands=commands.astype(np.float32).astype(np.float64))

    def table(self) -> pl.DataFrame:
        """Return a table for `hydro simulate`: session, t [s], real commands cmd_1 to cmd_n, -1 to 1."""
        commands = self.commands if self.vehicle is None else given_commands(self.vehicle, self.commands)
        given = dict(zip(command_columns(self.commands.shape[1]), commands.T, strict=True))
        session = [self.name.replace(" ", "_")] * len(self.commands)
        return pl.DataFrame({"session": session, "t": self.t} | given)


def powers(vehicle: Vehicle) -> Array:
    """Return the exponents p of n thrust curves, (n,): thrust is proportional to |command|^p."""
    found: Array = thruster_table(vehicle)[:, POWER]
    return found


def library(
    vehicle: Vehicle, seconds: float = FLIGHT_LENGTH, *, by_hand: bool = True
) -> tuple[Manoeuvre, ...]:
    """Return the open-loop manoeuvres that a vehicle's thrusters can run.

    Args:
        vehicle: The vehicle.
        seconds: Duration of each manoeuvre [s].
        by_hand: Whether to return only manoeuvres that a pilot can steer; False adds sums of sines on all
            axes at once, which need a command table.

    Raises:
        DataError: The vehicle has no thrusters, or an effect or thruster of its file is invalid.
    """
    program = assemble(vehicle)
    mixed = mixing(vehicle, inertia_matrix(vehicle))
    rows = round(seconds * LOG_RATE)
    demands = [*_demands(vehicle, program, mixed, rows)]
    if not by_hand and len(mixed.axes) > 1:
        words = "sums of sines on all axes at once, no frequency on two of them"
        demand = ALL_AXES * _multisines(rows, sorted(mixed.axes)) * _greatest_wrench(vehicle, program, mixed)
        demands.append(("all axes", words, demand))
    mixes = [_manoeuvre(mixed, *demand) for demand in demands]
    felt = mixed.table[:, DEADBAND]
    flown = [one for one in mixes if (np.abs(one.commands) > felt).any()]
    if len(vehicle.thruster):
        words = "each thruster on its own, half ahead and half astern, in turn"
        flown.append(Manoeuvre("single thrusters", words, _single_thrusters(len(vehicle.thruster), rows)))
    if not flown:
        raise DataError(f"vehicle {vehicle.name} has no thrusters, so it cannot run a manoeuvre")
    return tuple(replace(one, vehicle=vehicle) for one in flown)


def _demands(
    vehicle: Vehicle, program: Program, mixed: Mixing, rows: int
) -> Iterator[tuple[str, str, Array]]:
    """Yield name, instructions and demanded wrench (N, 6) [N, N m] of manoeuvres on the controllable axes."""
    stiffness, axes = _stiffness(vehicle), set(mixed.axes)
    full = _greatest_wrench(vehicle, program, mixed)

    def held(*parts: Mapping[int, float]) -> Array:
        """Return a wrench, (N, 6), that holds each of several demands, shares by axis, for an equal time."""
        shares = np.zeros((len(parts), 6))
        for row, part in zip(shares, parts, strict=True):
            row[list(part)] = list(part.values())
        return np.repeat(shares * full, rows // len(parts) + 1, axis=0)[:rows]

    if {SURGE, YAW} <= axes:  # a turn of 360 degrees
        drag = abs(fluid_wrench(program, NO_HULL, 2.0 * np.pi * LOG_RATE / rows * np.eye(6)[YAW])[YAW])
        turn = min(max(float(drag / full[YAW]), LEAST_SHARE), 0.5)
        words = "hold one thrust ahead and turn slowly through all headings"
        yield "heading sweep", words, held({SURGE: 0.4, YAW: turn})
    for axis, there, back in ((SURGE, "ahead", "astern"), (SWAY, "to starboard", "to port")):
        if axis in axes:
            words = f"full thrust {there}, then full thrust {back}"
            yield f"full speed in {DOF[axis]}", words, held({axis: 1.0}, {axis: -1.0})
    for axis in (SURGE, SWAY, HEAVE, YAW):
        if axis in axes:
            words = f"{DOF[axis]} thrust at four levels from a tenth to full, one after the other"
            yield f"{DOF[axis]} levels", words, held(*({axis: share} for share in LEVELS))
            words = f"steps of {DOF[axis]} thrust, both ways, and coast down without thrust after each"
            yield f"{DOF[axis]} step and coast", words, held({axis: 0.8}, {}, {axis: -0.8}, {})
            words = f"a chirp on {DOF[axis]} from {CHIRP[0]:g} to {CHIRP[1]:g} Hz"
            yield f"{DOF[axis]} chirp", words, np.outer(0.6 * _chirp(rows), full * np.eye(6)[axis])
    if HEAVE in axes:
        words = "dive and hold, at two depths"
        yield "dives", words, held({HEAVE: 0.5}, {}, {HEAVE: 0.5}, {})
    if {SURGE, SWAY} <= axes:
        drifts = [{SURGE: u, SWAY: side * u} for u in (0.35, 0.9) for side in (0.5, -1.0)]
        words = "straight runs at two drift angles, at a third of the thrust and at nine tenths"
        yield "drift angles", words, held(*drifts)
    if {SURGE, YAW} <= axes:
        turns = [{SURGE: u, YAW: side} for u in (0.7, 0.3) for side in (0.3, -0.3)]
        words = "circles to both sides, at two speeds"
        yield "circles", words, held(*turns)
    tilts = [axis for axis in (ROLL, PITCH) if axis in axes]
    if tilts:
        share = [min(stiffness * np.sin(STATIC_TILT) / full[axis], 1.0) for axis in tilts]
        poses = [{a: sign * s} for a, s in zip(tilts, share, strict=True) for sign in (1.0, -1.0)]
        words = "hold still at tilts of 15 degrees, both ways in " + " and ".join(DOF[a] for a in tilts)
        yield "static tilts", words, held(*poses)


def _stiffness(vehicle: Vehicle) -> float:
    """Return the righting moment of a vehicle per sine of its tilt [N m]."""
    return max(float(balance(vehicle)[3]), 0.0)


def _greatest_wrench(vehicle: Vehicle, program: Program, mixed: Mixing) -> Array:
    """Return the largest wrench that a manoeuvre may demand on each axis, (6,) [N, N m].

    It is the authority of the thrusters, or less where the vehicle would overturn.
    """
    limits = wrench_limits(program, NO_HULL, np.full(2, _stiffness(vehicle)))
    # Without damping, no greatest wrench follows from the speed limits: use the authority.
    return np.where(limits > 0.0, np.minimum(mixed.authority, limits), mixed.authority)


def _chirp(rows: int) -> Array:
    """Return a logarithmic sine sweep of amplitude 1, (N,)."""
    t, growth = np.arange(rows) / LOG_RATE, np.log(CHIRP[1] / CHIRP[0]) * LOG_RATE / rows
    swept: Array = np.sin(2.0 * np.pi * CHIRP[0] * np.expm1(growth * t) / growth)
    return swept


def _multisines(rows: int, axes: Sequence[int]) -> Array:
    """Return orthogonal multisines of amplitude 1 on the given axes and 0 on the rest, (N, 6) (Morelli 2012).

    Harmonics are assigned to the axes in turn, so that no two axes share a frequency.  Low frequencies have
    larger amplitudes, because they produce speed.  Phases after Schroeder (1970) keep the peaks low.
    """
    t, out = np.arange(rows) / rows, np.zeros((rows, 6))
    highest = int(FASTEST * rows / LOG_RATE)
    for place, axis in enumerate(axes):
        harmonics = np.arange(place + 1, max(highest, len(axes)) + 1, len(axes))
        order = np.arange(1, len(harmonics) + 1)
        phases = -np.pi * order * (order - 1) / len(order)
        waves = np.sin(2.0 * np.pi * np.outer(t, harmonics) + phases) @ harmonics**-0.5
        out[:, axis] = waves / np.abs(waves).max()
    return out


def _single_thrusters(thrusters: int, rows: int) -> Array:
    """Return commands that run one thruster after another, each forward, then reverse, (N, thrusters)."""
    turn = np.arange(rows) * 2 * thrusters // rows
    out = np.zeros((rows, thrusters))
    out[np.arange(rows), turn // 2] = np.where(turn % 2, -SINGLE, SINGLE)
    return out


def _manoeuvre(mixed: Mixing, name: str, words: str, demand: Array) -> Manoeuvre:
    """Return the manoeuvre whose commands give the demanded wrench (N, 6) [N, N m] in each row."""
    commands = np.zeros((len(demand), len(mixed.table)))
    for tau, row in zip(demand, commands, strict=True):
        mixing_kernel(mixed.allocation, mixed.table, tau, row)
    return Manoeuvre(name, words, commands)
