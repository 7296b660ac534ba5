"""A vehicle to hang effects on, and scipy's rotations as an oracle apart from hydro's."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from hydro.core.columns import Array
from hydro.core.effects import effect_wrenches
from hydro.core.vehicle.description import Buoyancy, Environment, Hull, RigidBody, Thruster, Vehicle

CENTER_OF_BUOYANCY = np.array([0.03, -0.02, -0.08])
BUOYANCY = 505.0
BARE = Vehicle(
    name="bare",
    rigid_body=RigidBody(50.0, (0.02, -0.01, 0.04), ((1.5, 0.1, -0.05), (0.1, 5.0, 0.2), (-0.05, 0.2, 5.5))),
    buoyancy=Buoyancy(BUOYANCY, (0.03, -0.02, -0.08)),
    hull=Hull(1.6, 0.4, 0.3, (0.1, 0.0, 0.0)),
    environment=Environment(1025.0, 9.81),
    thruster=(
        Thruster("ahead", 80.0, 60.0, (-0.7, 0.1, 0.0), (1.0, 0.0, 0.0), time_constant=0.2),
        Thruster("side", 50.0, 50.0, (0.3, 0.0, 0.05), (0.0, 1.0, 0.0), curve="quadratic", deadband=0.05),
    ),
)
ADDED = {"name": "added_mass", "diagonal": [10.0, 60.0, 70.0, 1.0, 8.0, 9.0]}
DAMPED = (
    {"name": "linear_damping", "diagonal": [5.0, 20.0, 30.0, 2.0, 6.0, 5.0]},
    {"name": "quadratic_damping", "diagonal": [40.0, 150.0, 200.0, 4.0, 20.0, 18.0]},
)


def neutral(mass: float = 50.0, inertia: tuple[float, float, float] = (1.5, 5.0, 5.5)) -> Vehicle:
    """A neutrally buoyant vehicle with both centres at CO and principal axes along the body's."""
    matrix = tuple(tuple(float(v) for v in row) for row in np.diag(inertia))
    return Vehicle(
        "neutral",
        RigidBody(mass, (0.0, 0.0, 0.0), matrix),
        Buoyancy(mass * 9.81, (0.0, 0.0, 0.0)),
        Hull(1.6, 0.4, 0.3),
        thruster=(Thruster("ahead", 80.0, 60.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),),
    )


def equipped(*effects: dict[str, Any], bare: Vehicle = BARE) -> Vehicle:
    """The bare vehicle with effects."""
    return msgspec.structs.replace(bare, effect=effects)


def wrench(
    effect: dict[str, Any],
    eta: ArrayLike,
    nu: ArrayLike,
    *more: dict[str, Any],
    commands: ArrayLike = (0.0, 0.0),
) -> Array:
    """Wrench of effects at one pose and velocity, under commands of the two thrusters."""
    row = np.atleast_2d(np.asarray(eta, float)), np.atleast_2d(np.asarray(nu, float))
    return effect_wrenches(equipped(effect, *more), *row, [[0, 1]], [0.0], np.atleast_2d(commands))[0]


def R(eta: Array) -> Array:
    """Rotation body to NED by scipy."""
    return Rotation.from_euler("ZYX", [eta[5], eta[4], eta[3]]).as_matrix()


def force_at(point: ArrayLike, world_force: ArrayLike, eta: Array) -> Array:
    """Wrench about CO, body frame, of a world force at a point of the body."""
    force = R(eta).T @ np.asarray(world_force, float)
    return np.concatenate([force, np.cross(point, force)])
