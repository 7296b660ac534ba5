"""The last values of every vehicle: for what arrives late, and for what is remembered."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Mask, Rows


class Past:
    """Values of N vehicles over their last steps, newest first.

    Attributes:
        values: (N, depth, width).
        late: By how many steps each vehicle's values arrive late, (N,).
    """

    def __init__(self, count: int, depth: int, width: int, dtype: type) -> None:
        """Make room for `depth` steps of `width` values."""
        self.values: NDArray[Any] = np.zeros((count, depth, width), dtype=dtype)
        self.late: Rows = np.zeros(count, dtype=np.int64)

    def begin(self, mask: Mask, values: NDArray[Any], late: Rows) -> None:
        """Let some vehicles (N,) have had these values (N, width) for long; theirs arrive so late (N,)."""
        self.values[mask] = values[mask, None]
        self.late[mask] = late[mask]

    def note(self, mask: Mask, values: NDArray[Any]) -> None:
        """The values (N, width) of a new step of some vehicles (N,)."""
        if self.values.shape[1] > 1:
            self.values[mask, 1:] = self.values[mask, :-1]
        np.copyto(self.values[:, 0], values, where=mask[:, None])

    def seen(self, steps: int = 1) -> NDArray[Any]:
        """What has arrived of the last steps, newest first (N, steps * width); a copy."""
        if not self.late.any():
            return self.values[:, :steps].reshape(len(self.values), -1).copy()
        rows = self.late[:, None] + np.arange(steps)
        taken = np.take_along_axis(self.values, rows[:, :, None], axis=1)
        return taken.reshape(len(self.values), -1)
