"""The confusion matrix as a heat map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.hidden_effects.report import confusion
from benchmarks.hidden_effects.scoring import NOTHING, UNKNOWN, Score


def confusions(scored: Sequence[Score], path: Path) -> None:
    """Draw shares of first answers (columns) by what was hidden (rows), right ones framed."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    counts = confusion(scored)
    hidden = list(counts)
    answers = sorted({a for row in counts.values() for a in row} | {NOTHING, UNKNOWN}, key=_order(hidden))
    shares = np.array([[row[a] / row.total() for a in answers] for row in counts.values()])
    figure = Figure(
        figsize=(2.8 + 0.3 * len(answers), 2.2 + 0.27 * len(hidden)), dpi=150, layout="constrained"
    )
    axes = figure.add_subplot()
    axes.imshow(np.where(shares > 0.0, shares, np.nan), cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    right = {(one.row["title"] or NOTHING, _right(one)) for one in scored}
    for i, title in enumerate(hidden):
        for j, answer in enumerate(answers):
            if (title, answer) in right:
                axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, fill=False, edgecolor="#D55E00", lw=1.2))
            if shares[i, j] > 0.0:
                colour = "white" if shares[i, j] > 0.6 else "#333333"
                text = f"{100 * shares[i, j]:.0f}"
                axes.text(j, i, text, ha="center", va="center", fontsize=6.5, color=colour)
    axes.set_xticks(range(len(answers)), answers, rotation=60, ha="left", fontsize=7)
    axes.xaxis.tick_top()
    axes.set_yticks(range(len(hidden)), [f"{t} ({counts[t].total()})" for t in hidden], fontsize=7)
    axes.set_title("First answers, % of studies; right ones framed", loc="left", fontsize=9)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Software": ""} if path.suffix == ".png" else None)


def _right(one: Score) -> str:
    """The answer that a study with one thing hidden, or nothing, should get."""
    if one.row["kind"] == "none":
        return NOTHING
    return next(iter(sorted(one.truth)), UNKNOWN)


def _order(hidden: Sequence[str]) -> Callable[[str], tuple[int, int, str]]:
    """Answers in the order of what was hidden, the two that name no effect last."""

    def key(answer: str) -> tuple[int, int, str]:
        last = {NOTHING: 2, UNKNOWN: 1}.get(answer, 0)
        return last, hidden.index(answer) if answer in hidden else len(hidden), answer

    return key
