"""Which task comes next: from open water through pillars to a path to follow (paper III-D)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

from hydro.core.errors import UsageError

STAGES = 3


@dataclass(frozen=True)
class Ladder:
    """When the curriculum goes on.

    Attributes:
        last: Last stage, 1 to 3.
        pillars: Numbers of pillars of stage 2, one level each; stage 3 has as many as its last.
        share: Share of episodes without exploration that must succeed.
        ready: Share of the last episodes of training from which on they are flown; exploration itself makes
            a policy fail that would not by itself, the more the closer it passes by pillars.
        window: Episodes that both are taken of.
    """

    last: int = 1
    pillars: tuple[int, ...] = (0, 2, 4, 8)
    share: float = 0.97
    ready: float = 0.9
    window: int = 150

    def __post_init__(self) -> None:
        """Refuse what is no ladder.

        Raises:
            UsageError: There is no such stage, no level of pillars, or a share that is none.
        """
        if not 1 <= self.last <= STAGES:
            raise UsageError(f"there is no stage {self.last}: choose 1 to {STAGES}")
        if not self.pillars or min(self.pillars) < 0:
            raise UsageError("stage 2 needs at least one level, of 0 pillars or more")
        if not (0.0 < self.share <= 1.0 and 0.0 < self.ready <= 1.0) or self.window < 1:
            raise UsageError("the curriculum goes on at a share within 0 and 1 of at least one episode")

    @property
    def levels(self) -> tuple[tuple[int, int], ...]:
        """Stage and number of pillars of every level, in order."""
        stages = ((1, 0),), tuple((2, pillars) for pillars in self.pillars), ((3, self.pillars[-1]),)
        return tuple(level for stage in stages[: self.last] for level in stage)


class Curriculum:
    """Where a training stands on its ladder.

    Attributes:
        ladder: When it goes on.
        passed: Levels behind it, stage and number of pillars.
    """

    def __init__(self, ladder: Ladder) -> None:
        """Begin at the first level."""
        self.ladder = ladder
        self.passed: list[tuple[int, int]] = []
        self._window: deque[bool] = deque(maxlen=ladder.window)

    @property
    def done(self) -> bool:
        """Whether the last level is passed."""
        return not self._ahead

    @property
    def level(self) -> tuple[int, int]:
        """Stage and pillars of the level it stands at; of the last once that is passed."""
        return (self._ahead or self.ladder.levels[-1:])[0]

    @property
    def _ahead(self) -> tuple[tuple[int, int], ...]:
        """Levels that are not passed yet."""
        return tuple(level for level in self.ladder.levels if level not in self.passed)

    @property
    def share(self) -> float:
        """Share of the last episodes of training at this level that succeeded; 0 before the first."""
        return sum(self._window) / len(self._window) if self._window else 0.0

    @property
    def ready(self) -> bool:
        """Whether training succeeds often enough to be examined."""
        return len(self._window) == self.ladder.window and self.share >= self.ladder.ready

    def note(self, success: bool) -> None:
        """An episode of training at this level has ended."""
        self._window.append(bool(success))

    def examined(self, share: float) -> bool:
        """Hear how many episodes without exploration succeeded; whether the level is passed by that.

        A failed examination is not tried again before as many more episodes as make a window.
        """
        passed = share >= self.ladder.share
        self.passed += [self.level] if passed else []
        self._window.clear()
        return passed

    def state(self) -> dict[str, Any]:
        """Everything that the future depends on."""
        return {"passed": [list(level) for level in self.passed], "window": list(self._window)}

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a `state`, of this ladder or another: what was passed stays passed."""
        self.passed = [(stage, pillars) for stage, pillars in state["passed"]]
        self._window = deque(state["window"], maxlen=self.ladder.window)
