"""Encoding of observations for a network: scaled to order one, with ranges as exponential nearness.

A policy that sees plain ranges learns slowly to keep clear of pillars.  The difference between a collision
and a safe passage is a hundredth of the sonar's reach; distant walls dominate the rest (docs/adr/0008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array32
from hydro.core.errors import DataError


@dataclass(frozen=True)
class Encoding:
    """Function that scales O observations in SI units to the input of a network.

    `scale` and `fades` define it.

    Attributes:
        scale: Typical size of each observation (O,), in the unit of the observation.
        fades: Mask (O,) of ranges, which become exp(-x / scale): 1 at contact, 0 far away.  All other
            observations become x / scale.
    """

    scale: Array32
    fades: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            DataError: `scale` and `fades` have different lengths.
        """
        if self.scale.ndim != 1 or self.scale.shape != self.fades.shape:
            raise DataError(
                f"encoding: {self.scale.size} scales and {self.fades.size} entries of fades: give one of "
                "each for every observation"
            )

    def __len__(self) -> int:
        """Return the number of observations O."""
        return len(self.scale)

    def __call__(self, observations: Array32) -> Array32:
        """Return the network input (..., O) for observations (..., O) in SI units."""
        given: Array32 = observations / self.scale
        given[..., self.fades] = np.exp(-given[..., self.fades])
        return given
