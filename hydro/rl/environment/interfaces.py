"""Interfaces of a fleet: guidance along a path, and the results of a step."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Array32, Mask

State = dict[str, NDArray[np.generic]]


class Guidance(Protocol):
    """Protocol of a path planner and follower for the N vehicles of a fleet."""

    def reset(self, mask: Mask, starts: Array, goals: Array, pillars: Array) -> None:
        """Plan new paths from start to goal, around pillars, for the vehicles of a mask.

        Args:
            mask: Vehicles that get a new path (N,).
            starts: Starts (N, 3), NED [m].
            goals: Goals (N, 3), NED [m].
            pillars: North and east of the pillars' axes (N, P, 2) [m], NaN in unused rows.
        """

    def targets(self, mask: Mask, positions: Array) -> tuple[Array, Array]:
        """Return each vehicle's target point on its path, and its weighted cross-track cost.

        The fleet calls this method once per control step.  Vehicles outside the mask do not advance, and
        their rows have no meaning.

        Args:
            mask: Vehicles that advance (N,).
            positions: Positions of CO (N, 3), NED [m].

        Returns:
            Target points (N, 3), NED [m], and costs (N,).
        """

    def state(self) -> State:
        """Return the complete state of all paths as arrays by name, for `restore`."""

    def restore(self, state: State) -> None:
        """Set the state that `state` returned, and continue bit for bit."""


class Info(NamedTuple):
    """Outcome of a step of every vehicle, (N,) each.

    Totals cover the episode up to and including this step; they are final if the episode ends here.

    Attributes:
        success: The vehicle arrived, or held or followed its goal until the end of the episode.
        collision: The vehicle touched an obstacle or broke the surface.
        diverged: The simulation raised a warning, or the vehicle's state is not finite.
        distance: Distance to the goal at the end of the step [m].
        overspeed: The vehicle moved faster than `Settings.overspeed`.
        episode_return: Sum of rewards.
        episode_length: Number of steps.
        episode_energy: Energy, as the time for which all thrusters at full thrust would use as much [s].
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
    """Result of a control step of N vehicles.

    Attributes:
        obs: Observations to act on next (N, O); of the new episode if one ended.  O is 36 times
            `Settings.history`, the newest first.
        reward: Reward of the step (N,).
        terminated: Success, collision or divergence (N,).
        truncated: Last step of an episode that ended by time alone (N,).
        final_obs: Observations at the end of the step (N, O), before any new episode begins.
        info: Outcome and totals of each vehicle.
    """

    obs: Array32
    reward: Array32
    terminated: Mask
    truncated: Mask
    final_obs: Array32
    info: Info
