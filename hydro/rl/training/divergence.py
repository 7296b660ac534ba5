"""Divergence of a training: its definition, which was fixed before any run and applies to all.

Divergence of learning: the critic's loss stays above 100 times its running median for 1,000 updates.  Or the
success rate of evaluations reaches a half or more, then falls to zero and stays there to the end.  Numerical
divergence: a loss that is not finite, or an episode in which MuJoCo warned or a state was not finite.  High
speed alone is not divergence.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

FACTOR, UPDATES = 100.0, 1_000  # loss in multiples of its median, and updates above it
EVERY = 1_000  # updates between medians
HALF = 0.5  # success rate from which a fall to zero counts as divergence


class Watch:
    """Monitor of the losses and evaluations of one training.

    Attributes:
        exploded: Whether the critic's loss has stayed above 100 times its running median for 1,000 updates.
        broken: Whether a loss was not finite.
        episodes: Number of episodes that ended in numerical divergence.
    """

    def __init__(self) -> None:
        """Start without losses and evaluations."""
        self.exploded, self.broken, self.episodes = False, False, 0
        self._losses: list[float] = []
        self._median, self._above = math.inf, 0
        self._best, self._last = 0.0, 1.0

    def loss(self, critic: float) -> None:
        """Record the loss of the critics in one update."""
        self.broken |= not math.isfinite(critic)
        self._losses.append(critic)
        if len(self._losses) % EVERY == 0:
            self._median = float(np.median(np.array(self._losses)))
        self._above = self._above + 1 if critic > FACTOR * self._median else 0
        self.exploded |= self._above >= UPDATES

    def evaluation(self, success: float) -> None:
        """Record the success rate of an evaluation."""
        self._best, self._last = max(self._best, success), success

    @property
    def collapsed(self) -> bool:
        """Whether the last evaluation has no success at all, after an earlier one with at least half."""
        return self._best >= HALF and self._last == 0.0

    @property
    def verdict(self) -> str:
        """First kind of divergence found: `numerical`, `critic`, `success`, or an empty text."""
        found = {
            "numerical": self.broken or self.episodes > 0,
            "critic": self.exploded,
            "success": self.collapsed,
        }
        return next((name for name, holds in found.items() if holds), "")

    def state(self) -> dict[str, Any]:
        """Return the complete state of the monitor by name, for `restore`."""
        return {name: value for name, value in vars(self).items() if name != "_losses"} | {
            "_losses": np.array(self._losses, dtype=np.float32)
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Set the state that `state` of a monitor returned."""
        vars(self).update(state | {"_losses": state["_losses"].tolist()})
