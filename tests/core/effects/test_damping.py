"""Natural sizes of damping."""

from __future__ import annotations

import numpy as np
from bench import BARE

from hydro.core.prediction.parameters import free


def test_the_diagonal_of_a_matrix_of_damping_has_the_sizes_of_a_diagonal():
    diagonal, matrix = (free(BARE, [f"linear_damping.{name}"]) for name in ("diagonal", "matrix"))
    places = [entry.index for entry in matrix.entries]
    np.testing.assert_allclose(matrix.scales[[places.index((i, i)) for i in range(6)]], diagonal.scales)
