"""Rewards of several steps ahead: values then travel further in an update than one control step (ADR 7)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array32, Mask


class Transition(NamedTuple):
    """A step of N vehicles, or several of them seen as one.

    Attributes:
        observations: Before it (N, O).
        actions: (N, A); of several steps, the first.
        rewards: (N,); of several steps, their discounted sum.
        terminated: An episode ended for good, (N,).
        ended: It ended, be it by time alone, (N,).
        following: Observations after it, before any new episode (N, O).
        steps: How many steps it is, (N,).
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
    """A window over the last steps: it gives each with the rewards of those after it, once they are known."""

    def __init__(self, steps: int, discount: float) -> None:
        """Make an empty window of so many steps, gamma = `discount` from one to the next."""
        self._discount = discount
        self._window: deque[Step] = deque(maxlen=steps)

    def add(self, step: Step) -> Step | None:
        """Add the next step; give the oldest of the window with what followed, or nothing while it fills.

        What lies beyond the end of an episode does not count: its last steps look less far.
        """
        self._window.append(step)
        if len(self._window) < (self._window.maxlen or 1):
            return None
        first, *later = self._window
        return self._together(first, later)

    @abstractmethod
    def _together(self, first: Step, later: Sequence[Step]) -> Step:
        """A step and those after it, seen as one."""


class Horizon(Window[Transition]):
    """The window over steps in arrays."""

    def _together(self, first: Transition, later: Sequence[Transition]) -> Transition:
        """A step and those after it, seen as one."""
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
        """Everything that the future depends on: the steps in the window."""
        return list(self._window)

    def restore(self, steps: Iterable[Iterable[Any]]) -> None:
        """Go on from the `state` of a window of as many steps."""
        self._window.clear()
        self._window.extend(Transition(*step) for step in steps)
