"""How far a long computation is: called with what is being done, and the share of the work that is behind."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Told what is being done, in a few words, and the share of the work that is behind, from 0 to 1."""


def silent(words: str, share: float) -> None:
    """Progress that nobody asked for."""


def part(progress: Progress, begin: float, end: float) -> Progress:
    """The progress of one part of the work, from one share of the whole to another."""
    return lambda words, share: progress(words, begin + (end - begin) * share)
