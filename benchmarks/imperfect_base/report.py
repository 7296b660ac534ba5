"""Results of studies as Markdown: what is named, how often and how surely, and what it is worth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import polars as pl

from benchmarks.hidden_effects.scoring import rate
from benchmarks.imperfect_base.scoring import SPENT, SURE, Score, bins, brier, namings, score
from benchmarks.imperfect_base.study import SHARE, STANDS_OUT

Column = tuple[str, Callable[[Sequence[Score]], str]]


def share_of(property_: Callable[[Score], bool]) -> Callable[[Sequence[Score]], str]:
    """A column that says how often something is so."""
    return lambda those: rate(property_(one) for one in those)


NAMED: tuple[Column, ...] = (
    ("named first", share_of(lambda one: one.outcome == "first")),
    ("a tie holds it", share_of(lambda one: one.outcome == "tied")),
    ("nothing named", share_of(lambda one: one.outcome == "silent")),
    (f"first stated at {SURE:g}", share_of(lambda one: one.stated)),
    (f"wrong at {SURE:g}", share_of(lambda one: one.stated_wrongly)),
)
UNCHANGED: tuple[Column, ...] = (
    ("alarm", share_of(lambda one: one.alarm)),
    ("anything named", share_of(lambda one: bool(one.named))),
    ("far from noise", share_of(lambda one: "far_from_noise" in one.row["verdicts"])),
)


def table(groups: Iterator[tuple[str, list[Score]]], columns: Sequence[Column]) -> str:
    """One line per group that has any studies."""
    lines = ["| studies | " + " | ".join(name for name, _ in columns) + " |"]
    lines.append("|---|" + "---:|" * len(columns))
    lines += [
        f"| {words} | " + " | ".join(say(group) for _, say in columns) + " |" for words, group in groups
    ]
    return "\n".join(lines)


def groups(those: Sequence[Score], *keys: str) -> Iterator[tuple[str, list[Score]]]:
    """All, and the same by the values of some columns."""
    yield "all", list(those)
    for key in keys:
        for value in sorted({one.row[key] for one in those}):
            yield str(value), [one for one in those if one.row[key] == value]


def reliability(scored: Sequence[Score]) -> str:
    """Stated confidence against truth in bins of equal count, and the Brier score."""
    confidence, right = namings(scored)
    if not confidence.size:
        return "Nothing was named with a confidence."
    lines = ["| stated confidence | namings | mean stated | right |", "|---|---:|---:|---:|"]
    for part in bins(confidence):
        low, mean, high = confidence[part].min(), confidence[part].mean(), confidence[part].max()
        lines.append(
            f"| {low:.2f} to {high:.2f} | {part.size} | {mean:.2f} | {rate(map(bool, right[part]))} |"
        )
    return "\n".join([*lines, "", f"Brier score {brier(confidence, right):.3f}."])


def answers(scored: Sequence[Score]) -> str:
    """What was named first for each truth, most often first."""
    lines = ["| truth | studies | first answer, times |", "|---|---:|---|"]
    for title, those in groups(scored, "title"):
        if title == "all":
            continue
        counts = Counter(" / ".join(sorted(one.named[0].members)) if one.named else "-" for one in those)
        told = ", ".join(f"{name} {n}" for name, n in counts.most_common())
        lines.append(f"| {title or 'nothing'} | {len(those)} | {told} |")
    return "\n".join(lines)


def errors(scored: Sequence[Score]) -> str:
    """Held-out error after adding against that of the oracle and of the file as given."""
    told = [
        [one.row[k] for k in ("before", "after", "oracle")]
        for one in scored
        if one.row["oracle"] is not None and one.row["after"] is not None
    ]
    if not told:
        return "No oracle was fitted."
    before, after, best = np.array(told).T
    half, most, longest = np.percentile(after / best, [50, 90, 100])
    return (
        f"Held-out error, 5 s ahead, over the oracle's: median {half:.3f}, 90 % below {most:.3f}, "
        f"greatest {longest:.3g}; greater than the given file's in {rate((after > before).tolist())}."
    )


def spent(scored: Sequence[Score]) -> str:
    """How often nothing was called missing far from the noise, and what diagnoses cost."""
    cpu = np.array([[one.row["cpu"], one.row["study_cpu"]] for one in scored])
    half, most = np.percentile(cpu, [50, 90], axis=0)
    return (
        f"`nothing_missing` at a mean squared residual above {SPENT:g}: {rate(one.blind for one in scored)}. "
        f"Processor time of a diagnosis: median {half[0]:.0f} s, 90 % below {most[0]:.0f} s; of a study "
        f"{half[1]:.0f} and {most[1]:.0f} s."
    )


def failures(results: pl.DataFrame) -> list[str]:
    """A section on what failed, where anything did."""
    failed = results.filter(pl.col("failure") != "").to_dicts()
    if not failed:
        return []
    lines = [
        f"- {row['kind']} {row['seed']}, {row['preset']}, {row['title']}: {row['failure']}" for row in failed
    ]
    return [f"### Failed: {len(failed)} of {results.height}", "\n".join(lines[:10])]


def summary(results: pl.DataFrame) -> str:
    """Everything that a table of results says, as Markdown."""
    scored = [score(row) for row in results.to_dicts() if not row["failure"]]
    parts = [f"{results.height} studies; 95 % intervals after Clopper and Pearson."]
    if scored:
        ratio = np.array([one.row["base_error"] / one.row["base_floor"] for one in scored])
        parts.append(
            f"The base error is {ratio.min():.1f} to {ratio.max():.1f} times what noise alone makes, median "
            f"{np.median(ratio):.1f}; {(ratio < STANDS_OUT).sum()} studies are below {STANDS_OUT:g}."
        )
    changed = [one for one in scored if one.row["kind"] == "changed"]
    strong = [one for one in changed if one.row["share"] >= SHARE]
    if strong:
        parts.append(f"### A change that makes at least {SHARE:.0%} of the error")
        parts.append(f"{len(changed) - len(strong)} studies whose change makes less are left out.")
        parts += [table(groups(strong, "preset", "title"), NAMED), errors(strong), answers(strong)]
    unchanged = [one for one in scored if one.row["kind"] == "nothing"]
    if unchanged:
        parts += ["### Nothing changed", table(groups(unchanged, "preset"), UNCHANGED), answers(unchanged)]
    if scored:
        parts += ["### Stated confidence", reliability(scored), "### What is left, and costs", spent(scored)]
    return "\n\n".join([*parts, *failures(results)]) + "\n"
