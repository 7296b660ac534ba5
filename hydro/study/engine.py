"""Where the tasks of a command run: one after another in this process, or on a cluster (`study.cluster`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol, TypeVar

from hydro.study.steps import Step

Result = TypeVar("Result")


class Engine(Protocol):
    """Runs tasks; no result depends on where.

    Attributes:
        slots: Tasks that run at a time.
    """

    slots: int

    def prepare(self, warm: Callable[[], object] | None = None) -> None:
        """See that every node can work, and let it do once what comes first, such as compiling kernels."""

    def each(self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]) -> Iterator[Result]:
        """Results of a task with each of the arguments, in their order.

        Args:
            task: A function of a module: nodes know it by its name.
            arguments: Of each call.
        """

    def execute(self, step: Step) -> None:
        """Run a step of a study.

        Raises:
            StepFailed: It failed.
        """


class Here:
    """This process, one task after another."""

    slots = 1

    def __init__(self, execute: Callable[[Step], None]) -> None:
        """Run steps by a function such as `steps.apart`."""
        self.execute = execute

    def prepare(self, warm: Callable[[], object] | None = None) -> None:
        """Nothing: this process has compiled its kernels after its first task."""

    def each(self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]) -> Iterator[Result]:
        """See `Engine.each`."""
        for each in arguments:
            yield task(*each)
