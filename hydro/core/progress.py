"""Progress of a long computation, reported to a callback."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Callback with a short description of the current step and the finished share of the work, 0 to 1."""


def silent(words: str, share: float) -> None:
    """Do nothing: the `Progress` of a caller that shows none."""


def part(progress: Progress, begin: float, end: float) -> Progress:
    """Return a callback that reports the progress of a part of the work as progress of the whole.

    Args:
        progress: Callback for the whole work.
        begin: Share of the whole at which the part begins, 0 to 1.
        end: Share of the whole at which the part ends, 0 to 1.
    """
    return lambda words, share: progress(words, begin + (end - begin) * share)
