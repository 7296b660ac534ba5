"""Results of studies as Markdown, condition by condition beside the clean log of the same seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import polars as pl

from benchmarks.hidden_effects.scoring import rate
from benchmarks.imperfect_base.report import (
    NAMED,
    UNCHANGED,
    Column,
    answers,
    failures,
    reliability,
    share_of,
    spent,
    table,
)
from benchmarks.imperfect_base.scoring import Score, score
from benchmarks.imperfect_logs.study import CLEAN, CONDITIONS, SHARE

HIDDEN: Column = (
    "hidden effect named",
    share_of(lambda one: any(each.members & set(one.row["hidden"]) for each in one.named)),
)
BLIND: Column = ("nothing missing at a residual above 3", share_of(lambda one: one.blind))


def by_condition(those: Sequence[Score]) -> Iterator[tuple[str, list[Score]]]:
    """Studies of each condition, in the order of CONDITIONS."""
    for condition in CONDITIONS:
        group = [one for one in those if one.row["condition"] == condition]
        if group:
            yield condition, group


def pairs(those: Sequence[Score]) -> str:
    """What becomes of studies that are named first when clean."""
    sure = {one.row["seed"] for one in those if one.row["condition"] == CLEAN and one.outcome == "first"}
    lines = [
        "| of those named first when clean | named first | a tie holds it | wrong |",
        "|---|---:|---:|---:|",
    ]
    for condition, group in by_condition(those):
        kept = [one.outcome for one in group if one.row["seed"] in sure]
        if kept and condition != CLEAN:
            told = (rate(o == "first" for o in kept), rate(o == "tied" for o in kept))
            wrong = rate(o.startswith("wrong") for o in kept)
            lines.append(f"| {condition} | {' | '.join(told)} | {wrong} |")
    return "\n".join(lines)


def summary(results: pl.DataFrame) -> str:
    """Everything that a table of results says, as Markdown."""
    scored = [score(row) for row in results.to_dicts() if not row["failure"]]
    parts = [f"{results.height} studies; 95 % intervals after Clopper and Pearson."]
    hidden = [one for one in scored if one.row["kind"] == "one" and one.row["share"] >= SHARE]
    if hidden:
        parts += [
            f"### One effect hidden that makes at least {SHARE:.0%} of the error",
            table(by_condition(hidden), [*NAMED, HIDDEN, BLIND]),
            pairs(hidden),
            answers(hidden),
        ]
    nothing = [one for one in scored if one.row["kind"] == "none"]
    if nothing:
        parts += ["### Nothing hidden", table(by_condition(nothing), [*UNCHANGED, BLIND])]
        parts += [answers([one for one in nothing if not one.row["called"]])]
    if scored:
        parts += ["### Stated confidence", reliability(scored), "### What is left, and costs", spent(scored)]
    return "\n\n".join([*parts, *failures(results)]) + "\n"
