"""Progress of a long computation, reported to a callback."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Callback with a short description of the current step and the finished share of the work, 0 to 1."""


def silent(words: str, share: float) -> None:
    """Ignore the progress."""


def part(progress: Progress, begin: float, end: float) -> Progress:
    """Return a callback for a part of the work that spans shares `begin` to `end` of the whole."""
    return lambda words, share: progress(words, begin + (end - begin) * share)
