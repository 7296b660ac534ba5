"""Water forces of a vehicle in MuJoCo, and their storage in the model as one numeric field.

The field begins with a header of counts and positions, which are exact as doubles.  Blocks follow: two or
three 6x6 matrices, the compiled effects and thrusters (`core.effects.program`), and a residual network with
its filter and conditioning (`sim.residual.control`).  A block at position 0 is absent.  Values that only the
compiled model has (addresses of body, velocity and activations) are -1 until `sim.bridge.native.prepare`
writes them.
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
from hydro.sim.residual.control import Control, line_padding

PREFIX = "hydro/"
"""Prefix of numeric fields: `hydro/<body>` holds the parameters of the vehicle whose body is `<body>`."""

MAGIC = 4859381026137.0  # identifies fields of hydro; XML text keeps its 13 digits
VERSION = 8.0
AT_MAGIC, AT_VERSION = 0, 1
AT_BODY, AT_DOF = 2, 3  # of the free joint; written by `prepare`
AT_STATES, AT_CONTROL_STATES, AT_STARTED = 4, 5, 6  # starts in `act`; written by `prepare`
AT_INERTIA = 7  # matrix added to M
AT_CORIOLIS = 8  # matrix whose Coriolis wrench at nu_r acts
AT_CANCELLED = 9  # matrix whose Coriolis wrench is cancelled
AT_PROGRAM = 10
AT_EFFECTS = 11  # 1 if the program's wrenches act
AT_CONTROL = 12
AT_HELD = 13  # index in `userdata` of a wrench held by the host; -1 without one
AT_ACTUATOR = 14  # first thruster; written by `prepare`
AT_DELAYED = 15  # 1 if a thruster's command is delayed
AT_DRIFTING = 16  # 1 if network and cancelled wrench use nu_r, not nu
AT_ROWS = 17  # address of its rows of M; written by `prepare`
AT_ALONE = 18  # 1 if no body hangs on it by a joint, so its rows of M stand alone; written by `prepare`
HEADER = 19
UNKNOWN = -1.0


@dataclass(frozen=True)
class Water:
    """Forces on a vehicle in addition to MuJoCo's rigid body, weight and buoyancy.

    Attributes:
        program: Thrusters, and the wrenches of the active effects.
        inertia: Inertia added to the mass matrix, (6, 6) about CO.
        coriolis: Inertia whose C(nu_r) nu_r acts, (6, 6); equal to `inertia` for the whole effect.
        cancelled: Inertia whose C(nu) nu is cancelled, (6, 6): M_RB if a residual model includes all of C.
        control: Residual network that runs inside the simulation.
        drifting: Whether the network's input and the cancelled C use nu_r, as for a network that learnt in
            still water and moves in a current.
        held: Whether the host writes a wrench (6 entries of `userdata`, FRD) for the left-hand side of the
            equation of motion.
        ellipsoid: Whether MuJoCo's fluid model acts on the hull.
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
        """Number of MuJoCo activations of this vehicle, without the lag states of the thrusters."""
        count = self.program.states
        if self.control is not None:
            count += self.control.states
        return count + 1 if count else 0

    def encode(self, held: int = -1) -> Array:
        """Return these forces as one array of numbers, the content of the model's numeric field.

        Args:
            held: Index in MuJoCo's `userdata` of the wrench that the host holds; -1 without one.
        """
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
                    blocks.append(line_padding(blocks))
                header[entry] = sum(map(len, blocks))
                blocks.append(np.asarray(block, dtype=np.float64).ravel())
        return np.concatenate([*blocks, line_padding(blocks)])


def wet(vehicle: Vehicle, *, sea: Sequence[int] | None = None) -> Water:
    """Return all water forces of a vehicle file.

    Args:
        vehicle: Vehicle file.
        sea: Seeds of random waves; None for no waves.
    """
    inertia = _some(inertia_matrix(vehicle))
    return Water(assemble(vehicle, sea=sea), inertia=inertia, coriolis=inertia)


def dry(vehicle: Vehicle, *, added_mass: bool = False, ellipsoid: bool = False) -> Water:
    """Return water forces that contain a vehicle's thrusters alone, including effects on thrusters.

    MuJoCo's own C_RB stays.  There is no C_A, which is part of a residual model (Wu et al., eq. 6).

    Args:
        vehicle: Vehicle file.
        added_mass: Add M_A to the mass matrix.
        ellipsoid: Let MuJoCo's fluid model act on the hull.
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
    """Return the water forces with a residual model: its wrench, M_A in the inertia, and no C_RB (eq. 5).

    The label is the force that the model learnt.  With `effects`, the label excluded all effects (`labels
    --subtract effects`), so the effects act too, including C_A.  C_RB is not an effect, so label and model
    include it in both cases.  Without a `control`, the model runs on the host, which holds its wrench in
    `userdata`.  Effects in `beside` were absent from the training data.  They act too, with the Coriolis
    terms of the inertia that they add (`sim.residual.beside`).

    `beside` may have a current.  A label of still water holds N in M nu_dot + N(nu, nu_dot) + g = tau, which
    is a law of the frame in which the water rests.  In a steady, uniform current this frame drifts with the
    water and is inertial, so M nu_r_dot + N(nu_r, nu_r_dot) + g = tau there (Fossen 2011, property 8.1).
    MuJoCo solves M_RB nu_dot + C_RB(nu) nu = tau_all.  Newton's law of the dry body is the same in both
    frames: M_RB nu_dot + C_RB(nu) nu = M_RB nu_r_dot + C_RB(nu_r) nu_r.  Therefore:

        tau_all = tau - g - M_A nu_r_dot - N(nu_r, nu_r_dot) + C_RB(nu_r) nu_r.

    The inputs of the network are nu_r and nu_r_dot, and its share of C_RB is cancelled at nu_r.  M_A is in
    the mass matrix, with [omega x R^T v_c; 0] on the right, where v_c is the velocity of the current (NED)
    and R rotates FRD to NED.
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
    """Return the vehicle with only those of its effects that act on thrusters."""
    kept = tuple(effect for effect in vehicle.effect if CATALOGUE[effect["name"]].kind == "actuator")
    return msgspec.structs.replace(vehicle, effect=kept)


def _some(matrix: Array) -> Array | None:
    """Return the matrix, or None if it is zero."""
    return matrix if matrix.any() else None
