"""What of a vehicle in some water goes to a GPU: `sim.bridge.water.Water` without MuJoCo.

There M nu_r_dot + C(nu_r) nu_r is balanced as a whole (`core.simulation.dynamics`), with M = M_RB + the
inertia that MuJoCo's mass matrix is given; what MuJoCo exerts of C(nu) nu less than that is given back
beside the held wrench of a residual network (`core.simulation.held`).
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
    """A vehicle in some water.

    Attributes:
        program: Its program, with the mass matrix that accelerates there.
        inertia: Of that, what is not to exert C(nu) nu, (36,) row by row.
    """

    program: Array
    inertia: Array

    @classmethod
    def of(cls, vehicle: Vehicle, felt: Water) -> Craft:
        """A vehicle in water that it feels.

        Raises:
            UsageError: The water is such as MuJoCo alone has.
        """
        if felt.held or felt.ellipsoid:
            raise UsageError("wrenches of the host and MuJoCo's own fluid forces do not act on a GPU")
        inertia, coriolis, cancelled = (
            np.zeros((6, 6)) if matrix is None else matrix
            for matrix in (felt.inertia, felt.coriolis, felt.cancelled)
        )
        taken = inertia - coriolis + cancelled
        if felt.control is None and taken.any():
            raise UsageError(
                f"{vehicle.name}: inertia without its Coriolis forces flies beside a residual network alone"
            )
        program = felt.program.flat.copy()
        constants, M = constants_of(program), mass_matrix(vehicle) + inertia
        if not np.array_equal(constants[MASS_MATRIX : MASS_MATRIX + 36], M.ravel()):
            constants[MASS_MATRIX : MASS_MATRIX + 36] = M.ravel()
            constants[INVERSE_MASS_MATRIX : INVERSE_MASS_MATRIX + 36] = np.linalg.inv(M).ravel()
        return cls(program, taken.ravel())

    @property
    def key(self) -> bytes:
        """The same for vehicles that are alike."""
        return self.program.tobytes() + self.inertia.tobytes()


def control_of(felt: Water, count: int) -> Control:
    """The residual network of some water on the device, and what so many vehicles remember of it."""
    from hydro.sim.gpu.kernels import Control

    if felt.control is None:
        none = np.zeros(1), np.zeros((1, 6, 2)), np.zeros((1, 1)), np.zeros(1, np.float32)
        block, gains, program, weights = (memory.put(array) for array in none)
        return Control(block, gains, program, weights, memory.zeros((count, 1)), VELOCITY)
    tables = tables_of(felt.control.encode(), felt.control.network.weights)
    block, gains, program, weights = (memory.put(array) for array in tables)
    asked = RELATIVE_VELOCITY if felt.drifting else VELOCITY
    return Control(block, gains, program, weights, memory.zeros((count, felt.control.states)), asked)
