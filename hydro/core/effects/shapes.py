"""The shapes of an effect that is linear in one of its parameters once the others are held."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.record import Effect, Shape, Table
from hydro.core.vehicle.description import Vehicle

LEVER = 0.25
"""Of the hull's length: how far from CO a point of the body is tried besides."""


def along(effect: Effect, name: str, held: Mapping[str, Any], vehicle: Vehicle) -> Shape:
    """One column per entry of a parameter, the others held.

    Args:
        effect: The effect.
        name: The parameter in which it is linear.
        held: The table about which it is.
        vehicle: The vehicle, for the scales.
    """
    parameter, start = effect.parameter(name), np.array(held[name], float)
    places = list(np.ndindex(start.shape))
    scales = np.array([parameter.scale_at(place, vehicle) for place in places])
    steps = scales * effect.identification.step

    def moved(by: Array) -> Table:
        values = start + by.reshape(start.shape)
        return {**held, name: np.clip(values, parameter.low, parameter.high).tolist()}

    return Shape(
        tables=tuple(moved(step) for step in np.diag(steps)),
        steps=tuple((steps / scales).tolist()),
        begin=lambda amounts: moved(amounts * scales),
    )
