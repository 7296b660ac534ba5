"""History of the last values of every vehicle, for delays and for stacked observations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Mask, Rows


class History:
    """Values of N vehicles in their last control steps, newest first, with a delay for each vehicle.

    Attributes:
        values: The last `depth` steps of `width` numbers per vehicle (N, depth, width).
        late: Delay of each vehicle's values (N,) [steps].
    """

    def __init__(self, count: int, depth: int, width: int, dtype: type) -> None:
        """Allocate `depth` steps of `width` values."""
        self.values: NDArray[Any] = np.zeros((count, depth, width), dtype=dtype)
        self.late: Rows = np.zeros(count, dtype=np.int64)

    def fill(self, mask: Mask, values: NDArray[Any], late: Rows) -> None:
        """Set all past values of the vehicles of a mask to the same row of `values`, and set their delays.

        Args:
            mask: Vehicles (N,).
            values: Row of values for each vehicle (N, width).
            late: Delays (N,) [steps].
        """
        self.values[mask] = values[mask, None]
        self.late[mask] = late[mask]

    def append(self, mask: Mask, values: NDArray[Any]) -> None:
        """Append values (N, width) of a new step for the vehicles of a mask (N,); drop their oldest."""
        if self.values.shape[1] > 1:
            self.values[mask, 1:] = self.values[mask, :-1]
        np.copyto(self.values[:, 0], values, where=mask[:, None])

    def arrived(self, steps: int = 1) -> NDArray[Any]:
        """Return the values that have arrived: the newest `steps` steps at least as old as the delay.

        Returns:
            Copy of the values (N, steps * width), newest first.
        """
        if not self.late.any():
            return self.values[:, :steps].reshape(len(self.values), -1).copy()
        rows = self.late[:, None] + np.arange(steps)
        taken = np.take_along_axis(self.values, rows[:, :, None], axis=1)
        return taken.reshape(len(self.values), -1)
