"""Rewards of several steps ahead, of steps that stay on their device: `training.returns` in tensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from hydro.rl.training.returns import Window


class Transition(NamedTuple):
    """A step of N vehicles, or several of them seen as one; see `training.returns.Transition`."""

    observations: Tensor
    actions: Tensor
    rewards: Tensor
    terminated: Tensor
    ended: Tensor
    following: Tensor
    steps: Tensor


class Horizon(Window[Transition]):
    """The window over steps in tensors."""

    def _together(self, first: Transition, later: Sequence[Transition]) -> Transition:
        """A step and those after it, seen as one."""
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
