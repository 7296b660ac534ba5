"""Trial shapes of an effect: linear in one parameter with all others held, or changed by a finite size.

A derivative at zero shows nothing of a threshold: no command lies within a dead band of zero width.  A change
by an expected size is an informative column, so some such sizes are tried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.record import Effect, Shape, Shapes, Table
from hydro.core.vehicle.description import Vehicle

LEVER = 0.25
"""Distance from CO, in hull lengths, of additional trial points."""
Room = Callable[[Vehicle], tuple[float, float]]
"""Function from a vehicle to the minimum and maximum of a number."""
LEAST, MOST = 0.5, 1.5
"""Range of the initial value of a fit, relative to the size of the column."""


def along(effect: Effect, name: str, held: Mapping[str, Any], vehicle: Vehicle) -> Shape:
    """Return a trial shape of an effect, a linear problem with one column for each component of a parameter.

    Args:
        effect: The effect.
        name: Parameter in which the effect is linear.
        held: Table with the values of all parameters, about which the columns are derivatives.
        vehicle: The vehicle, which sets the significant size of a component.
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
    """Return a function that yields trial shapes of an effect, one for each value of its only parameter.

    A shape is a linear problem, here of one column.  A coefficient of 1 means that the parameter has the
    trial value.

    Args:
        name: The effect.
        parameter: Name of its only parameter.
        room: Function from a vehicle to the parameter's admissible range.  A negative minimum, and half of
            that minimum, are also tried.
        sizes: Other trial values, not 0; those outside the range are skipped.
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
