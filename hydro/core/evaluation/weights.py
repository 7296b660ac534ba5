"""Weights of errors on different axes, by the vehicle's inertia.

The square of a wrench error on axis i has the weight 1 / M_ii (Gauss' measure of constraint), that of a
velocity error M_ii (kinetic energy), and that of a pose error likewise, with the mass matrix M.  Weighted
sums are divided, or multiplied, by the dry mass, so that all axes together are one force, speed or distance.
Errors are comparable only with equal weights: those of the first of the compared vehicle files.
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
    """Weights of squared errors, by which errors on different axes become comparable.

    Attributes:
        force: Weights of X Y Z K M N, (6,).
        velocity: Weights of u v w p q r, (6,).
        pose: Weights of x y z and the rotation about the body axes, (6,).
    """

    force: Array
    velocity: Array
    pose: Array

    @classmethod
    def of(cls, model: Candidate) -> Weights:
        """Return the weights of axes from the diagonal of a model's mass matrix, added mass included."""
        c = constants_of(model.program.flat)
        inertia, mass = np.diag(c[MASS_MATRIX : MASS_MATRIX + 36].reshape(6, 6)), float(c[MASS])
        level = np.concatenate([np.full(3, inertia[:3].mean()), inertia[3:]])
        return cls(mass / inertia, inertia / mass, level / mass)

    @classmethod
    def read(cls, comparison: pl.DataFrame) -> Weights:
        """Return the weights of axes that a comparison table contains.

        0 for an axis without errors in the table.
        """
        rows = comparison.filter(pl.col("level").is_in(["force", "replay"]), by="all")
        known = dict(rows.select("axis", "weight").drop_nulls().iter_rows())
        return cls(*(np.array([known.get(axis, 0.0) for axis in axes]) for axes in (WRENCH, VELOCITY, POSE)))
