"""Rewards of several steps ahead, of steps that stay on their device: `training.returns` in tensors."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import torch
from torch import Tensor


class Transition(NamedTuple):
    """A step of N vehicles, or several of them seen as one; see `training.returns.Transition`."""

    observations: Tensor
    actions: Tensor
    rewards: Tensor
    terminated: Tensor
    ended: Tensor
    following: Tensor
    steps: Tensor


class Horizon:
    """A window over the last steps: it gives each with the rewards of those after it, once they are known."""

    def __init__(self, steps: int, discount: float) -> None:
        """Make an empty window of so many steps, gamma = `discount` from one to the next."""
        self._discount = discount
        self._window: deque[Transition] = deque(maxlen=steps)

    def add(self, step: Transition) -> Transition | None:
        """Add the next step; give the oldest of the window with what followed, or nothing while it fills.

        What lies beyond the end of an episode does not count: its last steps look less far.
        """
        self._window.append(step)
        if len(self._window) < (self._window.maxlen or 1):
            return None
        first, *later = self._window
        rewards, steps, following = first.rewards, first.steps, first.following
        terminated, ended = first.terminated, first.ended
        for each in later:
            going = ~ended
            rewards = rewards + going * self._discount**steps * each.rewards
            steps = steps + going * each.steps
            following = torch.where(going[:, None], each.following, following)
            terminated = terminated | going & each.terminated
            ended = ended | each.ended
        return Transition(first.observations, first.actions, rewards, terminated, ended, following, steps)
