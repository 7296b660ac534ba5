"""Kept tables of the benchmarks where no model is exactly right, rivals beside the diagnosis.

    python -m benchmarks.imperfect_tables base base.parquet --rivals rivals.parquet --commit 1234567
    python -m benchmarks.imperfect_tables logs logs.parquet --rivals rivals.parquet --commit 1234567

They are benchmarks/results/imperfect_base.csv and imperfect_logs.csv.  A rival states whatever it names; the
file as given names nothing and lowers no error, which is the baseline.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import polars as pl

from benchmarks.hidden_effects.scoring import rate
from benchmarks.imperfect_base.scoring import Score, score
from benchmarks.imperfect_base.study import SHARE
from benchmarks.imperfect_logs.study import CLOSED, CONDITIONS, SPOILT
from benchmarks.kept_tables import Row, keep, origin
from benchmarks.rivals.contest import BASE, SCHEMA

HIDDEN, UNCHANGED = ("changed", "one"), ("nothing", "none")


def told(scored: Sequence[Score]) -> dict[str, str]:
    """What a diagnosis' answers are worth, of studies where something is hidden and of others."""
    hidden, nothing = _parted(scored)
    sure = [one for one in (*hidden, *nothing) if one.stated]
    return {
        "named first": rate(one.outcome == "first" for one in hidden),
        "in a tie": rate(one.outcome == "tied" for one in hidden),
        "nothing named": rate(one.outcome == "silent" for one in hidden),
        "stated, of all": rate(one.stated for one in hidden),
        "stated wrongly": rate(one.stated_wrongly for one in (*hidden, *nothing)),
        "alarm, nothing hidden": rate(one.alarm for one in nothing),
        "`nothing_missing` above 3": rate(one.blind for one in scored),
        "error after / before": _ratio(one.row for one in hidden),
        "cpu, s": _median(one.row["cpu"] for one in scored),
        "studies": f"{len(hidden)} + {len(nothing)}, {len(sure)} stated",
    }


def _parted(scored: Sequence[Score]) -> tuple[list[Score], list[Score]]:
    """Studies in which what is hidden makes its share of the error, and studies without anything hidden."""
    hidden = [one for one in scored if one.row["kind"] in HIDDEN and one.row["share"] >= SHARE]
    return hidden, [one for one in scored if one.row["kind"] in UNCHANGED]


def rival(rows: Sequence[Row]) -> dict[str, str]:
    """The same of a rival, who is always sure."""
    hidden = [row for row in rows if row["kind"] in HIDDEN and row["share"] >= SHARE]
    nothing = [row for row in rows if row["kind"] in UNCHANGED]

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
    """Median held-out error after over that of the file as given, and how often it is greater."""
    ratios = np.array([row["after"] / row["before"] for row in rows if row["after"] is not None])
    return f"{np.median(ratios):.2f}, greater in {rate((ratios > 1.0).tolist())}" if ratios.size else ""


def _median(values: Iterable[float]) -> str:
    those = list(values)
    return f"{np.median(those):.0f}" if those else ""


def base(results: pl.DataFrame, others: pl.DataFrame) -> Iterator[Row]:
    """The diagnosis, its rivals, and what bounds them."""
    for words, with_before in (("", False), (" --before", True)):
        scored = [score(row) for row in results.filter(with_before=with_before, failure="").to_dicts()]
        if scored:
            yield {"by": f"`hydro diagnose{words}`", **told(scored)}
    yield from _rivals(others.filter(condition=BASE))
    hidden, _ = _parted([score(row) for row in results.filter(failure="").to_dicts()])
    best = [one.row | {"after": one.row["oracle"]} for one in hidden if one.row["oracle"] is not None]
    if best:
        yield {"by": "the true change, fitted (bound)", "error after / before": _ratio(best)}
    yield as_given(results)


def as_given(results: pl.DataFrame) -> Row:
    """The baseline: the file itself, which names nothing."""
    hidden, nothing = _parted([score(row) for row in results.filter(failure="").to_dicts()])
    silent = {
        "nothing named": rate(True for _ in hidden),
        "alarm, nothing hidden": rate(False for _ in nothing),
    }
    return {"by": "the file as given (baseline)", **silent, "error after / before": "1.00"}


def logs(results: pl.DataFrame, others: pl.DataFrame) -> Iterator[Row]:
    """The diagnosis under each condition, and its rivals there."""
    for condition in CONDITIONS:
        rows = results.filter((pl.col("condition") == condition) & (pl.col("failure") == "")).to_dicts()
        if rows:
            yield {"log": condition, "by": "`hydro diagnose`", **told([score(row) for row in rows])}
        for row in _rivals(others.filter(condition=condition)):
            yield {"log": condition, **row}
    scored = [score(row) for row in results.filter(failure="").to_dicts()]
    for name, part in (("sensors, all together", tuple(SPOILT)), ("controllers, all together", CLOSED)):
        yield {
            "log": name,
            "by": "`hydro diagnose`",
            **told([s for s in scored if s.row["condition"] in part]),
        }
    yield {"log": "all", **as_given(results)}


def _rivals(others: pl.DataFrame) -> Iterator[Row]:
    for (name,), part in others.filter(failure="").group_by("rival", maintain_order=True):
        yield {"by": name, **rival(part.to_dicts())}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("which", choices=("base", "logs"))
    parser.add_argument("results", type=Path)
    parser.add_argument("--rivals", type=Path, help="results of rivals on the same studies")
    parser.add_argument("--commit", required=True, help="of the code that was measured")
    parser.add_argument("--rivals-commit", help="of the code that the rivals ran beside; by default the same")
    chosen = parser.parse_args()
    results = pl.read_parquet(chosen.results)
    others = pl.DataFrame(schema=SCHEMA) if chosen.rivals is None else pl.read_parquet(chosen.rivals)
    rows = list({"base": base, "logs": logs}[chosen.which](results, others))
    command = f"python -m benchmarks.imperfect_{chosen.which} run --seconds {results['seconds'][0]:g}"
    whence = origin(results, command, chosen.commit)
    beside = whence | {
        "seeds": f"{others['seed'].min()} to {others['seed'].max()}",
        "commit": chosen.rivals_commit or chosen.commit,
    }
    rivals = set(others["rival"])
    keep(f"imperfect_{chosen.which}", [row | (beside if row["by"] in rivals else whence) for row in rows])


if __name__ == "__main__":
    main()
