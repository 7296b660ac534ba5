"""Selection loop: add the best candidate of each round while it belongs to the model.

| rounds | candidates | ranked by | belongs if |
|---|---|---|---|
| `search.Search` | effects | penalised squared residual | `Baseline.belongs` |
| `by_change.ByChange` | changes | penalised held-out residual | `Change.seen` |
| `discovery.discover.Discovery` | terms of a formula | held-out error | that error falls clearly |
"""

from __future__ import annotations

from typing import Protocol, TypeVar

from hydro.core.progress import Progress

State = TypeVar("State")
"""Model with the effects selected so far."""
Step = TypeVar("Step")
"""Best candidate of a round, with its rivals."""


class Rounds(Protocol[State, Step]):
    """Rounds of a selection of effects by one criterion, such as likelihood or held-out error."""

    def is_open(self, state: State, /) -> bool:
        """Return whether another round may add an effect."""

    def best(self, state: State, progress: Progress, /) -> Step | None:
        """Screen and fit candidates, and return the best by the criterion; None without candidates."""

    def belongs(self, state: State, step: Step, /) -> bool:
        """Return whether the best candidate is large enough to be selected."""

    def added(self, state: State, step: Step, /) -> State:
        """Return the state with the candidate; earlier ones may be dropped or replaced."""


def grow(rounds: Rounds[State, Step], state: State, progress: Progress) -> tuple[State, Step | None]:
    """Add the best candidate of each round until none belongs to the model.

    Returns:
        The last state, and the best candidate of the last round if it does not belong to the model.
    """
    while rounds.is_open(state):
        step = rounds.best(state, progress)
        if step is None or not rounds.belongs(state, step):
            return state, step
        state = rounds.added(state, step)
    return state, None
