"""Stretches of a recording that are left out together."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from hydro.core.residual.hull import STRETCH, stretches


def found(compared: int, lead: int) -> np.ndarray:
    """Stretches of fifty shots, of which so many rows are compared after some that are not."""
    shots = SimpleNamespace(
        starts=np.arange(50), length=compared + lead, lead=lead, record=SimpleNamespace(dt=0.02)
    )
    return stretches(cast(Any, shots))


def test_a_stretch_is_as_long_whatever_its_shots_look_back_on():
    for compared in (50, 100, 125):
        first = found(compared, 0)[: round(2.0 * STRETCH / (0.02 * compared))]
        np.testing.assert_array_equal(0.02 * compared * np.bincount(first), STRETCH)
        for lead in (5, 25):
            np.testing.assert_array_equal(found(compared, lead), found(compared, 0))
