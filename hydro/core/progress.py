"""Progress of a long computation, reported to a callback."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Callback with a short description of the current step and the finished share of the work, 0 to 1."""


def silent(words: str, share: float) -> None:
    """Do nothing: the default callback, which shows no progress.

    Args:
        words: Present step of the work.
        share: Part of the work that is done, 0 to 1.
    """


def part(progress: Progress, begin: float, end: float) -> Progress:
    """Return a callback for one part of a work, which reports to the callback `progress` of the whole work.

    Args:
        progress: Callback for the whole work.
        begin: Fraction of the whole work, 0 to 1, that is done when the part begins.
        end: Fraction of the whole work that is done when the part ends.
    """
    return lambda words, share: progress(words, begin + (end - begin) * share)
