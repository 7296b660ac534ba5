"""Vehicles in water without MuJoCo: `sim.bridge.water.Water` as arrays for the processor or a GPU.

Without MuJoCo, M nu_r_dot + C(nu_r) nu_r is balanced as a whole (`core.simulation.dynamics`).  M is M_RB plus
the inertia added to MuJoCo's mass matrix.  The part of C(nu) nu that MuJoCo does not exert is cancelled
together with the held wrench of a residual network (`core.simulation.held`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Array32
from hydro.core.effects.layout import INVERSE_MASS_MATRIX, MASS_MATRIX, RELATIVE_VELOCITY, VELOCITY
from hydro.core.effects.program import constants_of, thrusters_of
from hydro.core.errors import DataError, UsageError
from hydro.core.simulation.dynamics import NO_HULL
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.sim.bridge.water import Water
from hydro.sim.residual.control import tables_of

STEP = 0.01
"""Integration step [s]: a quarter of the control step, for a method of order 4."""

Put = Callable[[NDArray[Any]], Any]
"""Function that copies an array to where the vehicles are simulated."""


class Crafts(NamedTuple):
    """Compiled programs of N simulated vehicles, of which P are distinct.

    Attributes:
        programs: Programs of the P distinct vehicles, (P, L); shorter ones are padded with zeros to length L.
        tables: Thruster tables of the P programs, (P, n, columns), for n thrusters.
        kind: Index into `programs` for each of the N vehicles, (N,).
        facets: Empty array (8, 0): no hull geometry is used, only the forces of the vehicle file.
        inertia: Inertia whose Coriolis and centripetal forces a residual network cancels, (P, 36), each a 6x6
            matrix row by row.
    """

    programs: Array
    tables: Array
    kind: NDArray[np.int32]
    facets: Array
    inertia: Array


class Control(NamedTuple):
    """Residual network and its states for N vehicles; arrays of zeros without a network.

    Attributes:
        block: Parameters; this and the next three are those of `sim.residual.control.Tables`.
        gains: Gains of the filter.
        program: Program of the network.
        weights: Weights of the network.
        states: States of each vehicle, (N, states).
        felt: Index, in the state of motion, of the velocity that the network takes as input.
    """

    block: Array
    gains: Array
    program: Array
    weights: Array32
    states: Array
    felt: int


class Craft(NamedTuple):
    """Vehicle in water, compiled for simulation without MuJoCo.

    Attributes:
        program: Program of the vehicle, with the mass matrix of the water model.
        inertia: Inertia (36,), a 6x6 matrix row by row, whose Coriolis and centripetal forces C(nu) nu must
            not act, because the residual network contains them.
    """

    program: Array
    inertia: Array

    @classmethod
    def of(cls, vehicle: Vehicle, felt: Water) -> Craft:
        """Return a vehicle with given water forces, compiled for simulation without MuJoCo.

        Args:
            vehicle: Vehicle file.
            felt: Water forces on the vehicle.

        Raises:
            UsageError: The water has forces that only MuJoCo can compute.
        """
        if felt.held or felt.ellipsoid:
            raise UsageError(
                "wrenches of the host and MuJoCo's own fluid forces act only in MuJoCo: use its engine"
            )
        inertia, coriolis, cancelled = (
            np.zeros((6, 6)) if matrix is None else matrix
            for matrix in (felt.inertia, felt.coriolis, felt.cancelled)
        )
        taken = inertia - coriolis + cancelled
        if felt.control is None and taken.any():
            raise UsageError(f"{vehicle.name}: inertia without its Coriolis forces needs a residual network")
        program = felt.program.flat.copy()
        constants, M = constants_of(program), mass_matrix(vehicle) + inertia
        if not np.array_equal(constants[MASS_MATRIX : MASS_MATRIX + 36], M.ravel()):
            constants[MASS_MATRIX : MASS_MATRIX + 36] = M.ravel()
            constants[INVERSE_MASS_MATRIX : INVERSE_MASS_MATRIX + 36] = np.linalg.inv(M).ravel()
        return cls(program, taken.ravel())

    @property
    def key(self) -> bytes:
        """Bytes that identify the vehicle: equal for two vehicles with the same program and inertia."""
        return self.program.tobytes() + self.inertia.tobytes()


def first_of(
    vehicle: Vehicle, water: Callable[[Vehicle], Water], *, count: int, period: float, timestep: float
) -> tuple[Craft, Water]:
    """Return the first vehicle of a plant (a set of simulated vehicles) with its water forces.

    The arguments of the plant are checked first.

    Args:
        vehicle: Vehicle file.
        water: Function that returns the water forces of a vehicle.
        count: Number of vehicles.
        period: Control step [s].
        timestep: Maximum integration step [s].

    Raises:
        UsageError: A number is not positive, the network has another control step, or the water has forces
            that only MuJoCo can compute.
        DataError: The vehicle cannot be simulated, or has no thrusters.
    """
    for name, value in (("count", count), ("period", period), ("timestep", timestep)):
        if not 0 < value < np.inf:
            raise UsageError(f"{name}: expected a positive number, got {value:g}")
    felt = water(vehicle)
    _require_period(felt, period)
    first = Craft.of(vehicle, felt)
    if not len(thrusters_of(first.program)):
        raise DataError(f"{vehicle.name}: has no thrusters; add some to the vehicle file")
    return first, felt


def crafts_of(crafts: Sequence[Craft], kind: NDArray[np.int32], put: Put = np.array) -> Crafts:
    """Return distinct compiled vehicles as arrays for the kernels.

    Args:
        crafts: Distinct vehicles.
        kind: Index into `crafts` for each of the N simulated vehicles, (N,).
        put: Function that makes an array on the processor or a GPU.
    """
    rows = np.zeros((len(crafts), max(len(craft.program) for craft in crafts)))
    for row, craft in zip(rows, crafts, strict=True):
        row[: len(craft.program)] = craft.program
    tables = np.stack([thrusters_of(craft.program) for craft in crafts])
    inertias = np.stack([craft.inertia for craft in crafts])
    return Crafts(put(rows), put(tables), put(kind), put(NO_HULL), put(inertias))


def assigned(
    crafts: Sequence[Craft], kind: NDArray[np.int32], changes: dict[int, Craft]
) -> tuple[list[Craft], NDArray[np.int32]]:
    """Return the distinct vehicles after a replacement of simulated vehicles, and the new index of each.

    Args:
        crafts: Distinct vehicles in use.
        kind: Index into `crafts` for each of the N simulated vehicles, (N,); not changed.
        changes: New vehicle, by index of the simulated vehicle (0 to N - 1).

    Returns:
        The distinct vehicles in use after the change, and the new index into them for each of the N, (N,).
    """
    kind, pool = kind.copy(), list(crafts)
    rows = {craft.key: row for row, craft in enumerate(pool)}
    for number, craft in changes.items():
        kind[number] = rows.setdefault(craft.key, len(pool))
        if kind[number] == len(pool):
            pool.append(craft)
    kept, renamed = np.unique(kind, return_inverse=True)
    return [pool[row] for row in kept], renamed.astype(np.int32)


def control_of(felt: Water, count: int, put: Put = np.array) -> Control:
    """Return a residual network and its initial states for `count` vehicles, as arrays.

    Args:
        felt: Water forces, with the network or without; without, the arrays are zeros.
        count: Number of vehicles N.
        put: Function that makes an array on the processor or a GPU.
    """
    if felt.control is None:
        none = np.zeros(1), np.zeros((1, 6, 2)), np.zeros((1, 1)), np.zeros(1, np.float32)
        block, gains, program, weights = (put(array) for array in none)
        return Control(block, gains, program, weights, put(np.zeros((count, 1))), VELOCITY)
    tables = tables_of(felt.control.encode(), felt.control.network.weights)
    block, gains, program, weights = (put(array) for array in tables)
    asked = RELATIVE_VELOCITY if felt.drifting else VELOCITY
    return Control(block, gains, program, weights, put(np.zeros((count, felt.control.states))), asked)


def _require_period(felt: Water, period: float) -> None:
    """Check that the control step of a residual network is a multiple of `period` [s], that of the vehicles.

    Raises:
        UsageError: The control step is not a multiple.
    """
    if felt.control is None:
        return
    own = felt.control.period
    if own < period - 1e-9 or abs(own - round(own / period) * period) > 1e-9:
        raise UsageError(
            f"the network's control step is {own:g} s: set period={own:g}, or a whole fraction of it"
        )
