"""Tables of the scoreboard: one line per list of studies, and paired differences from earlier results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from scipy.stats import norm, t

from benchmarks.judge.scores import WITHIN, Score, finite
from benchmarks.kept_tables import markdown
from benchmarks.shares import interval

LEVEL = 0.90
"""Level of the intervals of paired differences.  A change of the engine is merged where the lower
end for names is above -3 points."""
ALL = "all"

Fact = Callable[[Score], bool | None]
SHARES: Mapping[str, Fact] = {
    "named first": lambda one: one.first if one.changed else None,
    "exactly": lambda one: one.exact if one.changed else None,
    "stated right": lambda one: one.stated if one.changed else None,
    "with a wrong statement": lambda one: one.wrong,
    "alarm": lambda one: None if one.changed or one.outside else one.alarm,
    "called unknown": lambda one: one.unexplained if one.outside else None,
    "adding helps": lambda one: one.helped,
}
"""Shares of studies by their name; None leaves a study out."""
Number = Callable[[Score], float | None]
NUMBERS: Mapping[str, Number] = {
    "Brier score": lambda one: one.brier,
    "held-out error after over before": lambda one: one.ratio,
    "processor time [s]": lambda one: one.row["cpu"],
}
"""Numbers of a study by their name; None leaves a study out."""


def scoreboard(scored: Sequence[Score]) -> str:
    """Return the scoreboard as Markdown, with a line on statements and one for each study that failed."""
    fine = [one for one in scored if not one.failed]
    statements, wrong = sum(one.statements for one in fine), sum(one.wrong for one in fine)
    text = [
        markdown(table(scored)),
        "",
        f"Statements at 0.9 or more: {statements}; studies with a wrong one: {wrong} of {len(fine)}.",
    ]
    text += [f"Failed: {one.key}: {one.row['failure']}" for one in scored if one.failed]
    return "\n".join(text) + "\n"


def table(scored: Sequence[Score]) -> list[dict[str, str]]:
    """Return the rows of the scoreboard, one for all studies and one for each list.

    The cells are shares with 95 % intervals, values, errors and processor time; studies that failed are left
    out, and so are columns without any value.
    """
    rows = []
    for name, those in groups([one for one in scored if not one.failed]):
        cells = {"list": name, "studies": str(len(those))}
        cells |= {words: _share(those, fact) for words, fact in SHARES.items()}
        cells |= {words: _median(those, number) for words, number in NUMBERS.items()}
        cells |= {
            words: _within([off for one in those for off in getattr(one, part)])
            for words, part in (("affected values within 2 s.e.", "off"), ("unaffected", "unaffected"))
        }
        cells["core-hours"] = f"{sum(one.row['study_cpu'] for one in those) / 3600.0:.2f}"
        rows.append(cells)
    filled = [column for column in rows[0] if any(row[column] for row in rows)]
    return [{column: row[column] for column in filled} for row in rows]


def confusions(scored: Sequence[Score]) -> str:
    """Return the first names for each truth as Markdown, most frequent first and right answers bold.

    Studies that hide several effects are left out.
    """
    titles: dict[str, list[Score]] = {}
    for one in scored:
        if not one.failed and " + " not in (one.row["title"] or ""):
            titles.setdefault(one.row["title"] or "nothing", []).append(one)
    rows = []
    for title, those in sorted(titles.items()):
        counts = Counter(map(_answer, those)).most_common()
        told = ", ".join(f"{answer} {count}" for answer, count in counts)
        rows.append({"hidden": title, "studies": len(those), "first answer, times": told})
    return markdown(rows) + "\n"


def _answer(one: Score) -> str:
    """Return the first answer of a study in words; bold where it is right."""
    if one.answer is None:
        words = "none of the known" if one.unexplained else "nothing"
        right = not one.changed and one.unexplained == one.outside
    else:
        words, right = "/".join(sorted(one.answer.members)), one.first
    return f"**{words}**" if right else words


def paired(base: Sequence[Score], now: Sequence[Score], one: str, other: str) -> str:
    """Return paired differences as Markdown, over all studies that both results have, and by list.

    Args:
        base: Scores to compare with.
        now: Scores to judge.
        one: Description of the first scores.
        other: Description of the second scores.
    """
    earlier = {each.key: each for each in base if not each.failed}
    pairs = [(earlier[each.key], each) for each in now if each.key in earlier and not each.failed]
    lines = [
        f"{len(pairs)} pairs: {other} minus {one}, with {LEVEL:.0%} intervals.",
        "",
        "| list | measure | pairs | before | after | difference | interval |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    names = [ALL, *dict.fromkeys(each.row["list"] for _, each in pairs)]
    for name in names if pairs else ():
        those = [pair for pair in pairs if name in (ALL, pair[1].row["list"])]
        lines += [f"| {name} | {' | '.join(cells)} |" for cells in _differences(those)]
    return "\n".join(lines) + "\n"


def _differences(pairs: Sequence[tuple[Score, Score]]) -> Iterator[tuple[str, ...]]:
    """Yield the cells of each measure that at least two pairs have."""
    for name, fact in SHARES.items():
        told = np.array(
            [[a, b] for a, b in ((fact(x), fact(y)) for x, y in pairs) if None not in (a, b)], float
        )
        if len(told) > 1:
            before, after = told.mean(axis=0)
            low, high = of_shares(told[:, 0], told[:, 1])
            yield (
                name,
                str(len(told)),
                f"{before:.1%}",
                f"{after:.1%}",
                f"{100 * (after - before):+.1f}",
                f"{100 * low:+.1f} to {100 * high:+.1f} points",
            )
    for name, number in NUMBERS.items():
        told = np.array(
            [[a, b] for a, b in ((number(x), number(y)) for x, y in pairs) if None not in (a, b)], float
        )
        if len(told) > 1:
            before, after = told.mean(axis=0)
            low, high = of_means(told[:, 1] - told[:, 0])
            cells = (f"{value:.3g}" for value in (before, after))
            yield name, str(len(told)), *cells, f"{after - before:+.3g}", f"{low:+.2g} to {high:+.2g}"
    for name in ("off", "unaffected"):
        sides = [[off for pair in pairs for off in getattr(pair[side], name)] for side in (0, 1)]
        if all(sides):
            shares = [float(np.mean(np.abs(side) <= WITHIN)) for side in sides]
            words = "affected" if name == "off" else "unaffected"
            count = "/".join(str(len(side)) for side in sides)
            cells = (f"{share:.1%}" for share in shares)
            yield f"{words} values within 2 s.e.", count, *cells, f"{100 * (shares[1] - shares[0]):+.1f}", ""


def of_shares(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Return the interval of a difference of paired shares (Agresti and Min 2005).

    Half a pair is added to each cell of the table of pairs, so that equal pairs do not mean certainty.

    Args:
        before: Outcomes of each study before (N,), 0 or 1.
        after: Outcomes of each study after (N,), 0 or 1.
    """
    gained, lost = float((after > before).sum()) + 0.5, float((before > after).sum()) + 0.5
    count = len(before) + 2.0
    middle = (gained - lost) / count
    spread = np.sqrt(max(gained + lost - (gained - lost) ** 2 / count, 0.0)) / count
    reach = float(norm.ppf(0.5 + LEVEL / 2.0) * spread)
    return max(middle - reach, -1.0), min(middle + reach, 1.0)


def of_means(differences: np.ndarray) -> tuple[float, float]:
    """Return Student's interval of a mean difference."""
    count = len(differences)
    reach = t.ppf(0.5 + LEVEL / 2.0, count - 1) * differences.std(ddof=1) / np.sqrt(count)
    return float(differences.mean() - reach), float(differences.mean() + reach)


def groups(scored: Sequence[Score]) -> Iterator[tuple[str, list[Score]]]:
    """Yield all scores, then those of each list."""
    yield ALL, list(scored)
    for name in dict.fromkeys(one.row["list"] for one in scored):
        yield name, [one for one in scored if one.row["list"] == name]


def line(one: Score) -> str:
    """Return a study in one line, for progress."""
    row = one.row
    head = f"{row['list']} {row['seed']} {row['preset'] or ''} {row['title'] or 'nothing'}"
    if one.failed:
        return f"{head}: failed, {row['failure']}"
    said = ", ".join(f"{'/'.join(sorted(each.members))} {each.confidence:.2f}" for each in one.named)
    verdict = "right" if one.first or (one.exact and not one.changed) else "not right"
    return f"{head}: {verdict}; {said or 'nothing'} ({row['cpu']:.0f} s)"


def _share(those: Sequence[Score], fact: Fact) -> str:
    """Return the share of scores for which a fact holds, with its 95 % interval, as text.

    Scores for which the fact is None do not count.
    """
    told = [value for value in map(fact, those) if value is not None]
    if not told:
        return ""
    low, high = interval(sum(told), len(told))
    return f"{sum(told)} of {len(told)}, {np.mean(told):.0%} ({low:.0%} to {high:.0%})"


def _median(those: Sequence[Score], number: Number) -> str:
    """Return the median of a number, or the mean of a Brier score."""
    told = finite([number(one) for one in those])
    if not told.size:
        return ""
    return f"{told.mean():.3f}" if number is NUMBERS["Brier score"] else f"{np.median(told):.3g}"


def _within(off: Sequence[float]) -> str:
    """Return the share of values within WITHIN standard errors of the truth, as text."""
    if not off:
        return ""
    return f"{np.mean(np.abs(off) <= WITHIN):.0%} of {len(off)}"
