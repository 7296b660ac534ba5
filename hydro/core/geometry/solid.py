"""Volume, centroid and moments of a hull mesh, a closed triangulated surface.

The moments are those of a solid of uniform density, exact for the polyhedron.  The added mass is computed by
the boundary element method of Capytaine, if it is installed (extra `mesh`).
"""

from __future__ import annotations

import importlib.util
import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.vehicle.panels import panels

MOST_FACES = 4000
"""Maximum number of triangles: the two dense matrices have as many rows, 0.5 GB in total."""


@dataclass(frozen=True)
class Solid:
    """Solid enclosed by a hull mesh, in body axes FRD about CO.

    Attributes:
        volume: Enclosed volume [m^3].
        center: Centroid of the volume (3,) [m].
        moments: Mean of x x^T over the volume, x from the centroid, (3, 3) [m^2].
        sides: Lengths of the bounding box (3,) [m].
        middle: Centre of the bounding box (3,) [m].
    """

    volume: float
    center: Array
    moments: Array
    sides: Array
    middle: Array

    def inertia(self, mass: float) -> Array:
        """Return the inertia matrix about the centroid of a uniform body of given mass, (3, 3) [kg m^2].

        Args:
            mass: Mass [kg].
        """
        return np.asarray(mass * (np.trace(self.moments) * np.eye(3) - self.moments))

    @property
    def semi_axes(self) -> Array:
        """Semi-axes x, y, z of the ellipsoid with the solid's volume and moment ratios, (3,) [m]."""
        axes = np.sqrt(5.0 * np.diag(self.moments))
        return np.asarray(axes * (self.volume / (4.0 / 3.0 * np.pi * np.prod(axes))) ** (1.0 / 3.0))


def solid(vertices: ArrayLike, faces: ArrayLike) -> Solid:
    """Return volume, centroid and moments of a closed triangulated surface, exact for the polyhedron.

    Args:
        vertices: Points [m], FRD about CO, one for each of V vertices, (V, 3).
        faces: Vertex indices, from 0, of F triangles, anticlockwise as seen from outside, (F, 3).

    Raises:
        DataError: The surface is not closed, not consistently oriented, inside out, or crosses itself.
    """
    hull = panels(vertices, faces)
    points = np.asarray(vertices, dtype=np.float64)
    corners = points[np.asarray(faces, dtype=np.int64)] - hull.center
    sixfold = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    # For a tetrahedron with one corner at the origin: int x x^T dV = 6 V/120 (s s^T + sum of c c^T).
    total = corners.sum(axis=1)
    outer = np.einsum("f,fi,fj->ij", sixfold, total, total)
    outer += np.einsum("f,fci,fcj->ij", sixfold, corners, corners)
    moments = outer / 120.0 / hull.volume
    if not np.all(np.diag(moments) > 0.0):
        raise DataError("the hull's mesh crosses itself: its moments are not those of a body")
    used = points[np.unique(np.asarray(faces, dtype=np.int64))]
    middle = 0.5 * (used.min(axis=0) + used.max(axis=0))
    return Solid(hull.volume, hull.center, moments, hull.extent, middle)


def solvable() -> bool:
    """Return whether the added mass of a mesh can be computed: whether Capytaine is installed."""
    return importlib.util.find_spec("capytaine") is not None


def radiated_added_mass(vertices: ArrayLike, faces: ArrayLike, density: float) -> Array:
    """Return the added-mass matrix of a closed surface about CO, far below the water's surface.

    Capytaine solves the six radiation problems of unit motions in an unbounded ideal fluid, with sources on
    flat panels (Ancellin and Dias 2019, *Journal of Open Source Software* 4(36), 1341).  Without a free
    surface there are no waves, and the result holds at every frequency.

    Args:
        vertices: Points [m], FRD about the body origin CO, one for each of V vertices, (V, 3).
        faces: Vertex indices, from 0, of F triangles, anticlockwise as seen from outside, (F, 3); F is at
            most MOST_FACES.
        density: Water density [kg/m^3].

    Returns:
        Added-mass matrix M_A about CO, (6, 6) [kg, kg m, kg m^2], made symmetric.
    """
    import capytaine

    logging.getLogger("capytaine").setLevel(logging.ERROR)
    triangles = np.asarray(faces, dtype=np.int64)
    mesh = capytaine.Mesh(
        vertices=np.asarray(vertices, dtype=np.float64),
        faces=np.column_stack([triangles, triangles[:, 2]]),
    )
    body = capytaine.FloatingBody(mesh=mesh, dofs=capytaine.rigid_body_dofs(rotation_center=(0.0, 0.0, 0.0)))
    solver, names = capytaine.BEMSolver(), list(body.dofs)
    matrix = np.zeros((6, 6))
    for j, name in enumerate(names):
        problem = capytaine.RadiationProblem(
            body=body, free_surface=np.inf, water_depth=np.inf, radiating_dof=name, rho=density
        )
        added = solver.solve(problem).added_masses
        matrix[:, j] = [float(added[other]) for other in names]
    return 0.5 * (matrix + matrix.T)
