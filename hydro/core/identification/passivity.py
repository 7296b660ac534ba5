"""Projection of fitted values onto those of a passive hull.

Total added mass and the symmetric part of total linear damping must be positive semi-definite.  Both are
linear in the fitted components, so each direction e with e^T D e < 0 gives a half-space constraint on the
values.  The best feasible values minimise the linearised sum of squares: a least-distance problem (Lawson and
Hanson, Solving Least Squares Problems, 1974, chapter 23).  Constraints for the worst directions are added
until none is violated (Kelley, The cutting-plane method for solving convex programs, 1960).
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE, validate
from hydro.core.effects.catalogue import added_mass_matrix
from hydro.core.effects.record import Role
from hydro.core.effects.sums import damping_in_sum
from hydro.core.errors import DataError
from hydro.core.prediction.parameters import Entry, Free
from hydro.core.vehicle.description import Vehicle

CUTS = 100
INSIDE = 1e-6  # margin of a cut relative to the matrix' greatest entry, so that the cuts terminate
HALVINGS = 20


def possible(unknown: Free, values: Array, information: Array) -> Array:
    """Return the values closest to the fitted ones at which the vehicle passes `effects.validate`, (P,).

    The check demands a passive hull: total added mass and damping positive semi-definite.  If no projection
    passes, couplings, and then all values, are moved back toward the initial values, or toward zero if the
    initial values do not pass either.  The values stay unchanged if zero does not pass.

    Args:
        unknown: The P components.
        values: Fitted values, (P,).
        information: Information matrix of the problem at the fitted values, in units of the components'
            scales, positive definite, (P, P); "closest" is measured with it.
    """
    if accepted(unknown, values):
        return values
    found = _nearest(unknown, values, information)
    return found if accepted(unknown, found) else _drawn_back(unknown, values)


def bounded_in_sum(unknown: Free) -> NDArray[np.bool_]:
    """Return a mask of the components that belong to a sum that must be positive semi-definite, (P,).

    The sums are total added mass and total linear damping.

    Args:
        unknown: The P components.
    """
    return np.asarray(_answers(unknown, unknown.starts[0]).any(axis=(1, 2, 3)))


def accepted(unknown: Free, values: Array) -> bool:
    """Return whether a vehicle with given values of components passes all checks of `effects.sums.validate`.

    Args:
        unknown: The P components.
        values: Values of the components, (P,).
    """
    try:
        validate(unknown.at(values))
    except DataError:
        return False
    return True


def _sums(vehicle: Vehicle) -> Array:
    """Return total added mass and the symmetric part of total linear damping, (2, 6, 6)."""
    both = np.stack([added_mass_matrix(vehicle), damping_in_sum(vehicle)[0]])
    return 0.5 * (both + both.transpose(0, 2, 1))


def _answers(unknown: Free, values: Array) -> Array:
    """Return the derivatives of the sums by each component, in its scale, (P, 2, 6, 6)."""
    here = _sums(unknown.at(values))
    return np.stack([_sums(unknown.at(values + move)) - here for move in np.diag(unknown.scales)])


def _nearest(unknown: Free, values: Array, information: Array) -> Array:
    """Return the best values (P,) that satisfy passivity and the bounds."""
    scales, count = unknown.scales, len(values)
    here, answers = _sums(unknown.at(values)), _answers(unknown, values)
    root = scipy.linalg.cholesky(information)
    low, high = (bound - values for bound in unknown.bounds)
    sides, edges = (
        np.vstack([np.eye(count), -np.eye(count)]),
        np.concatenate([low, -high]) / np.tile(scales, 2),
    )
    sides, edges = sides[np.isfinite(edges)], edges[np.isfinite(edges)]
    step = np.zeros(count)
    for _ in range(CUTS):
        sums = here + np.einsum("p,pmij->mij", step, answers)
        level, direction = np.linalg.eigh(sums)
        margin = INSIDE * np.abs(here).max(axis=(1, 2))
        worst = [(m, direction[m, :, i]) for m in range(2) for i in range(6) if level[m, i] < 0.0]
        if not worst:
            break
        for m, e in worst:
            sides = np.vstack([sides, answers[:, m] @ e @ e])
            edges = np.append(edges, margin[m] - here[m] @ e @ e)
        step = _least_distance(root, sides, edges)
    return unknown.within(values + step * scales)


def _least_distance(root: Array, sides: Array, edges: Array) -> Array:
    """Return the step d of least |root d| with `sides` d >= `edges`; root is upper triangular."""
    normal = scipy.linalg.solve_triangular(root, sides.T, trans="T").T
    size = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    dual = np.vstack([(normal / size[:, None]).T, edges / size])
    target = np.append(np.zeros(len(root)), 1.0)
    left = dual @ scipy.optimize.nnls(dual, target)[0] - target
    step: Array = (
        scipy.linalg.solve_triangular(root, -left[:-1] / left[-1]) if left[-1] else np.zeros(len(root))
    )
    return step


def _drawn_back(unknown: Free, values: Array) -> Array:
    """Move couplings, or all values, toward the start or toward zero as far as necessary."""
    nothing = unknown.within(np.zeros(len(values)))
    home = next((one for one in (unknown.starts[0], nothing) if accepted(unknown, one)), None)
    if home is None:
        return values
    couplings = np.array([_couples(entry) for entry in unknown.entries])
    for moving in (couplings, np.ones(len(values), bool)):
        way = np.where(moving, values - home, 0.0)
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            kept = accepted(unknown, values - (1.0 - middle) * way)
            low, high = (middle, high) if kept else (low, middle)
        values = values - (1.0 - low) * way
        if accepted(unknown, values):
            break
    return values


def _couples(entry: Entry) -> bool:
    """Return whether an entry is off the diagonal of a matrix."""
    off = len(entry.index) == 2 and entry.index[0] != entry.index[1] and entry.parameter == "matrix"
    return off or Role.COUPLING in CATALOGUE[entry.effect].roles
