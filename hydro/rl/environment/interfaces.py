"""Interfaces of a fleet: guidance along a path, and the results of a step."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Array32, Mask

State = dict[str, NDArray[np.generic]]


class Guidance(Protocol):
    """Path planner and follower of a fleet."""

    def reset(self, mask: Mask, starts: Array, goals: Array, pillars: Array) -> None:
        """Plan new paths for some vehicles (N,): starts and goals (N, 3), NED, pillars (N, P, 2)."""

    def targets(self, mask: Mask, positions: Array) -> tuple[Array, Array]:
        """Return target points (N, 3) and weighted cross-track costs (N,) at positions (N, 3).

        It is called once per control step; rows outside the mask (N,) neither advance nor are read.
        """

    def state(self) -> State:
        """Return the complete state."""

    def restore(self, state: State) -> None:
        """Restore a state, bit for bit."""


class Info(NamedTuple):
    """Outcome of a step of every vehicle, (N,) each.

    Totals cover the episode up to and including this step; they are final if the episode ends here.

    Attributes:
        success: It arrived, or it held or followed its goal until the end of the episode.
        collision: It touched something or broke the surface.
        diverged: The simulation raised a warning, or its state is not finite.
        distance: Distance to the goal at the end of the step [m].
        overspeed: It moved faster than `Settings.overspeed`.
        episode_return: Sum of rewards.
        episode_length: Number of steps.
        episode_energy: Time of full thrust of all thrusters with the same energy [s].
        episode_overspeed: Steps faster than `Settings.overspeed`.
        episode_error: Root mean square distance from the goal since settling [m], for tasks that hold or
            follow; otherwise 0.
        reward_terms: Terms of the reward of this step, costs negative (N, TERMS), in the order of
            `reward.TERMS`.
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
    reward_terms: Array


class Step(NamedTuple):
    """Result of a step of all vehicles.

    Attributes:
        obs: Observations to act on next (N, O); of the new episode if one ended.  O is 36 times
            `Settings.history`, the newest first.
        reward: (N,).
        terminated: Success, collision or divergence (N,).
        truncated: Last step of an episode that ended by time alone (N,).
        final_obs: Observations of the states that the step led to (N, O), before any new episode.
        info: Further outcome and totals.
    """

    obs: Array32
    reward: Array32
    terminated: Mask
    truncated: Mask
    final_obs: Array32
    info: Info
