"""What a fleet is led by, and what it tells of a step."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Array32, Mask

State = dict[str, NDArray[np.generic]]


class Guidance(Protocol):
    """What leads vehicles along a planned way."""

    def reset(self, mask: Mask, starts: Array, goals: Array, pillars: Array) -> None:
        """Plan anew for some vehicles (N,): starts and goals (N, 3), NED, pillars (N, P, 2)."""

    def targets(self, mask: Mask, positions: Array) -> tuple[Array, Array]:
        """Points to swim to (N, 3) and weighted costs of being off the path (N,), at positions (N, 3).

        Called once per control step; rows outside the mask (N,) neither advance nor are read.
        """

    def state(self) -> State:
        """Everything that the future depends on."""

    def restore(self, state: State) -> None:
        """Go back to a state, bit for bit."""


class Info(NamedTuple):
    """What happened to every vehicle in a step, (N,) each.

    The totals are of the episode up to and with this step; where it ends here they are final.

    Attributes:
        success: It arrived, or has held what it was to hold until time was up.
        collision: It touched something or broke the surface.
        diverged: The simulation raised a warning, or its state is not finite.
        distance: To the goal, at the end of the step [m].
        overspeed: It moved faster than `Settings.overspeed`.
        episode_return: Sum of rewards.
        episode_length: Steps.
        episode_energy: Time of all thrusters at full thrust that would have taken the same energy [s].
        episode_overspeed: Steps faster than `Settings.overspeed`.
        episode_error: Of a task that holds or follows, root mean square distance from the goal over the steps
            that count so far [m]; else 0.
    """

    success: Mask
    collision: Mask
    diverged: Mask
    distance: Array
    overspeed: Mask
    episode_return: Array
    episode_length: NDArray[np.int64]
    episode_energy: Array
    episode_overspeed: NDArray[np.int64]
    episode_error: Array


class Step(NamedTuple):
    """The outcome of a step of all vehicles.

    Attributes:
        obs: Observations to act on next (N, O): of the new episode where one ended.  O is 36 for each that is
            seen at once, the newest first, see `Settings.history`.
        reward: (N,).
        terminated: Success, collision or divergence, (N,).
        truncated: The last step of an episode that ended by time alone, (N,).
        final_obs: Observations of the states that the step led to (N, O), before any new episode.
        info: More.
    """

    obs: Array32
    reward: Array32
    terminated: Mask
    truncated: Mask
    final_obs: Array32
    info: Info
