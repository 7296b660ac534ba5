"""n-step returns: rewards of n control steps combined, so that values propagate faster (ADR 7)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array32, Mask


class Transition(NamedTuple):
    """Transition of N vehicles over one or more control steps; O observations and A action components each.

    Attributes:
        observations: Observations before the transition (N, O).
        actions: Actions of the first step (N, A).
        rewards: Discounted sum of the rewards (N,).
        terminated: Whether the episode terminated (N,).
        ended: Whether the episode terminated or was truncated (N,).
        following: Observations after the transition, before any new episode (N, O).
        steps: Number of steps (N,).
    """

    observations: Array32
    actions: Array32
    rewards: Array32
    terminated: Mask
    ended: Mask
    following: Array32
    steps: NDArray[np.int64]


Step = TypeVar("Step")


class Window(ABC, Generic[Step]):
    """Window over the last n steps that combines them into n-step transitions."""

    def __init__(self, steps: int, discount: float) -> None:
        """Make an empty window of n steps with the discount gamma per step."""
        self._discount = discount
        self._window: deque[Step] = deque(maxlen=steps)

    def add(self, step: Step) -> Step | None:
        """Add a step.

        Return the n-step transition that begins at the oldest step, or None while the window fills. A
        transition stops at the end of an episode, so the last steps of an episode cover fewer than n steps.
        """
        self._window.append(step)
        if len(self._window) < (self._window.maxlen or 1):
            return None
        first, *later = self._window
        return self._together(first, later)

    @abstractmethod
    def _together(self, first: Step, later: Sequence[Step]) -> Step:
        """Combine the first step with the later ones of its episode into one n-step transition."""


class Horizon(Window[Transition]):
    """Window over the last n steps that combines arrays into n-step transitions."""

    def _together(self, first: Transition, later: Sequence[Transition]) -> Transition:
        """Combine the first step with the later ones of its episode into one n-step transition."""
        rewards, steps = first.rewards.copy(), first.steps.copy()
        terminated, ended, following = first.terminated.copy(), first.ended.copy(), first.following.copy()
        for each in later:
            going = ~ended
            rewards[going] += self._discount ** steps[going] * each.rewards[going]
            steps[going] += each.steps[going]
            following[going] = each.following[going]
            terminated[going], ended[going] = each.terminated[going], each.ended[going]
        return Transition(first.observations, first.actions, rewards, terminated, ended, following, steps)

    def state(self) -> list[Transition]:
        """Return the steps in the window, the oldest first, for `restore`."""
        return list(self._window)

    def restore(self, steps: Iterable[Iterable[Any]]) -> None:
        """Replace the steps in the window by those that `state` of a window of the same length returned."""
        self._window.clear()
        self._window.extend(Transition(*step) for step in steps)
