"""Leaderboard: a line for each entry, from the answers of all cases that the entry has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.challenge.layout import Given
from benchmarks.challenge.make import CASES, opened, truths
from benchmarks.challenge.score import Score, scored, shares
from benchmarks.kept_tables import Row
from benchmarks.shares import rate

GIVEN = "file as given"
"""Name of the entry with whose errors the others are compared."""


def scores_of(folder: Path, entry: Path) -> list[Score]:
    """Return the scores of an entry, in the order of the cases that it answers."""
    found = []
    for name in truths(folder):
        if (entry / name / "answer.json").exists():
            truth, motion = opened(folder, name)
            found.append(scored(truth, motion, Given.read(entry / name)))
    return found


def board(folder: Path, entries: Sequence[Path], common: bool = False) -> list[Row]:
    """Return the lines of the leaderboard; most right first names first.

    Args:
        folder: Folder of the edition.
        entries: Folders of entries, each with a folder per case.
        common: Score only the cases that every entry answers.
    """
    found = {entry.name: scores_of(folder, entry) for entry in entries}
    if common:
        found = of_all(found)
    plain = {one.case: one.error for one in found.get(GIVEN, [])}
    lines = [(scores, line(name, scores, plain)) for name, scores in found.items() if scores]
    lines.sort(key=lambda one: (-sum(score.first is True for score in one[0]), one[1]["entry"]))
    return [row for _, row in lines]


def of_all(found: Mapping[str, Sequence[Score]]) -> dict[str, list[Score]]:
    """Return the scores of each entry in the cases that every entry answers."""
    shared = set.intersection(*({one.case for one in scores} for scores in found.values()))
    return {name: [one for one in scores if one.case in shared] for name, scores in found.items()}


def line(name: str, scores: Sequence[Score], plain: dict[str, float]) -> Row:
    """Return the line of one entry.

    Args:
        name: Name of the entry.
        scores: Scores of its answers.
        plain: Held-out error of the file as given, by case.
    """
    ratios = [one.error / plain[one.case] for one in scores if one.case in plain]
    briers = [one.brier for one in scores if one.brier is not None]
    times = [one.seconds for one in scores]
    return {
        "entry": name,
        "cases": f"{len(scores)} of {CASES}",
        **{words: rate(facts) for words, facts in shares(scores).items()},
        "held-out error over the file's": _quartiles(ratios),
        "Brier score": f"{np.mean(briers):.3f} ({len(briers)})" if briers else "-",
        "processor time [s]": f"{np.median(times):.1f}",
        "core-hours": f"{sum(times) / 3600.0:.3f}",
    }


def _quartiles(values: Sequence[float]) -> str:
    """Return a median and its quartiles in words."""
    if not values:
        return "-"
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"
