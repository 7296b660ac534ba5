"""Engines that run the tasks of a command: this process, or a cluster (`study.cluster`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol, TypeVar

from hydro.study.steps import Step

Result = TypeVar("Result")


class Engine(Protocol):
    """Protocol of an engine, which runs the tasks of a command; results do not depend on the engine.

    Attributes:
        slots: Number of tasks that run at the same time.
    """

    slots: int

    def prepare(self, warm: Callable[[], object] | None = None) -> None:
        """Check that every node can run tasks, and run a function once on each node.

        Args:
            warm: Function to run, such as one that compiles kernels; None only checks.
        """

    def each(self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]) -> Iterator[Result]:
        """Run a task once for each tuple of arguments, and yield the results in that order.

        Args:
            task: Function of a module, which nodes import by its name.
            arguments: Positional arguments of each call.
        """

    def execute(self, step: Step) -> None:
        """Run a step of a study, which is a command of hydro.

        Args:
            step: The step.

        Raises:
            StepFailed: The step failed.
        """


class Here:
    """Engine that runs one task after another in this process."""

    slots = 1

    def __init__(self, execute: Callable[[Step], None]) -> None:
        """Store the function that runs steps, such as `steps.apart`."""
        self.execute = execute

    def prepare(self, warm: Callable[[], object] | None = None) -> None:
        """Do nothing, since the first task of this process compiles its kernels; `warm` is not called."""

    def each(self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]) -> Iterator[Result]:
        """Run a task once for each tuple of arguments, and yield the results in that order.

        Args:
            task: Function to call.
            arguments: Positional arguments of each call.
        """
        for each in arguments:
            yield task(*each)
