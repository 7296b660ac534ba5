"""Whether a vehicle's effects make sense together: what no single parameter's bounds can say."""

from __future__ import annotations

import numpy as np

from hydro.core.effects.catalogue import added_mass_matrix, entries
from hydro.core.effects.record import Array
from hydro.core.errors import DataError
from hydro.core.vehicle import Vehicle

TOLERANCE = 1e-9
"""Relative to the largest entry: asymmetry and negative eigenvalues below it are rounding."""


def validate(vehicle: Vehicle) -> None:
    """Check the effects of a vehicle one by one and in sum.

    Args:
        vehicle: The vehicle.

    Raises:
        DataError: Naming the path in the vehicle file: an unknown effect or parameter, a number out of bounds, an
            added mass that is not symmetric or not positive semi-definite.
    """
    entries(vehicle)
    added_mass = added_mass_matrix(vehicle)
    asymmetric = np.argwhere(np.abs(added_mass - added_mass.T) > TOLERANCE * np.abs(added_mass).max())
    if len(asymmetric):
        i, j = asymmetric[0]
        raise DataError(
            f"effect: added mass in sum must be symmetric: M_A[{i},{j}] differs from M_A[{j},{i}]"
        )
    require_semidefinite(added_mass, "added mass")


def require_semidefinite(matrix: Array, what: str) -> None:
    """Raise DataError where the symmetric part of a matrix has a negative eigenvalue beyond rounding."""
    least = float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])
    if least < -TOLERANCE * float(np.abs(matrix).max()):
        raise DataError(
            f"effect: {what} in sum must be positive semi-definite: its least eigenvalue is {least:.6g}"
        )
