"""Past velocities as network inputs: nu one period ago, two periods ago, and so on, newest first.

Before the start of a recording or flight, the velocity is assumed constant at its first value.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import VELOCITY, Array
from hydro.core.compiled import kernel
from hydro.core.errors import DataError

AXES = 6
PERIOD_TOLERANCE = 0.01  # greatest deviation of a period from whole sample times [sample times]


def memory_size(window: int) -> int:
    """Return the number of past values, 6 (window - 1), of a window that includes the present velocity."""
    return AXES * (window - 1)


def names(window: int) -> tuple[str, ...]:
    """Return the feature names of past velocities, such as `u-1` for surge one period ago.

    Args:
        window: Number of velocities, including the present one, which has no name here.
    """
    return tuple(f"{axis}-{back}" for back in range(1, window) for axis in VELOCITY)


def stride(period: float, dt: float) -> int:
    """Return the number of rows per period of a recording.

    Args:
        period: Time between the past velocities of a network [s].
        dt: Sample time of the recording [s].

    Raises:
        DataError: The period is not a multiple of the sample time.
    """
    rows = round(period / dt)
    if rows < 1 or abs(rows * dt - period) > PERIOD_TOLERANCE * dt:
        raise DataError(
            f"the model has past velocities {period:g} s apart, which is not a multiple of the sample time "
            f"of {dt:g} s: resample the log"
        )
    return rows


def past(nu: ArrayLike, bounds: ArrayLike, window: int, stride: int) -> Array:
    """Return the past velocities at every row of a recording.

    Args:
        nu: Velocities in N rows, (N, 6) [m/s, rad/s].
        bounds: First and past-the-last row of each of S unbroken segments, (S, 2).  Before the start of a
            segment, its first velocity is repeated.
        window: Number of velocities, including the present one.
        stride: Rows between two of these velocities.

    Returns:
        Past velocities without the present one, newest first, (N, 6 (window - 1)).
    """
    velocities = np.asarray(nu, dtype=np.float64)
    edges = np.asarray(bounds, dtype=np.int64).reshape(-1, 2)
    first = np.repeat(edges[:, 0], edges[:, 1] - edges[:, 0])
    rows = np.arange(len(velocities))
    back = [velocities[np.maximum(rows - k * stride, first)] for k in range(1, window)]
    return np.concatenate(back, axis=1) if back else np.empty((len(velocities), 0))


@kernel
def begin(nu: Array, memory: Array) -> None:
    """Fill a network's memory of past velocities with the first velocity of a flight.

    Args:
        nu: First velocity, (6,) [m/s, rad/s].
        memory: Past velocities, newest first, changed in place, (6 (window - 1),).
    """
    for k in range(memory.size):
        memory[k] = nu[k % AXES]


@kernel
def remember(nu: Array, memory: Array) -> None:
    """Shift a network's memory of past velocities by one period, and put a velocity in front.

    Args:
        nu: Newest velocity, (6,) [m/s, rad/s].
        memory: Past velocities, newest first, changed in place, (6 (window - 1),).
    """
    for k in range(memory.size - 1, AXES - 1, -1):
        memory[k] = memory[k - AXES]
    for k in range(min(AXES, memory.size)):
        memory[k] = nu[k]
