"""Added mass of a mesh in unbounded water, by the boundary element method of Capytaine (extra `mesh`)."""

from __future__ import annotations

import importlib.util
import logging

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array

MOST_FACES = 4000
"""Panels of the problem: its two dense matrices have so many rows, 0.5 GB in all."""


def available() -> bool:
    """Whether Capytaine is installed."""
    return importlib.util.find_spec("capytaine") is not None


def radiated_added_mass(vertices: ArrayLike, faces: ArrayLike, density: float) -> Array:
    """Added mass of a closed surface about the body origin, far below the water's surface.

    The six radiation problems of the unit motions in an unbounded ideal fluid, sources on flat panels
    (Ancellin and Dias 2019, *Journal of Open Source Software* 4(36), 1341).  Without a free surface there are
    no waves, and the result holds at every frequency.

    Args:
        vertices: (V, 3) points [m], FRD about CO.
        faces: (F, 3) vertex numbers from 0, anticlockwise as seen from outside; MOST_FACES at most.
        density: Water density [kg/m^3].

    Returns:
        M_A (6, 6) about CO, made symmetric.
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
