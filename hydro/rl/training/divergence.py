"""When learning counts as diverged; defined before any run, and counted in every one.

Of learning: the critic's loss stays above 100 times its running median for 1,000 updates, or the success of
evaluations, once at half or more, falls to zero and stays there to the end.  Numerical: a loss that is not
finite, or an episode in which MuJoCo warned or a state was not finite.  Speed alone is no divergence.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

FACTOR, UPDATES = 100.0, 1_000
EVERY = 1_000  # updates from one median to the next
HALF = 0.5


class Watch:
    """Watches the losses and evaluations of one training.

    Attributes:
        exploded: Whether the critic's loss has met the definition.
        broken: Whether a loss was not finite.
        episodes: Episodes that ended in numerical divergence.
    """

    def __init__(self) -> None:
        """Nothing has happened yet."""
        self.exploded, self.broken, self.episodes = False, False, 0
        self._losses: list[float] = []
        self._median, self._above = math.inf, 0
        self._best, self._last = 0.0, 1.0

    def loss(self, critic: float) -> None:
        """Hear of the critic's loss of an update."""
        self.broken |= not math.isfinite(critic)
        self._losses.append(critic)
        if len(self._losses) % EVERY == 0:
            self._median = float(np.median(np.array(self._losses)))
        self._above = self._above + 1 if critic > FACTOR * self._median else 0
        self.exploded |= self._above >= UPDATES

    def evaluation(self, success: float) -> None:
        """Hear of the share of successes of an evaluation."""
        self._best, self._last = max(self._best, success), success

    @property
    def collapsed(self) -> bool:
        """Whether evaluations now fail altogether after half of them, or more, succeeded."""
        return self._best >= HALF and self._last == 0.0

    @property
    def verdict(self) -> str:
        """What has diverged: `numerical`, `critic`, `success` or nothing; the first of them that holds."""
        found = {
            "numerical": self.broken or self.episodes > 0,
            "critic": self.exploded,
            "success": self.collapsed,
        }
        return next((name for name, holds in found.items() if holds), "")

    def state(self) -> dict[str, Any]:
        """Everything that the future depends on."""
        return {name: value for name, value in vars(self).items() if name != "_losses"} | {
            "_losses": np.array(self._losses, dtype=np.float32)
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a `state`."""
        vars(self).update(state | {"_losses": state["_losses"].tolist()})
