"""Vehicle in water for a GPU: `sim.bridge.water.Water` without MuJoCo.

Without MuJoCo, M nu_r_dot + C(nu_r) nu_r is balanced as a whole (`core.simulation.dynamics`).  M is M_RB plus
the inertia added to MuJoCo's mass matrix.  The part of C(nu) nu that MuJoCo does not exert is cancelled
together with the held wrench of a residual network (`core.simulation.held`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.layout import INVERSE_MASS_MATRIX, MASS_MATRIX, RELATIVE_VELOCITY, VELOCITY
from hydro.core.effects.program import constants_of
from hydro.core.errors import UsageError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.sim.bridge.water import Water
from hydro.sim.gpu import memory
from hydro.sim.residual.control import tables_of

if TYPE_CHECKING:
    from hydro.sim.gpu.kernels import Control


class Craft(NamedTuple):
    """Vehicle in water.

    Attributes:
        program: Its program, with the mass matrix of the water model.
        inertia: Part of the inertia that must not exert C(nu) nu, (36,) row by row.
    """

    program: Array
    inertia: Array

    @classmethod
    def of(cls, vehicle: Vehicle, felt: Water) -> Craft:
        """Return a vehicle with the given water forces.

        Raises:
            UsageError: The water has forces that only MuJoCo can compute.
        """
        if felt.held or felt.ellipsoid:
            raise UsageError("wrenches of the host and MuJoCo's own fluid forces do not act on a GPU")
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
        """Key that is equal for identical vehicles."""
        return self.program.tobytes() + self.inertia.tobytes()


def control_of(felt: Water, count: int) -> Control:
    """Return the residual network on the device, with its states for each vehicle."""
    from hydro.sim.gpu.kernels import Control

    if felt.control is None:
        none = np.zeros(1), np.zeros((1, 6, 2)), np.zeros((1, 1)), np.zeros(1, np.float32)
        block, gains, program, weights = (memory.put(array) for array in none)
        return Control(block, gains, program, weights, memory.zeros((count, 1)), VELOCITY)
    tables = tables_of(felt.control.encode(), felt.control.network.weights)
    block, gains, program, weights = (memory.put(array) for array in tables)
    asked = RELATIVE_VELOCITY if felt.drifting else VELOCITY
    return Control(block, gains, program, weights, memory.zeros((count, felt.control.states)), asked)
