"""What errors on different axes count for beside each other: by the vehicle's inertia.

Wrenches by r_i^2 / M_ii (Gauss' measure of constraint), velocities by M_ii e_i^2 (kinetic energy), poses
likewise.  Weighted sums are divided, or multiplied, by the dry mass, so that all axes together are one force,
speed or distance.  Errors can be held against each other only where the weights are the same: those of the
first of the vehicle files that are compared.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import polars as pl

from hydro.core.columns import POSE, VELOCITY, WRENCH, Array
from hydro.core.effects.layout import MASS, MASS_MATRIX
from hydro.core.effects.program import constants_of
from hydro.core.prediction.candidate import Candidate


class Weights(NamedTuple):
    """What a square on each axis counts for.

    Attributes:
        force: Of X Y Z K M N, (6,).
        velocity: Of u v w p q r, (6,).
        pose: Of x y z and the rotation about the body's axes, (6,).
    """

    force: Array
    velocity: Array
    pose: Array

    @classmethod
    def of(cls, model: Candidate) -> Weights:
        """By the diagonal of a model's inertia, added mass included."""
        c = constants_of(model.program.flat)
        inertia, mass = np.diag(c[MASS_MATRIX : MASS_MATRIX + 36].reshape(6, 6)), float(c[MASS])
        level = np.concatenate([np.full(3, inertia[:3].mean()), inertia[3:]])
        return cls(mass / inertia, inertia / mass, level / mass)

    @classmethod
    def read(cls, comparison: pl.DataFrame) -> Weights:
        """Those that a comparison was made with; 0 of an axis that it has no errors of."""
        rows = comparison.filter(pl.col("level").is_in(["force", "replay"]), by="all")
        known = dict(rows.select("axis", "weight").drop_nulls().iter_rows())
        return cls(*(np.array([known.get(axis, 0.0) for axis in axes]) for axes in (WRENCH, VELOCITY, POSE)))
