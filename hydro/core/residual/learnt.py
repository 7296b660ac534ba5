"""Residual wrench from a network of `hydro train`.

A label is y = tau - M nu_dot - g on the left-hand side of the equation of motion, with C(nu) nu included
(`distillation.labels`): tau is the wrench of the thrusters, M the mass matrix with added mass, C its Coriolis
matrix, and -g the wrench of weight and buoyancy.  So the true force of the water is F = C nu - y.  With F_0,
the force of the vehicle file, the residual wrench is

    w = C(nu_r) nu_r - y(nu_r, nu_r_dot) - F_0.

This holds in a steady current too, since a network of still water holds in the frame that drifts with the
current (Fossen 2011, property 8.1).  For labels with all effects subtracted, y = C_RB nu - w, with C_RB of
the rigid body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from hydro.core.columns import Array, Mask
from hydro.core.distillation import history
from hydro.core.effects import CATALOGUE, inertia_matrix
from hydro.core.effects.columns import effect_wrenches
from hydro.core.effects.record import BOOKKEEPING
from hydro.core.errors import DataError
from hydro.core.prediction.candidate import candidate, true_velocity
from hydro.core.recording.shots import Shots
from hydro.core.residual.library import Flow
from hydro.core.residual.lowering import TrainedModel
from hydro.core.residual.network import Network
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import mass_matrix

IN_LABELS = ("inertia", "actuator", "sensor")
"""Kinds of effects of the vehicle file that every label contains."""


@dataclass(frozen=True)
class Learnt:
    """Trained network as a model of the residual hull force of a vehicle file.

    Attributes:
        network: The network.
        file: The vehicle file.
        forces: Whether the network predicts the forces of the file's effects too, so that they are
            subtracted.
        window: Number of velocities in the input, the present velocity included.
    """

    network: Network
    file: Vehicle
    forces: bool
    window: int

    @classmethod
    def of(cls, model: TrainedModel, file: Vehicle) -> Learnt:
        """Return a trained network as the residual hull force of a vehicle file.

        Args:
            model: Trained network, as `hydro train` writes it.
            file: Vehicle file; must have the rigid body, thrusters and inertia with which the labels were
                made.

        Raises:
            DataError: The labels were made with another rigid body, thrusters or inertia, or in a current; or
                the layers are unknown.
        """
        require_same(model, file)
        window = int(model.architecture.get("window", 1))
        return cls(Network.of(model), file, model.subtract != "effects", window)

    def wrench(self, vehicle: Vehicle, shots: Shots, rows: Mask | None = None) -> Array:
        """Return the residual wrench on the vehicle about CO at every row of a recording, (N, 6) [N, N m].

        Args:
            vehicle: The vehicle; its current and DVL errors determine the motion through the water.
            shots: Shots of the recording, with its smoothed motion.
            rows: Not used: a network with memory needs every row.
        """
        record, model = shots.record, candidate(vehicle)
        flow = Flow.of(model, shots)
        past = None
        if self.network.memory and self.network.period is not None:
            stride = history.stride(self.network.period, record.dt)
            past = history.past(flow.nu, record.segments, self.window, stride)
        said = self.network.wrench(np.hstack([flow.nu, flow.nu_dot]), past)
        mass = mass_matrix(self.file)
        if not self.forces:
            return np.asarray(coriolis(mass, flow.nu) - said)
        currents = [table for table in vehicle.effect if CATALOGUE[table["name"]].kind == "flow"]
        beside = msgspec.structs.replace(self.file, effect=(*self.file.effect, *currents))
        over_ground = true_velocity(model, record, shots.nu)
        known = effect_wrenches(beside, shots.eta, over_ground, record.segments, record.t, record.commands)
        return np.asarray(coriolis(mass + inertia_matrix(self.file), flow.nu) - said - known)


def coriolis(mass: Array, nu: Array) -> Array:
    """Return C(nu) nu of N velocities, (N, 6) (Fossen 2011, theorem 3.2).

    Args:
        mass: Mass matrix M, (6, 6).
        nu: Velocities of CO in body axes, (N, 6) [m/s, rad/s].
    """
    momentum = nu @ mass.T
    force = np.cross(nu[:, 3:], momentum[:, :3])
    moment = np.cross(nu[:, :3], momentum[:, :3]) + np.cross(nu[:, 3:], momentum[:, 3:])
    return np.hstack([force, moment])


def require_same(model: TrainedModel, file: Vehicle) -> None:
    """Check that the labels of a network were made with an equivalent vehicle file.

    Args:
        model: Trained network; not checked if it does not contain the vehicle of its labels.
        file: Vehicle file.

    Raises:
        DataError: The vehicles differ, or the file has a current.
    """
    if any(CATALOGUE[table["name"]].kind == "flow" for table in file.effect):
        raise DataError(f"{file.name} has a current: a network needs a vehicle file without a current")
    labelled = model.labelled
    if labelled is None:
        return
    differ = [
        part
        for part in ("rigid_body", "buoyancy", "thruster", "environment")
        if getattr(labelled, part) != getattr(file, part)
    ]
    kinds = IN_LABELS if model.subtract != "effects" else ("wrench", *IN_LABELS)
    if _tables(labelled, kinds) != _tables(file, kinds):
        differ.append("[[effect]] of " + ", ".join(kinds))
    if any(CATALOGUE[table["name"]].kind == "flow" for table in labelled.effect):
        differ.append("a current")
    if differ:
        raise DataError(
            f"the labels of {model.name} were made with another vehicle file ({', '.join(differ)} differ); "
            "train on labels made with this one"
        )


def _tables(vehicle: Vehicle, kinds: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return the effects of the given kinds without standard errors and other records of a fit."""
    return [
        {key: value for key, value in table.items() if key not in BOOKKEEPING or key == "name"}
        for table in vehicle.effect
        if CATALOGUE[table["name"]].kind in kinds
    ]
