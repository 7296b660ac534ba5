"""The shapes of an effect: linear in one of its parameters once the others are held, or changed by a size.

Of a threshold a derivative at its absence says nothing: no command lies within a dead band of no width.  What
a change of a size that is to be expected does is a column that says something, at some such sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.record import Effect, Shape, Shapes, Table
from hydro.core.vehicle.description import Vehicle

LEVER = 0.25
"""Of the hull's length: how far from CO a point of the body is tried besides."""
Room = Callable[[Vehicle], tuple[float, float]]
"""Least and greatest value of a number on a vehicle."""
LEAST, MOST = 0.5, 1.5
"""Times a size from which a fit begins that the column of this size asks for."""


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


def of_sizes(name: str, parameter: str, room: Room, sizes: Sequence[float]) -> Shapes:
    """One column per size of an effect's only number, of which 1 is that size.

    Args:
        name: The effect.
        parameter: Its number.
        room: Least and greatest value on a vehicle; where the least is below 0, it and half of it are tried.
        sizes: What else is tried where there is room, none of them 0.
    """

    def shapes(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
        low, high = room(vehicle)

        def sized(size: float) -> Shape:
            def begin(amounts: Array) -> Table:
                value = size * float(np.clip(amounts[0], LEAST, MOST))
                return {"name": name, parameter: float(np.clip(value, low, high))}

            return Shape(({"name": name, parameter: size},), (1.0,), begin)

        less = (0.5 * low, low) if low < 0.0 else ()
        yield from (sized(size) for size in sorted({*less, *sizes}) if low <= size <= high)

    return shapes
