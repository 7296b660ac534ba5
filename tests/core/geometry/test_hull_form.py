"""The likely shape of a hull by the proportions of its box."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.geometry.hull_form import default_shape


@pytest.mark.parametrize(
    ("sides", "fullness", "shape"),
    [
        ((1.6, 0.2, 0.2), 0.7, "torpedo"),
        ((1.6, 0.2, 0.1), 0.7, "box"),
        ((1.6, 0.2, 0.1), 0.5, "ellipsoid"),
        ((0.5, 0.4, 0.3), 0.5, "ellipsoid"),
        ((0.5, 0.4, 0.3), 0.2, "box"),
    ],
)
@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_a_shape_goes_by_proportions_and_not_by_size(sides, fullness, shape, scale):
    assert default_shape(scale * np.array(sides), fullness) == shape
