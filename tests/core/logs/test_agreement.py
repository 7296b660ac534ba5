"""Evidence of a log that lacks what is asked about."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hydro.core.logs.agreement import Evidence
from hydro.core.logs.logmap import Position


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_only_what_was_placed_above_the_surface_is_above_water(share: float):
    """By so many rows at 5 m of height, the others at 5 m of depth; nowhere where no position is known."""
    place = np.zeros((40, 10, 3))
    place[..., 2] = np.where(np.arange(40)[:, None] < 40 * share, -5.0, 5.0)
    evidence = cast(Any, SimpleNamespace(placed=lambda _: place))
    assert Evidence.above_water(evidence, Position(("x", "y", "z"))) == pytest.approx(share)
    assert Evidence.above_water(evidence, None) == 0.0
