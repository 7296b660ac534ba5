"""Progress in a curriculum: open water, slalom, forest with a planned path (Wu et al., section III-D)."""

from __future__ import annotations

from collections import deque
from typing import Any

from hydro.rl.training.config import Curriculum


class CurriculumProgress:
    """Progress of a training in its curriculum.

    Attributes:
        config: Levels and conditions that pass them.
        passed: Passed levels, each a task and its level.
    """

    def __init__(self, config: Curriculum) -> None:
        """Start at the first level."""
        self.config = config
        self.passed: list[tuple[str, int]] = []
        self._window: deque[bool] = deque(maxlen=config.window)
        self._recent: deque[bool] = deque(maxlen=config.window)

    @property
    def done(self) -> bool:
        """Whether the last level is passed."""
        return not self._ahead

    @property
    def level(self) -> tuple[str, int]:
        """Level that is trained now, as a pair of task and number; the last level if all are passed."""
        return (self._ahead or self.config.levels[-1:])[0]

    @property
    def _ahead(self) -> tuple[tuple[str, int], ...]:
        """Return the levels that are not passed yet."""
        return tuple(level for level in self.config.levels if level not in self.passed)

    def completed(self, task: str) -> bool:
        """Return whether all levels of a task are passed."""
        return task not in {ahead for ahead, _ in self._ahead}

    @property
    def share(self) -> float:
        """Success rate of the last training episodes at the current level, 0 to 1.

        0 before the first episode. An examination leaves this rate unchanged, but empties the window that
        triggers examinations.
        """
        return sum(self._recent) / len(self._recent) if self._recent else 0.0

    @property
    def ready(self) -> bool:
        """Whether the success rate in training is high enough for an examination."""
        full = len(self._window) == self.config.window
        return full and sum(self._window) / self.config.window >= self.config.ready

    def note(self, success: bool) -> None:
        """Record whether a training episode at the current level succeeded."""
        self._window.append(bool(success))
        self._recent.append(bool(success))

    def examined(self, share: float) -> bool:
        """Record the success rate of an examination; return whether the rate passes the level.

        After a failure, the window of training episodes must fill again before the next examination.

        Args:
            share: Success rate, 0 to 1.
        """
        passed = share >= self.config.share
        self.passed += [self.level] if passed else []
        self._window.clear()
        if passed:
            self._recent.clear()
        return passed

    def forget(self, level: tuple[str, int]) -> None:
        """Mark a passed level as not passed, and discard the results of training episodes."""
        self.passed.remove(level)
        self._window.clear()
        self._recent.clear()

    @property
    def ends(self) -> dict[str, int]:
        """Last level of every task, by the task's name, in the order of the tasks."""
        return dict(self.config.levels)

    def state(self) -> dict[str, Any]:
        """Return the complete progress by name, for `restore`."""
        return {
            "passed": [list(level) for level in self.passed],
            "window": list(self._window),
            "recent": list(self._recent),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Set the progress that `state` of this or another curriculum returned; passed levels stay passed."""
        self.passed = [(task, level) for task, level in state["passed"]]
        self._window = deque(state["window"], maxlen=self.config.window)
        self._recent = deque(state["recent"], maxlen=self.config.window)
