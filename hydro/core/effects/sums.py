"""Validation of a vehicle's effects in sum, beyond the bounds of single parameters."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import damping
from hydro.core.effects.catalogue import added_mass_matrix, entries, inertia_matrix, thruster_table
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import mass_matrix

EIGENVALUE_TOLERANCE = 1e-9
"""Tolerance of asymmetry and negative eigenvalues relative to the largest component: rounding errors."""


def validate(vehicle: Vehicle, damped: Vehicle | None = None) -> None:
    """Check each effect of a vehicle, and the sums over all its effects, such as the total damping.

    Args:
        vehicle: The vehicle.
        damped: Vehicle whose damping is checked in place of that of `vehicle`, for a vehicle that is damped
            by more than its effects; by default `vehicle`.

    Raises:
        DataError: An effect or parameter is unknown, a number is out of bounds, or a sum is invalid: added
            mass that is not symmetric positive semi-definite, a mass matrix that is not positive definite,
            damping that adds energy, or an impossible thruster.  The message names the path in the vehicle
            file.
    """
    thruster_table(vehicle)
    added_mass = added_mass_matrix(vehicle)
    _require_symmetric(added_mass)
    _require_semidefinite(added_mass, "added mass")
    if np.linalg.eigvalsh(mass_matrix(vehicle) + inertia_matrix(vehicle))[0] <= 0.0:
        raise DataError("rigid_body: the mass matrix with all effects must be positive definite")
    linear, quadratic, drag = damping_in_sum(damped or vehicle)
    _require_semidefinite(linear, "linear damping with coupled damping")
    for what, values in (("quadratic damping", quadratic), ("cross-flow drag", drag)):
        if (values < 0.0).any():
            raise DataError(f"effect: {what} in sum must not be below 0: it is {values.min():.6g}")


def damping_in_sum(vehicle: Vehicle) -> tuple[Array, Array, Array]:
    """Return the total linear damping, quadratic damping and cross-flow coefficients of a vehicle.

    Returns:
        Sums over the vehicle's effects: linear damping, (6, 6); quadratic damping, (6,); cross-flow
        coefficients, (2,).
    """
    linear, quadratic, drag = np.zeros((6, 6)), np.zeros(6), np.zeros(2)
    for effect, p, _ in entries(vehicle):
        if effect.name == "linear_damping":
            linear += np.diag(p) if p.size == 6 else p.reshape(6, 6)
        elif effect.name == "coupled_damping":
            for value, (i, j) in zip(p, damping.COUPLED, strict=True):
                linear[i, j] += value
        elif effect.name == "quadratic_damping":
            quadratic += p
        elif effect.name == "crossflow_drag":
            drag += p
    return linear, quadratic, drag


def _require_symmetric(added_mass: Array) -> None:
    apart = np.abs(added_mass - added_mass.T)
    if apart.max() > EIGENVALUE_TOLERANCE * np.abs(added_mass).max():
        i, j = np.unravel_index(apart.argmax(), apart.shape)
        raise DataError(
            f"effect: added mass in sum must be symmetric: M_A[{i},{j}] is {added_mass[i, j]:.9g} and "
            f"M_A[{j},{i}] is {added_mass[j, i]:.9g}"
        )


def _require_semidefinite(matrix: Array, what: str) -> None:
    """Raise DataError if the symmetric part has a negative eigenvalue beyond rounding."""
    least = float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])
    if least < -EIGENVALUE_TOLERANCE * float(np.abs(matrix).max()):
        raise DataError(
            f"effect: {what} in sum must be positive semi-definite: its least eigenvalue is {least:.6g}"
        )
