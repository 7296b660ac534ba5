"""What a network is given of observations: numbers of size one, and of ranges how near they are.

A policy that sees ranges as they are learns slowly to keep clear of pillars: between touching one and passing
by lies a hundredth of a sonar's reach, and the walls far away make up the rest (docs/adr/0008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array32
from hydro.core.errors import DataError


@dataclass(frozen=True)
class Encoding:
    """How each of O observations is given to a network.

    Attributes:
        scale: Typical size (O,), in the observation's unit: it is divided by this.
        fades: Those (O,) of which exp(-x / scale) is given instead of x / scale: one where something is
            touched, nothing far away.
    """

    scale: Array32
    fades: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Refuse what does not fit together.

        Raises:
            DataError: There is not one entry of each for every observation.
        """
        if self.scale.ndim != 1 or self.scale.shape != self.fades.shape:
            raise DataError(
                f"encoding: {self.scale.size} scales and {self.fades.size} entries on fading: give one of "
                "each for every observation"
            )

    def __len__(self) -> int:
        """Number of observations O."""
        return len(self.scale)

    def __call__(self, observations: Array32) -> Array32:
        """What a network is given (..., O) of observations (..., O) in SI units."""
        given: Array32 = observations / self.scale
        given[..., self.fades] = np.exp(-given[..., self.fades])
        return given
