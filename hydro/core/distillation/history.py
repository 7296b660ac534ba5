"""Past velocities as inputs of a network: nu one period ago, two periods ago, and so on, newest first.

Before a recording or a flight began, the vehicle is taken to have moved as it did at its first moment.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import VELOCITY, Array
from hydro.core.compiled import kernel
from hydro.core.errors import DataError

AXES = 6
PERIOD_TOLERANCE = 0.01  # of a sample time, within which a period must be whole


def remembered(window: int) -> int:
    """How many numbers are kept of the past for a window of so many velocities, the present one included."""
    return AXES * (window - 1)


def names(window: int) -> tuple[str, ...]:
    """Names of the past velocities, such as u-1 for surge one period ago, in their order."""
    return tuple(f"{axis}-{back}" for back in range(1, window) for axis in VELOCITY)


def stride(period: float, dt: float) -> int:
    """Rows of a recording with sample time `dt` [s] that make up a period [s].

    Raises:
        DataError: The period is no multiple of the sample time.
    """
    rows = round(period / dt)
    if rows < 1 or abs(rows * dt - period) > PERIOD_TOLERANCE * dt:
        raise DataError(
            f"the model has past velocities {period:g} s apart, which is no multiple of the sample time of "
            f"{dt:g} s: resample the log"
        )
    return rows


def past(nu: ArrayLike, bounds: ArrayLike, window: int, stride: int) -> Array:
    """Past velocities at every row of a recording.

    Args:
        nu: Velocities (N, 6) [m/s, rad/s].
        bounds: First and past-the-last row of each unbroken segment (S, 2); no past reaches across.
        window: Velocities in all, the present one included.
        stride: Rows between them.

    Returns:
        Shape (N, 6 (window - 1)), newest first.
    """
    velocities = np.asarray(nu, dtype=np.float64)
    edges = np.asarray(bounds, dtype=np.int64).reshape(-1, 2)
    first = np.repeat(edges[:, 0], edges[:, 1] - edges[:, 0])
    rows = np.arange(len(velocities))
    back = [velocities[np.maximum(rows - k * stride, first)] for k in range(1, window)]
    return np.concatenate(back, axis=1) if back else np.empty((len(velocities), 0))


@kernel
def begin(nu: Array, memory: Array) -> None:
    """Fill the memory (6 (window - 1),) of a flight that begins with the velocity nu (6,)."""
    for k in range(memory.size):
        memory[k] = nu[k % AXES]


@kernel
def remember(nu: Array, memory: Array) -> None:
    """Move the memory (6 (window - 1),) on by one period: nu (6,) becomes the newest past."""
    for k in range(memory.size - 1, AXES - 1, -1):
        memory[k] = memory[k - AXES]
    for k in range(min(AXES, memory.size)):
        memory[k] = nu[k]
