"""A diagnosis in lines that an engineer reads."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import polars as pl

EXPLAINS = {
    "log_fault": "fault in the log: {columns}",
    "missing": "missing: {effect}, {share} of the unexplained error",
    "suspect": "suspected: {effect}, {share} of the unexplained error",
    "retune": "other values: {effect}, {share} of the error of the file as given",
    "cannot_tell_apart": "one of {members}: {share} of the unexplained error",
    "not_separable": "told by no recording: {effect}",
    "not_excited": "not shown by this recording: {effect}",
    "none_of_the_known": "none of the known effects: {share} of the unexplained error remains",
    "far_from_noise": "far from the noise, and no effect earns it: {share} of the unexplained error remains",
    "closed_loop": "recorded under feedback",
    "nothing_missing": "nothing is missing",
}


def lines(frame: pl.DataFrame) -> Iterator[tuple[str, str]]:
    """A line and its advice for each finding; what the recording could not show, in one line together.

    Args:
        frame: Diagnosis table.
    """
    rows = frame.sort("rank")
    for row in rows.filter(pl.col("verdict") != "not_excited").iter_rows(named=True):
        yield _line(row), row["advice"]
    unseen = rows.filter(verdict="not_excited")["effect"].to_list()
    if unseen:
        yield (
            f"not shown by this recording: {', '.join(unseen)}",
            "this motion does not excite them; `hydro effects NAME` says which motion would",
        )


def _line(row: dict[str, Any]) -> str:
    """What is the matter, how much, how sure, and with which values."""
    told = EXPLAINS[row["verdict"]].format(
        effect=row["effect"],
        share=_percent(row["share_of_error_explained"], row["share_low"], row["share_high"]),
        members=" or ".join(row["members"]),
        columns=", ".join(row["members"]),
    )
    if row["confidence"] is not None:
        told += f", confidence {row['confidence']:.0%}"
    return f"{told}: {row['parameters']}" if row["parameters"] else told


def _percent(share: float | None, low: float | None, high: float | None) -> str:
    if share is None:
        return "part"
    if low is None or high is None:
        return f"{share:.0%}"
    return f"{share:.0%} ({low:.0%} to {high:.0%})"
