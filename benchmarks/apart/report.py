"""Results as Markdown: how often what is changed is named, with intervals, and a line for every case."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl
from scipy.stats import binomtest

from benchmarks.apart.judgement import FAULT, OF_CHANGES, OF_NOTHING, TIE, Judged, Outcome, Said, judge

WORDS = {
    Outcome.RIGHT: "right",
    Outcome.ALIAS: "right by alias",
    Outcome.STATED: "wrong, stated at >= 0.9",
    Outcome.SUSPECTED: "wrong, only suspected",
    Outcome.MISSED: "missed",
    Outcome.QUIET: "unchanged: nothing named",
    Outcome.HINT: "unchanged: only suspected",
    Outcome.ALARM: "unchanged: alarm at >= 0.9",
}


def share(hits: int, count: int) -> str:
    """A share with its 95 % interval after Wilson (1927): `3 of 4 | 75 % [30, 95]`."""
    if not count:
        return "0 of 0 | -"
    found = binomtest(hits, count).proportion_ci(0.95, method="wilson")
    return f"{hits} of {count} | {100 * hits / count:.0f} % [{100 * found.low:.0f}, {100 * found.high:.0f}]"


def counts(judged: Sequence[Judged]) -> str:
    """How often each outcome comes, among changes and among unchanged vehicles."""
    whole = [one for one in judged if one.outcome != Outcome.FAILED]
    lines = ["| outcome | cases | share [95 %] |", "|---|---:|---:|"]
    for outcomes in (OF_CHANGES, OF_NOTHING):
        those = [one.outcome for one in whole if one.outcome in outcomes]
        lines += [f"| {WORDS[each]} | {share(those.count(each), len(those))} |" for each in outcomes]
    right = [one for one in whole if one.outcome == Outcome.RIGHT]
    stated = sum(_states(one) for one in right)
    lines.append(f"| of those right, stated at >= 0.9 | {share(stated, len(right))} |")
    return "\n".join(lines)


def _states(judged: Judged) -> bool:
    """Whether anything is stated."""
    return any(one.sure for one in judged.said)


def words(said: Said) -> str:
    """A finding in a few words: `missing thruster_gain 1.00`."""
    if said.verdict == FAULT:
        return f"{FAULT} {'/'.join(sorted(said.columns))}"
    name = f"{TIE} {'/'.join(said.names)}" if said.verdict == TIE else f"{said.verdict} {said.names[0]}"
    return name if said.confidence is None else f"{name} {said.confidence:.2f}"


def line(judged: Judged) -> str:
    """A case in one line: vehicle, file, share of the error, outcome, and what is named."""
    row = judged.row
    file = "fitted" if row["fitted"] else "stated"
    head = f"{row['name']} ({row['vehicle']}, {file} file, {row['share']:.0%}): {judged.outcome}"
    if judged.outcome == Outcome.FAILED:
        return f"{head}: {row['failure']}"
    left = "" if row["chi2_end"] is None else f"; residual {row['chi2_end']:.3g}"
    return f"{head}: {', '.join(map(words, judged.said)) or '-'}{left}"


def section(title: str, judged: Sequence[Judged]) -> list[str]:
    """Counts and lines of one way to ask."""
    failed = sum(one.outcome == Outcome.FAILED for one in judged)
    seconds = sorted(one.row["wall"] for one in judged)
    about = f"{len(judged)} cases, {failed} failed; median {seconds[len(seconds) // 2]:.0f} s each."
    return [f"### {title}", about, counts(judged), "\n".join(f"- {line(one)}" for one in judged)]


def summary(results: pl.DataFrame) -> str:
    """Everything that a table of results says, as Markdown, those with a recording before apart."""
    judged = [judge(row) for row in results.sort("seed", "name").to_dicts()]
    seeds = ", ".join(map(str, sorted({one.row["seed"] for one in judged})))
    parts = [f"Seeds {seeds}; 95 % intervals after Wilson."]
    for with_before, title in ((True, "With the recording before"), (False, "Without")):
        those = [one for one in judged if one.row["with_before"] == with_before]
        if those:
            parts += section(title, those)
    return "\n\n".join(parts) + "\n"
