"""Where a fit of a payload begins."""

from __future__ import annotations

import numpy as np
import pytest
from bench import BARE, wrench

from hydro.core.effects.restoring import payloads

ETA = np.array([0.0, 0.0, 5.0, 0.4, -0.3, 1.0])


@pytest.mark.parametrize("amounts", [(0.5, 0.3, -0.2, 0.4), (-0.5, -0.3, 0.2, -0.4), (2.0, 0.0, 0.0, 0.0)])
def test_a_payload_begins_with_the_wrench_that_its_columns_add_up_to(amounts):
    """The columns are its weight at CO and at three places; their sum is one weight at one place."""
    (shape,) = payloads(BARE, None)
    still = np.zeros(6)
    each = [wrench(dict(table), ETA, still) for table in shape.tables[:4]]
    expected = sum(amount / step * one for amount, step, one in zip(amounts, shape.steps, each, strict=False))
    begun = shape.begin(np.array([*amounts, 0.0]))
    np.testing.assert_allclose(wrench(dict(begun), ETA, still), expected, atol=1e-9)


def test_a_payload_without_weight_begins_within_the_hull():
    """Two moments and no weight: no place has them."""
    (shape,) = payloads(BARE, None)
    begun = shape.begin(np.array([-0.5, 0.5, 0.0, 0.0, 0.0]))
    place = np.array([begun[axis] for axis in "xyz"])
    assert np.isfinite(begun["w"])
    assert (np.abs(place) <= BARE.hull.length).all()
