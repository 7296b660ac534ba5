"""Results of many studies as Markdown: what is right, how often, and how sure that is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np
import polars as pl

from benchmarks.hidden_effects.scoring import BINS, STRATA, Score, rate, score

TITLES = {
    "one": "One effect hidden",
    "two": "Two effects hidden",
    "three": "Three effects hidden",
    "form": "Effects in another form than the catalogue's",
    "unknown": "Effects that the catalogue does not have",
    "none": "Nothing hidden",
    "later": "One effect hidden, of those that came later",
}
FAILURES = 10  # texts shown


def summary(table: pl.DataFrame) -> str:
    """Everything that a table of results says, as Markdown."""
    rows = table.to_dicts()
    scored = [score(row) for row in rows if not row["failure"]]
    parts = [f"{len(rows)} studies of {_lengths(table)} s; 95 % intervals after Clopper and Pearson."]
    for kind, title in TITLES.items():
        those = [one for one in scored if one.row["kind"] == kind]
        if those:
            parts += [f"### {title}", *_SECTIONS[kind](those)]
    parts += ["### First answers", _answers(scored)]
    parts += ["### Stated confidence", _calibration(scored)]
    parts += ["### Time", _timing(scored)]
    if failed := [row for row in rows if row["failure"]]:
        texts = [
            f"- {r['kind']} {r['seed']}, {r['preset']}, {r['title']}: {r['failure']}"
            for r in failed[:FAILURES]
        ]
        parts += [f"### Failed: {len(failed)} of {len(rows)}", "\n".join(texts)]
    return "\n\n".join(parts) + "\n"


Column = tuple[str, Callable[[Sequence[Score]], str]]


def _size(those: Sequence[Score]) -> str:
    sizes = [len(one.named[0].members) for one in those if one.named]
    return f"{np.mean(sizes):.2f}" if sizes else "-"


TOP: Column = ("top-1", lambda those: rate(one.top for one in those))
COVERED: Column = ("tie set holds it", lambda those: rate(one.covered for one in those))
SIZE: Column = ("size of tie set", _size)
EXACT: Column = ("exact set", lambda those: rate(one.exact for one in those))
TIED: Column = ("exact within ties", lambda those: rate(one.tied for one in those))
WITHIN: Column = (
    "error near the oracle's",
    lambda those: rate(one.within for one in those if one.within is not None),
)
SILENT: Column = ("nothing said", lambda those: rate(not one.alarm for one in those))
CALLED: Column = ("called unknown", lambda those: rate(one.unknown for one in those))
EITHER: Column = ("top-1 or called unknown", lambda those: rate(one.top or one.unknown for one in those))
ALARMS: Column = ("false alarms", lambda those: rate(one.alarm for one in those))


def _groups(those: Sequence[Score]) -> Iterator[tuple[str, list[Score]]]:
    """All, and the same by strength, simulator, vehicle and noise."""
    yield "all", list(those)
    for _, words in STRATA:
        yield f"share of error {words}", [one for one in those if one.stratum == words]
    for key, words in (("source", "data of {}"), ("preset", "{}"), ("noise", "noise x{:g}")):
        for value in sorted({one.row[key] for one in those}):
            yield words.format(value), [one for one in those if one.row[key] == value]


def _table(those: Sequence[Score], columns: Sequence[Column], *, strata: bool = True) -> str:
    """One line per group that has any studies."""
    lines = [
        "| studies | " + " | ".join(name for name, _ in columns) + " |",
        "|---|" + "---:|" * len(columns),
    ]
    for words, group in _groups(those):
        if group and (strata or not words.startswith("share of error")):
            lines.append(f"| {words} | " + " | ".join(say(group) for _, say in columns) + " |")
    return "\n".join(lines)


def _one(those: Sequence[Score]) -> list[str]:
    found = _table(those, [TOP, COVERED, SIZE, EXACT, SILENT, CALLED, WITHIN])
    return [found, _by_title(those, [TOP, COVERED, SIZE, WITHIN]), _errors(those)]


def _several(those: Sequence[Score]) -> list[str]:
    strength = "The share of error is that of the weakest of them."
    return [strength, _table(those, [TOP, EXACT, TIED, CALLED, WITHIN]), _errors(those)]


def _form(those: Sequence[Score]) -> list[str]:
    return [_table(those, [TOP, COVERED, EITHER, SILENT]), _by_title(those, [TOP, COVERED, EITHER, SILENT])]


def _unknown(those: Sequence[Score]) -> list[str]:
    beyond = [one for one in those if one.row["chi2_own"] >= 1.1]
    note = "Where a tenth of the noise or more remains once the file's own effects are fitted anew: "
    columns = [CALLED, SILENT, ("something named", lambda group: rate(bool(one.named) for one in group))]
    return [
        _table(those, columns),
        _by_title(those, columns),
        f"{note}called unknown {rate(one.unknown for one in beyond)}.",
    ]


def _none(those: Sequence[Score]) -> list[str]:
    return [_table(those, [ALARMS], strata=False)]


_SECTIONS = {
    "one": _one,
    "two": _several,
    "three": _several,
    "form": _form,
    "unknown": _unknown,
    "none": _none,
    "later": _one,
}


def _by_title(those: Sequence[Score], columns: Sequence[Column]) -> str:
    """One line per thing hidden."""
    lines = [
        "| hidden | studies | " + " | ".join(name for name, _ in columns) + " |",
        "|---|---:|" + "---:|" * len(columns),
    ]
    for title in dict.fromkeys(sorted(one.row["title"] for one in those)):
        group = [one for one in those if one.row["title"] == title]
        lines.append(f"| {title} | {len(group)} | " + " | ".join(say(group) for _, say in columns) + " |")
    return "\n".join(lines)


def _errors(those: Sequence[Score]) -> str:
    """How the held-out error after adding compares to the oracle's."""
    pairs = [
        (one.row["after"], one.row["oracle"], one.row["before"]) for one in those if one.within is not None
    ]
    if not pairs:
        return "No oracle was fitted."
    after, best, before = np.array(pairs).T
    ratio, gain = np.percentile(after / best, [50, 90, 100]), np.percentile(before / best, [50, 90])
    return (
        f"Held-out error after adding over the oracle's: median {ratio[0]:.3f}, 90 % below {ratio[1]:.3f}, "
        f"greatest {ratio[2]:.3g}; before adding: median {gain[0]:.3g}, 90 % below {gain[1]:.3g}."
    )


def _answers(scored: Sequence[Score]) -> str:
    """The confusion matrix, line by line: what was hidden and what was answered first, most often first."""
    lines = ["| hidden | studies | first answer, times |", "|---|---:|---|"]
    for hidden, counts in confusion(scored).items():
        told = ", ".join(
            f"**{answer}** {n}" if answer == hidden else f"{answer} {n}" for answer, n in counts.most_common()
        )
        lines.append(f"| {hidden} | {counts.total()} | {told} |")
    return "\n".join(lines)


def confusion(scored: Sequence[Score]) -> dict[str, Counter[str]]:
    """How often each first answer was given to each thing hidden; studies that hide several left out."""
    out: dict[str, Counter[str]] = {}
    single = [one for one in scored if one.row["kind"] not in ("two", "three")]
    for one in sorted(single, key=lambda one: (list(TITLES).index(one.row["kind"]), one.row["title"])):
        out.setdefault(one.row["title"] or "nothing", Counter())[one.answer] += 1
    return out


def _calibration(scored: Sequence[Score]) -> str:
    """Right namings among those of like confidence."""
    told = [
        (named.confidence, named.effect in one.truth)
        for one in scored
        if one.row["kind"] not in ("unknown", "form")
        for named in one.named
        if named.confidence is not None
    ]
    lines = ["| stated confidence | namings | mean stated | right |", "|---|---:|---:|---:|"]
    for low, high in pairwise(BINS):
        inside = [(c, right) for c, right in told if low <= c < high or c == high == 1.0]
        if inside:
            mean = np.mean([c for c, _ in inside])
            lines.append(
                f"| {100 * low:g} to {100 * high:g} % | {len(inside)} | {100 * mean:.1f} % | "
                f"{rate(right for _, right in inside)} |"
            )
    return "\n".join(lines)


def _timing(scored: Sequence[Score]) -> str:
    if not scored:
        return "No study has ended."
    lines = ["| a diagnosis | median | 90 % below | longest |", "|---|---:|---:|---:|"]
    for key, words in (("wall", "wall time, s"), ("cpu", "processor time, s")):
        half, most, longest = np.percentile([one.row[key] for one in scored], [50, 90, 100])
        lines.append(f"| {words} | {half:.1f} | {most:.1f} | {longest:.1f} |")
    return "\n".join(lines)


def _lengths(table: pl.DataFrame) -> str:
    return " and ".join(f"{seconds:g}" for seconds in sorted(set(table["seconds"])))
