"""n-step returns of transitions that stay on their device: `training.returns` for tensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from hydro.rl.training.returns import Window


class Transition(NamedTuple):
    """Transition of N vehicles over one or more control steps, on the GPU.

    Each vehicle has O observations and A action components.

    Attributes:
        observations: Observations before the transition (N, O).
        actions: Actions of the first step (N, A).
        rewards: Discounted sum of the rewards (N,).
        terminated: Whether the episode terminated (N,).
        ended: Whether the episode terminated or was truncated (N,).
        following: Observations after the transition, before any new episode (N, O).
        steps: Number of steps (N,).
    """

    observations: Tensor
    actions: Tensor
    rewards: Tensor
    terminated: Tensor
    ended: Tensor
    following: Tensor
    steps: Tensor


class Horizon(Window[Transition]):
    """Window over the last n steps that combines tensors into n-step transitions."""

    def _together(self, first: Transition, later: Sequence[Transition]) -> Transition:
        """Combine the first step with the later ones of its episode into one n-step transition."""
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
