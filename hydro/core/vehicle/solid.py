"""A closed triangulated surface as a solid of uniform density: moments, and an ellipsoid that has them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.vehicle.panels import panels


@dataclass(frozen=True)
class Solid:
    """What a mesh says of a hull, in body axes FRD about CO.

    Attributes:
        volume: Enclosed volume [m^3].
        center: Its centroid (3,) [m].
        moments: Mean of x x^T over the volume about the centroid, (3, 3) [m^2].
        sides: Lengths of the bounding box (3,) [m].
        middle: Centre of the bounding box (3,) [m].
    """

    volume: float
    center: Array
    moments: Array
    sides: Array
    middle: Array

    def inertia(self, mass: float) -> Array:
        """Inertia matrix (3, 3) [kg m^2] about the centroid, of a mass [kg] spread evenly."""
        return np.asarray(mass * (np.trace(self.moments) * np.eye(3) - self.moments))

    @property
    def semi_axes(self) -> Array:
        """Semi-axes (3,) [m] along x, y, z of the ellipsoid of the same volume and proportions of moments."""
        axes = np.sqrt(5.0 * np.diag(self.moments))
        return np.asarray(axes * (self.volume / (4.0 / 3.0 * np.pi * np.prod(axes))) ** (1.0 / 3.0))


def solid(vertices: ArrayLike, faces: ArrayLike) -> Solid:
    """Moments of a closed triangulated surface.

    Args:
        vertices: (V, 3) points [m], FRD about CO.
        faces: (F, 3) vertex numbers from 0, anticlockwise as seen from outside.

    Returns:
        Sums over tetrahedra from the origin to each facet, exact for the polyhedron.

    Raises:
        DataError: The surface is not closed, not consistently oriented, or inside out.
    """
    hull = panels(vertices, faces)
    points = np.asarray(vertices, dtype=np.float64)
    corners = points[np.asarray(faces, dtype=np.int64)] - hull.center
    sixfold = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    # Of a tetrahedron with one corner at the origin: int x x^T dV = 6 V/120 (s s^T + sum of c c^T).
    total = corners.sum(axis=1)
    outer = np.einsum("f,fi,fj->ij", sixfold, total, total)
    outer += np.einsum("f,fci,fcj->ij", sixfold, corners, corners)
    moments = outer / 120.0 / hull.volume
    if not np.all(np.diag(moments) > 0.0):
        raise DataError("the hull's mesh crosses itself: its moments are not those of a body")
    used = points[np.unique(np.asarray(faces, dtype=np.int64))]
    middle = 0.5 * (used.min(axis=0) + used.max(axis=0))
    return Solid(hull.volume, hull.center, moments, hull.extent, middle)
