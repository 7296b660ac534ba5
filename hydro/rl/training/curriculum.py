"""Which task comes next: from open water through a slalom to a forest with a plan (paper III-D)."""

from __future__ import annotations

from collections import deque
from typing import Any

from hydro.rl.training.config import Curriculum


class CurriculumProgress:
    """Where a training stands in its curriculum.

    Attributes:
        config: When it goes on.
        passed: Levels behind it, each a task and its level.
    """

    def __init__(self, config: Curriculum) -> None:
        """Begin at the first level."""
        self.config = config
        self.passed: list[tuple[str, int]] = []
        self._window: deque[bool] = deque(maxlen=config.window)

    @property
    def done(self) -> bool:
        """Whether the last level is passed."""
        return not self._ahead

    @property
    def level(self) -> tuple[str, int]:
        """Task and level that it stands at; the last once that is passed."""
        return (self._ahead or self.config.levels[-1:])[0]

    @property
    def _ahead(self) -> tuple[tuple[str, int], ...]:
        """Levels that are not passed yet."""
        return tuple(level for level in self.config.levels if level not in self.passed)

    def behind(self, task: str) -> bool:
        """Whether no level of a task is ahead any more."""
        return task not in {ahead for ahead, _ in self._ahead}

    @property
    def share(self) -> float:
        """Share of the last episodes of training at this level that succeeded; 0 before the first."""
        return sum(self._window) / len(self._window) if self._window else 0.0

    @property
    def ready(self) -> bool:
        """Whether training succeeds often enough to be examined."""
        return len(self._window) == self.config.window and self.share >= self.config.ready

    def note(self, success: bool) -> None:
        """An episode of training at this level has ended."""
        self._window.append(bool(success))

    def examined(self, share: float) -> bool:
        """Hear how many episodes without exploration succeeded; whether the level is passed by that.

        A failed examination is not tried again before as many more episodes as make a window.
        """
        passed = share >= self.config.share
        self.passed += [self.level] if passed else []
        self._window.clear()
        return passed

    def forget(self, level: tuple[str, int]) -> None:
        """Let a level be ahead again that was passed."""
        self.passed.remove(level)
        self._window.clear()

    @property
    def ends(self) -> dict[str, int]:
        """The last level of every task, in order."""
        return dict(self.config.levels)

    def state(self) -> dict[str, Any]:
        """Everything that the future depends on."""
        return {"passed": [list(level) for level in self.passed], "window": list(self._window)}

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a `state`, of this curriculum or another: what was passed stays passed."""
        self.passed = [(task, level) for task, level in state["passed"]]
        self._window = deque(state["window"], maxlen=self.config.window)
