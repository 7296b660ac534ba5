"""Progress bar that moves between two reports of progress, with an estimate of the remaining time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.progress_bar import ProgressBar
from rich.table import Column
from rich.text import Text

from hydro.core.recording.extent import duration

BAR = 16
"""Width of the bar in columns, which leaves half of a terminal of 80 columns for text."""


@dataclass
class Remaining:
    """Estimate of the remaining time of a work, from an initial estimate and the fraction that is done.

    The duration is the weighted geometric mean of the initial estimate and of the time so far divided by the
    fraction done. The weight of the initial estimate is the square of the remaining fraction. Between two
    reports the time counts down; it grows if the next report is overdue.

    Attributes:
        expected: Approximate duration of all the work [s]; None if it is not known.
        now: Function that returns the time [s].
    """

    expected: float | None = None
    now: Callable[[], float] = time.monotonic
    begin: float = field(init=False)
    share: float = field(init=False, default=0.0)
    reported: float = field(init=False)

    def __post_init__(self) -> None:
        """Start the clock."""
        self.begin = self.reported = self.now()

    def update(self, share: float | None) -> None:
        """Set the fraction of the work that is done.

        0 after a larger fraction starts the next part of the work.

        Args:
            share: Fraction from 0 to 1; None for work of unknown length.
        """
        if share is None or share == 0.0 < self.share:
            self.expected = None if share is None else self.now() - self.begin
            self.begin = self.reported = self.now()
            self.share = 0.0
        elif share > self.share:
            self.share, self.reported = share, self.now()

    @property
    def elapsed(self) -> float:
        """Time since the work began [s]."""
        return self.now() - self.begin

    @property
    def seconds(self) -> float | None:
        """Remaining time [s]; None if it is not known yet."""
        left, spent = 1.0 - self.share, self.reported - self.begin
        if left <= 0.0:
            return None
        if self.share > 0.0 and spent > 0.0:
            pace, weight = spent / self.share, 0.0 if self.expected is None else left**2
            total: float = pace ** (1.0 - weight) * max(self.expected or pace, spent) ** weight
        elif self.expected is not None:
            total = self.expected
        else:
            return None
        since = self.now() - self.reported
        return max(total - spent - since, left * since)

    @property
    def done(self) -> float:
        """Fraction of the expected total time that has passed, from 0 to 1."""
        seconds = self.seconds
        return 0.0 if seconds is None else self.elapsed / max(self.elapsed + seconds, 1e-9)


class _Bar(BarColumn):
    """Bar that moves between two reports, and never backward within one part of the work."""

    def __init__(self, remaining: Remaining) -> None:
        super().__init__()
        self.remaining, self.most, self.begin = remaining, 0.0, remaining.begin

    def render(self, task: Task) -> ProgressBar:
        """Return the progress bar of the column, for the library rich."""
        if self.begin != self.remaining.begin:
            self.most, self.begin = 0.0, self.remaining.begin
        self.most = max(self.most, self.remaining.done)
        known = self.remaining.seconds is not None
        return ProgressBar(total=1.0 if known else None, completed=self.most, width=BAR, pulse=not known)


class _Left(ProgressColumn):
    """Column with the elapsed and the remaining time."""

    def __init__(self, remaining: Remaining) -> None:
        super().__init__(Column(no_wrap=True))
        self.remaining = remaining

    def render(self, task: Task) -> Text:
        """Return text with the elapsed and the remaining time, for the library rich."""
        seconds = self.remaining.seconds
        left = "" if seconds is None else f", about {duration(max(seconds, 1.0))} left"
        return Text(f"{duration(self.remaining.elapsed)}{left}")


@contextmanager
def shown(label: str, expected: float | None) -> Iterator[Callable[..., None]]:
    """Show a progress bar on stderr during a `with` block.

    Args:
        label: Name of the work.
        expected: Approximate duration [s]; None if it is not known.

    Yields:
        `update(done, total, text)`, which sets the progress and a few words next to the bar.
    """
    remaining = Remaining(expected)
    columns = (
        TextColumn("{task.description}", table_column=Column(no_wrap=True)),
        _Bar(remaining),
        _Left(remaining),
        TextColumn("{task.fields[text]}", table_column=Column(no_wrap=True, overflow="ellipsis", ratio=1)),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True, expand=True) as bar:
        task = bar.add_task(label, total=None, text="")

        def update(done: float, total: float, text: str = "") -> None:
            remaining.update(done / total if total else None)
            bar.update(task, text=text)

        yield update
