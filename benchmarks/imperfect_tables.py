"""Kept tables of the benchmarks without an exact model: the diagnosis compared with its rivals.

The results come from `benchmarks.judge`, lists `panel-...` and `unchanged-...`, or `logs...`.  The
tables are benchmarks/results/imperfect_base.csv and imperfect_logs.csv.  Every name of a rival counts as a
statement.  The baseline is the file as given, which names nothing and lowers no error.

    python -m benchmarks.imperfect_tables base base.parquet --rivals rivals.parquet --commit 1234567
    python -m benchmarks.imperfect_tables logs logs.parquet --rivals rivals.parquet --commit 1234567
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import polars as pl

from benchmarks.imperfect_base.study import SHARE
from benchmarks.imperfect_logs.study import CLOSED, CONDITIONS, SPOILT
from benchmarks.judge import results
from benchmarks.judge.scores import Score, scored
from benchmarks.kept_tables import Row, keep, origin
from benchmarks.rivals.contest import BASE, SCHEMA
from benchmarks.shares import rate

SPENT = 3.0
"""Reduced chi-square above which `nothing_missing` counts as an error."""


def told(studies: Sequence[Score]) -> dict[str, str]:
    """Return the table's cells for the diagnosis, from studies with and without a hidden effect."""
    hidden, nothing = _parted(studies)
    return {
        "named first": rate(one.first for one in hidden),
        "in a tie": rate(_tied(one) for one in hidden),
        "nothing named": rate(not one.named for one in hidden),
        "stated, of all": rate(_stated(one) for one in hidden),
        "stated wrongly": rate(one.wrong for one in (*hidden, *nothing)),
        "alarm, nothing hidden": rate(one.wrong for one in nothing),
        "`nothing_missing` above 3": rate(_blind(one) for one in studies),
        "error after / before": _ratio(one.row for one in hidden),
        "cpu, s": _median(one.row["cpu"] for one in studies),
        "studies": f"{len(hidden)} + {len(nothing)}, {sum(map(_stated, (*hidden, *nothing)))} stated",
    }


def _parted(studies: Sequence[Score]) -> tuple[list[Score], list[Score]]:
    """Return studies whose hidden effect causes at least SHARE of the error, and studies without one.

    A log condition that adds an effect itself, such as a current, does not count.
    """
    hidden = [one for one in studies if one.row["title"] and one.row["share"] >= SHARE]
    return hidden, [one for one in studies if not one.row["title"]]


def _tied(one: Score) -> bool:
    """Return whether the first name is a tie that includes the true effect."""
    return one.answer is not None and one.answer.tie and one.answer.right is True


def _stated(one: Score) -> bool:
    """Return whether the first name is confirmed, right or wrong."""
    return one.answer is not None and one.answer.stated


def _blind(one: Score) -> bool:
    """Return whether the verdict is `nothing_missing` although the residual is above SPENT."""
    return "nothing_missing" in one.verdicts and one.row["chi2_end"] > SPENT


def rival(rows: Sequence[Row]) -> dict[str, str]:
    """Return the table's cells for one rival method, from the rows of its studies."""
    hidden = [row for row in rows if row["kind"] == "one" and row["share"] >= SHARE]
    nothing = [row for row in rows if row["kind"] == "none"]

    def wrong(row: Row) -> bool:
        return row["named"] not in ("", *row["called"], *row["misjudged"])

    return {
        "named first": rate(row["named"] in row["called"] for row in hidden),
        "nothing named": rate(not row["named"] for row in hidden),
        "stated, of all": rate(bool(row["named"]) for row in hidden),
        "stated wrongly": rate(wrong(row) for row in (*hidden, *nothing)),
        "alarm, nothing hidden": rate(map(wrong, nothing)),
        "error after / before": _ratio(hidden),
        "cpu, s": _median(row["cpu"] for row in rows),
        "studies": f"{len(hidden)} + {len(nothing)}",
    }


def _ratio(rows: Iterable[Row]) -> str:
    """Return the median ratio of held-out errors, after over before, and how often it exceeds 1."""
    ratios = np.array([row["after"] / row["before"] for row in rows if row["after"] is not None])
    return f"{np.median(ratios):.2f}, greater in {rate((ratios > 1.0).tolist())}" if ratios.size else ""


def _median(values: Iterable[float]) -> str:
    """Return the median as a whole number; empty without values."""
    those = list(values)
    return f"{np.median(those):.0f}" if those else ""


def base(studies: Sequence[Score], others: pl.DataFrame) -> Iterator[Row]:
    """Yield the diagnosis, its rivals, the true change as a bound, and the baseline."""
    for words, ending in (("", "-plain"), (" --before", "-before")):
        those = [one for one in studies if one.row["list"].endswith(ending)]
        if those:
            yield {"by": f"`hydro diagnose{words}`", **told(those)}
    yield from _rivals(others.filter(condition=BASE))
    hidden, _ = _parted(studies)
    best = [one.row | {"after": one.row["with_truth"]} for one in hidden]
    if best:
        yield {"by": "the true change, added (bound)", "error after / before": _ratio(best)}
    yield as_given(studies)


def as_given(studies: Sequence[Score]) -> Row:
    """Return the baseline: the file itself, which names nothing."""
    hidden, nothing = _parted(studies)
    silent = {
        "nothing named": rate(True for _ in hidden),
        "alarm, nothing hidden": rate(False for _ in nothing),
    }
    return {"by": "the file as given (baseline)", **silent, "error after / before": "1.00"}


def logs(studies: Sequence[Score], others: pl.DataFrame) -> Iterator[Row]:
    """Yield the diagnosis and its rivals under each condition, then groups of conditions."""
    for condition in CONDITIONS:
        those = [one for one in studies if one.row["condition"] == condition]
        if those:
            yield {"log": condition, "by": "`hydro diagnose`", **told(those)}
        for row in _rivals(others.filter(condition=condition)):
            yield {"log": condition, **row}
    for name, part in (("sensors, all together", tuple(SPOILT)), ("controllers, all together", CLOSED)):
        those = [one for one in studies if one.row["condition"] in part]
        yield {"log": name, "by": "`hydro diagnose`", **told(those)}
    yield {"log": "all", **as_given(studies)}


def _rivals(others: pl.DataFrame) -> Iterator[Row]:
    """Yield the table's cells for each rival method."""
    for (name,), part in others.filter(failure="").group_by("rival", maintain_order=True):
        yield {"by": name, **rival(part.to_dicts())}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("which", choices=("base", "logs"))
    parser.add_argument("results", type=Path)
    parser.add_argument("--rivals", type=Path, help="results of rivals on the same studies")
    parser.add_argument("--commit", required=True, help="commit of the measured code")
    parser.add_argument("--rivals-commit", help="commit with which the rivals ran; default: --commit")
    chosen = parser.parse_args()
    table = results.read([chosen.results])
    others = pl.DataFrame(schema=SCHEMA) if chosen.rivals is None else pl.read_parquet(chosen.rivals)
    studies = [one for one in scored(table) if not one.failed]
    rows = list({"base": base, "logs": logs}[chosen.which](studies, others))
    whence = origin(table, results.made_by(table), chosen.commit)
    beside = whence | {
        "seeds": f"{others['seed'].min()} to {others['seed'].max()}",
        "commit": chosen.rivals_commit or chosen.commit,
    }
    rivals = set(others["rival"])
    keep(f"imperfect_{chosen.which}", [row | (beside if row["by"] in rivals else whence) for row in rows])


if __name__ == "__main__":
    main()
