"""Added mass in MuJoCo's mass matrix M: it is inertia, not feedback, and enters M before the solver.

A vehicle's six rows of M form a full lower triangle of 21 numbers.  No other row refers to them unless a body
is attached to the vehicle by a joint.  MuJoCo has factored M before the callback.  The rows of such a vehicle
are factored again on their own, with the operations of `mj_factorM`.  Calling that function would process the
whole model and read its clock twice.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import within
from hydro.core.vehicle.frames import HALF_TURN

ENTRIES = 21
"""Number of entries of the lower triangle."""
LEAST_PIVOT = 1e-12
"""Minimum pivot; below it, MuJoCo itself reports the error of a mass or moment of inertia."""


@within
def add_inertia(A: Array, P: Array, half: Array, M: Array) -> None:
    """Add an inertia in body axes FRD to the lower triangle of MuJoCo's mass matrix `M`, in place.

    The sum is T^T A T with T = diag(P, F): P takes z-up world components to body FRD, and F is the diagonal
    matrix of `HALF_TURN`, a half turn about x between FLU and FRD axes.

    Args:
        A: The inertia, row by row, (36,).
        P: Rotation from world (z up) to body FRD, row by row, (9,).
        half: Buffer, (18,), overwritten.
        M: Lower triangle of the mass matrix, row by row, (21,), changed.
    """
    for i in range(6):
        for j in range(3):
            half[3 * i + j] = A[6 * i] * P[j] + A[6 * i + 1] * P[3 + j] + A[6 * i + 2] * P[6 + j]
    at = 0
    for i in range(3):
        for j in range(i + 1):
            M[at + j] += P[i] * half[j] + P[3 + i] * half[3 + j] + P[6 + i] * half[6 + j]
        at += i + 1
    for i in range(3):
        sign = HALF_TURN[i]
        for j in range(3):
            M[at + j] += sign * half[9 + 3 * i + j]
        for j in range(i + 1):
            M[at + 3 + j] += sign * HALF_TURN[j] * A[6 * (3 + i) + 3 + j]
        at += 4 + i


@within
def factor(M: Array, L: Array, inverse: Array) -> bool:
    """Factor a mass matrix as M = L^T D L, with the operations of MuJoCo's `mj_factorM`.

    Args:
        M: Lower triangle of the matrix, row by row, (21,).
        L: Output: lower triangle of the factor, with D on its diagonal, (21,).
        inverse: Output: 1/D, (6,).

    Returns:
        False if M is not positive definite.
    """
    for i in range(ENTRIES):
        L[i] = M[i]
    row = ENTRIES - 6
    for k in range(5, -1, -1):
        pivot = L[row + k]
        if not pivot > LEAST_PIVOT:
            return False
        inverse[k] = 1.0 / pivot
        above = row
        for i in range(k - 1, -1, -1):
            above -= i + 1
            share = -L[row + i] * inverse[k]
            for j in range(i + 1):
                L[above + j] += L[row + j] * share
        for j in range(k):
            L[row + j] *= inverse[k]
        row -= k
    return True


@within
def stale(A: Array, mass: float, M: Array) -> bool:
    """Return whether the mass matrix `M` may already contain an added inertia `A`, so A must not be added.

    The translational part of M is the body's mass times the identity, and the trace of the added part does
    not depend on the attitude.  So the trace shows whether A was added.

    Args:
        A: Added inertia, row by row, (36,).
        mass: Mass of the body [kg].
        M: Lower triangle of the mass matrix, row by row, (21,).
    """
    added = A[0] + A[7] + A[14]
    found = M[0] + M[2] + M[5] - 3.0 * mass
    return bool(added < 1e-6 * mass or found > 0.5 * added)


def is_packed(rows: Array, lengths: Array) -> bool:
    """Return whether six rows of MuJoCo's mass matrix are stored as one contiguous lower triangle.

    Args:
        rows: Addresses of the rows (6,).
        lengths: Numbers of stored entries of the rows (6,).
    """
    return bool(
        np.array_equal(lengths, np.arange(1, 7)) and np.array_equal(rows - rows[0], [0, 1, 3, 6, 10, 15])
    )
