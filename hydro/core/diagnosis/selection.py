"""Selection loop of every regime: add the best candidate of each round while it belongs to the model."""

from __future__ import annotations

from typing import Protocol, TypeVar

from hydro.core.progress import Progress

State = TypeVar("State")
"""Model with the effects selected so far."""
Step = TypeVar("Step")
"""Best candidate of a round, with its rivals."""


class Rounds(Protocol[State, Step]):
    """Protocol of the rounds of a selection under one criterion."""

    def is_open(self, state: State, /) -> bool:
        """Return whether another round may add an effect."""

    def best(self, state: State, progress: Progress, /) -> Step | None:
        """Screen and fit candidates, and return the best by the criterion; None without any."""

    def belongs(self, state: State, step: Step, /) -> bool:
        """Return whether the best candidate is large enough to be selected."""

    def added(self, state: State, step: Step, /) -> State:
        """Return the state with the candidate, with earlier ones pruned or swapped."""


def grow(rounds: Rounds[State, Step], state: State, progress: Progress) -> tuple[State, Step | None]:
    """Add the best candidate of each round until none belongs.

    Args:
        rounds: Criterion.
        state: State to start from.
        progress: Called with a short text and the share of the work done.

    Returns:
        The last state, and the best candidate of the last round where it does not belong.
    """
    while rounds.is_open(state):
        step = rounds.best(state, progress)
        if step is None or not rounds.belongs(state, step):
            return state, step
        state = rounds.added(state, step)
    return state, None
