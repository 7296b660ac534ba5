"""Boxes: published tables, boundary element solutions, scaling, bad sizes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.core.geometry.box import box_added_mass

RHO = 1000.0
SIDE = st.floats(0.05, 3.0)

# Capytaine 3.0, unbounded fluid, 8 x 8 panels per face in cosine spacing; diagonal, rho = 1000.
BOUNDARY_ELEMENTS = {
    (1.0, 1.0, 1.0): (648.6, 648.6, 648.6, 38.49, 38.49, 38.49),
    (2.0, 1.0, 1.0): (692.5, 1687.1, 1687.1, 82.56, 314.8, 314.8),
    (4.0, 1.0, 1.0): (735.4, 3987.4, 3987.4, 170.7, 3677.2, 3677.2),
    (0.46, 0.58, 0.38): (65.79, 48.75, 86.24, 1.227, 0.7729, 1.1065),
    (1.4, 0.7, 0.5): (144.2, 336.6, 558.3, 9.287, 52.11, 33.59),
}


@pytest.mark.parametrize("sides", BOUNDARY_ELEMENTS)
def test_boxes_are_those_of_boundary_elements(sides):
    ratio = box_added_mass(sides, RHO) / np.array(BOUNDARY_ELEMENTS[sides])
    np.testing.assert_allclose(ratio[:3], 1.0, atol=0.2)
    np.testing.assert_allclose(ratio[3:], 1.0, atol=0.3)


@pytest.mark.parametrize(("length", "coefficient"), [(1.0, 0.68), (2.0, 0.36), (3.0, 0.24), (5.0, 0.15)])
def test_square_prisms_along_the_flow(length, coefficient):
    """DNV-RP-C205, table D-2: relative to the prism's volume."""
    assert box_added_mass((length, 1.0, 1.0), RHO)[0] == pytest.approx(coefficient * RHO * length, rel=0.21)


def test_a_thin_square_plate():
    """DNV-RP-C205, table D-2: 0.579 rho pi/4 a^3."""
    assert box_added_mass((1.0, 1.0, 1e-6), RHO)[2] == pytest.approx(0.579 * np.pi / 4 * RHO, rel=1e-3)


@given(st.tuples(SIDE, SIDE, SIDE), st.floats(0.1, 10.0))
def test_scales_with_density_and_size(sides, scale):
    powers = np.array([3, 3, 3, 5, 5, 5])
    scaled = box_added_mass([side * scale for side in sides], 2.0 * RHO)
    np.testing.assert_allclose(scaled, 2.0 * scale**powers * box_added_mass(sides, RHO), rtol=1e-6)


@given(st.tuples(SIDE, SIDE, SIDE))
def test_axes_turn_with_the_box(sides):
    turned = box_added_mass((sides[1], sides[2], sides[0]), RHO)
    straight = box_added_mass(sides, RHO)
    np.testing.assert_allclose(turned, straight[[1, 2, 0, 4, 5, 3]], rtol=1e-6)


@given(st.tuples(SIDE, SIDE, SIDE), st.floats(1.0, 3.0))
def test_a_deeper_box_moves_more_water(sides, more):
    deeper = (sides[0] * more, sides[1], sides[2])
    assert box_added_mass(deeper, RHO)[0] >= box_added_mass(sides, RHO)[0]
    assert np.all(box_added_mass(sides, RHO) > 0.0)


@pytest.mark.parametrize("sides", [(0.0, 1, 1), (1, -1, 1), (1, np.nan, 1), (np.inf, 1, 1), (1, 1)])
def test_no_box(sides):
    with pytest.raises(DataError, match="positive, finite length, width and height"):
        box_added_mass(sides, RHO)
