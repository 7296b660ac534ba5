"""What of the water a vehicle in MuJoCo feels, and how it travels in the model: as one numeric field.

The field begins with a header of counts and positions, exact as doubles, followed by blocks: two or three 6x6
matrices, the vehicle's compiled effects and thrusters (`core.effects.program`), and a residual network with
its filter and conditioning (`sim.residual.control`).  A block at position 0 is absent.  What only the
compiled model knows (addresses of body, velocity and activations) is -1 until `sim.bridge.native.prepare`
writes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE, Program, assemble, inertia_matrix
from hydro.core.effects.program import thrusters_of
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.core.vehicle.thrusters import DELAY
from hydro.sim.residual.control import Control, up_to_a_line

PREFIX = "hydro/"
"""A numeric field `hydro/<body>` holds the parameters of the vehicle whose body is `<body>`."""

MAGIC = 4859381026137.0  # no field of another's begins with it, and XML text keeps its 13 digits
VERSION = 8.0
AT_MAGIC, AT_VERSION = 0, 1
AT_BODY, AT_DOF = 2, 3  # of the free joint; prepared
AT_STATES, AT_CONTROL_STATES, AT_STARTED = 4, 5, 6  # where they begin in `act`; prepared
AT_INERTIA = 7  # matrix added to M
AT_CORIOLIS = 8  # matrix whose Coriolis wrench of nu_r is exerted
AT_CANCELLED = 9  # matrix whose Coriolis wrench is taken away
AT_PROGRAM = 10
AT_EFFECTS = 11  # 1 where the program's wrenches act
AT_CONTROL = 12
AT_HELD = 13  # where in `userdata` the host holds a wrench; -1: nowhere
AT_ACTUATOR = 14  # its first thruster; prepared
AT_DELAYED = 15  # 1 where a thruster's command is delayed
AT_DRIFTING = 16  # 1 where network and what is taken away are of nu_r, not of nu
AT_ROWS = 17  # where its rows of M begin; prepared
AT_ALONE = 18  # 1 where nothing hangs on it by a joint, so that no other row of M refers to them; prepared
HEADER = 19
UNKNOWN = -1.0


@dataclass(frozen=True)
class Water:
    """What acts on a vehicle beside MuJoCo's own rigid body, weight and buoyancy.

    Attributes:
        program: Thrusters, and the wrenches of the effects that act.
        inertia: Added to the mass matrix, (6, 6) about CO.
        coriolis: Whose C(nu_r) nu_r is exerted, (6, 6); the inertia itself where the whole effect is wanted.
        cancelled: Whose C(nu) nu is taken away, (6, 6): M_RB where a residual model brings all of C.
        control: Residual network that runs inside the simulation.
        drifting: Whether the network is asked about the motion through the water, nu_r, and the C taken away
            is of nu_r too: one that learnt in still water, flown in a current.
        held: Whether the host holds a wrench on the left-hand side of the balance in `userdata`, six entries,
            FRD.
        ellipsoid: Whether MuJoCo's own fluid model acts on the hull.
    """

    program: Program
    inertia: Array | None = None
    coriolis: Array | None = None
    cancelled: Array | None = None
    control: Control | None = None
    drifting: bool = False
    held: bool = False
    ellipsoid: bool = False

    @property
    def activations(self) -> int:
        """Numbers that this vehicle keeps in MuJoCo's activations beside the thrusters' lags."""
        count = self.program.states
        if self.control is not None:
            count += self.control.states
        return count + 1 if count else 0

    def encode(self, held: int = -1) -> Array:
        """The numeric field's data; `held` is where in `userdata` the held wrench begins."""
        header = np.zeros(HEADER)
        header[[AT_MAGIC, AT_VERSION]] = MAGIC, VERSION
        header[[AT_BODY, AT_DOF, AT_STATES, AT_CONTROL_STATES, AT_STARTED, AT_ACTUATOR, AT_ROWS]] = UNKNOWN
        header[AT_HELD] = held if self.held else UNKNOWN
        header[AT_DELAYED] = float((thrusters_of(self.program.flat)[:, DELAY] > 0.0).any())
        header[AT_DRIFTING] = float(self.drifting)
        header[AT_EFFECTS] = float(bool(self.program.effects))
        blocks = [header]
        for entry, block in (
            (AT_INERTIA, self.inertia),
            (AT_CORIOLIS, self.coriolis),
            (AT_CANCELLED, self.cancelled),
            (AT_PROGRAM, self.program.flat),
            (AT_CONTROL, None if self.control is None else self.control.encode()),
        ):
            if block is not None:
                if entry == AT_CONTROL:
                    blocks.append(up_to_a_line(blocks))
                header[entry] = sum(map(len, blocks))
                blocks.append(np.asarray(block, dtype=np.float64).ravel())
        return np.concatenate([*blocks, up_to_a_line(blocks)])


def wet(vehicle: Vehicle, *, sea: Sequence[int] | None = None) -> Water:
    """Everything the vehicle file says, in a sea of its waves drawn from seeds, or in a calm one."""
    inertia = _some(inertia_matrix(vehicle))
    return Water(assemble(vehicle, sea=sea), inertia=inertia, coriolis=inertia)


def dry(vehicle: Vehicle, *, added_mass: bool = False, ellipsoid: bool = False) -> Water:
    """Thrusters alone, as the file and its actuator effects say; `added_mass` puts M_A in the mass matrix.

    MuJoCo's own C_RB stays and there is no C_A, which belongs to what a residual model brings (paper eq. 6).
    With `ellipsoid` MuJoCo's own fluid model acts on the hull.
    """
    inertia = _some(inertia_matrix(vehicle)) if added_mass else None
    return Water(assemble(_thrusters_only(vehicle)), inertia=inertia, ellipsoid=ellipsoid)


def residual(
    vehicle: Vehicle,
    control: Control | None = None,
    *,
    effects: bool = False,
    beside: Sequence[Mapping[str, Any]] = (),
) -> Water:
    """A residual model and what its label left out: M_A in the mass matrix and no C_RB (paper eq. 5).

    With `effects` the label left out all effects (`labels --subtract effects`): they act, C_A among them.
    C_RB is no effect, and so in the label and in the model either way.  Without a `control` the model runs on
    the host, which holds its wrench in `userdata`.  Effects `beside` it were not in what it learnt from: they
    act as well, with the Coriolis terms of what inertia they bring (`sim.residual.beside`).

    A current among these: a label of still water holds N in M nu_dot + N(nu, nu_dot) + g = tau, a law of the
    frame in which the water rests.  A steady, uniform current rests in a frame that drifts with it and is as
    inertial as the ground, so that M nu_r_dot + N(nu_r, nu_r_dot) + g = tau there (Fossen 2011, property
    8.1).  MuJoCo solves M_RB nu_dot + C_RB(nu) nu = tau_all, and Newton's law of the dry body is the same in
    both frames, M_RB nu_dot + C_RB(nu) nu = M_RB nu_r_dot + C_RB(nu_r) nu_r.  Therefore

        tau_all = tau - g - M_A nu_r_dot - N(nu_r, nu_r_dot) + C_RB(nu_r) nu_r:

    the network is asked at nu_r and nu_r_dot, what it brings of C_RB is taken away at nu_r, and M_A stands in
    the mass matrix with [omega x R^T v_c; 0] on the right.
    """
    inertia = _some(inertia_matrix(vehicle))
    alone = msgspec.structs.replace(vehicle, effect=tuple(beside))
    thrusters = _thrusters_only(vehicle)
    acting = msgspec.structs.replace(thrusters, effect=(*thrusters.effect, *alone.effect))
    return Water(
        assemble(vehicle if effects else acting),
        inertia=inertia,
        coriolis=inertia if effects else _some(inertia_matrix(alone)),
        cancelled=mass_matrix(vehicle),
        control=control,
        drifting=not effects,
        held=control is None,
    )


def _thrusters_only(vehicle: Vehicle) -> Vehicle:
    """The vehicle with its actuator effects alone."""
    kept = tuple(effect for effect in vehicle.effect if CATALOGUE[effect["name"]].kind == "actuator")
    return msgspec.structs.replace(vehicle, effect=kept)


def _some(matrix: Array) -> Array | None:
    """The matrix, or None where it is zero."""
    return matrix if matrix.any() else None
