"""Draw mutants, run the nearest tests of each, and keep a table that a later call continues.

`seed0.csv` in this folder is the last run of 200 mutants.  Its survivors are tested again by

    python -m benchmarks.mutants --again alive -o benchmarks/mutants/seed0.csv
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import random
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.mutants import sites, trial
from benchmarks.mutants.tree import Change, Tree

ROOT = Path(__file__).resolve().parents[2]
EQUIVALENT = Path(__file__).with_name("equivalent.csv")
"""File of changes without a visible effect, with the reason for each."""
WHERE = ("hydro/core/*", "hydro/io/*", "hydro/rl/*")
PLACE = ("file", "line", "column", "within", "kind", "code", "old", "new")
FOUND = ("status", "by", "mode", "tests", "seconds")
KILLED = ("killed", "timeout")
RETRIES = 6
"""Tests that fail without the change too, at most, before the mutant is given up as alive."""
PYTHON = "any kernels as Python"
Row = dict[str, str]


def drawn(tree: Tree, count: int, seed: int, where: Sequence[str]) -> list[Row]:
    """Return rows of mutants to test: lines drawn without replacement, with one change each.

    Args:
        tree: The tree.
        count: Number of mutants.
        seed: Seed of the draw.
        where: Patterns of the source files.
    """
    sources = tree.sources(where)
    lines: dict[tuple[Path, int], list[sites.Site]] = {}
    for path, source in sources.items():
        for site in sites.sites(source):
            lines.setdefault((path, site.line), []).append(site)
    rng = random.Random(seed)
    order, rows = sorted(lines), list[Row]()
    rng.shuffle(order)
    for path, line in order:
        if len(rows) == count:
            break
        choices = lines[path, line]
        rng.shuffle(choices)
        site = next((one for one in choices if sites.valid(sources[path], one)), None)
        if site is not None:
            rows.append(_row(path, sources[path], site))
    return rows


def _row(path: Path, source: str, site: sites.Site) -> Row:
    line = source.splitlines()[site.line - 1]
    column = site.start - source.rfind("\n", 0, site.start) - 1
    old = " ".join(source[site.start : site.stop].split())
    values = (path, site.line, column, site.within, site.kind, line.strip(), old, site.new.strip())
    return dict(zip(PLACE, map(str, values), strict=True)) | dict.fromkeys(FOUND, "")


def located(tree: Tree, row: Row) -> Change | None:
    """Return the present place of a row's change, for any lines added or removed before it."""
    path = Path(row["file"])
    if not (tree.root / path).exists():
        return None
    source = (tree.root / path).read_text()
    alike = ("within", "kind", "code", "old", "new", "column")
    found = [
        site
        for site in sites.sites(source)
        if all(_row(path, source, site)[key] == row[key] for key in alike)
    ]
    nearest = min(found, key=lambda site: abs(site.line - int(row["line"])), default=None)
    return None if nearest is None else Change(path, nearest)


class Known:
    """Known results of single tests without a change, stored next to the tree, which avoid most such runs.

    Results are valid until the package or the file of the test changes.

    Args:
        tree: The tree.
    """

    def __init__(self, tree: Tree) -> None:
        self.path = tree.work / f"known-{tree.digest}.json"
        self.files = {str(file.path): file.digest for file in tree.tests.files}
        kept = json.loads(self.path.read_text()) if self.path.exists() else {}
        same = {file for file, digest in kept.get("files", {}).items() if self.files.get(file) == digest}
        self.sound, self.broken = (
            {
                way: {test for test in tests if test.partition("::")[0] in same}
                for way, tests in kept.get(what, {}).items()
            }
            for what in ("sound", "broken")
        )
        self.took: dict[str, dict[str, float]] = kept.get("took", {})

    def passed(self, way: str, took: Mapping[str, float]) -> None:
        """Record tests that pass without a change, and how long they took.

        Args:
            way: Functions that run as Python in these tests; empty if all are compiled.
            took: Processor time of each test [s].
        """
        self.sound.setdefault(way, set()).update(took)
        self.took.setdefault(PYTHON if way else "", {}).update(took)

    def failed(self, way: str, test: str, slow: bool) -> None:
        """Record a test that fails without a change; a test too slow as Python is so for every change."""
        self.broken.setdefault(PYTHON if slow and way else way, set()).add(test)

    def skipped(self, way: str) -> list[str]:
        """Return tests that prove nothing: they fail without a change when kernels run in this way."""
        ways = {"", way, PYTHON} if way else {""}
        return sorted(test for each in ways for test in self.broken.get(each, ()))

    def save(self) -> None:
        """Write the results to their file."""
        both = {"sound": self.sound, "broken": self.broken}
        text = {what: {way: sorted(tests) for way, tests in ways.items()} for what, ways in both.items()}
        self.path.write_text(json.dumps({**text, "files": self.files, "took": self.took}))


@dataclass
class Tester:
    """Runs the tests of mutants in one tree.

    Attributes:
        tree: The tree.
        seconds: Processor time of tests for each mutant [s].
        per_test: Processor time after which a test counts as hung [s].
    """

    tree: Tree
    seconds: float
    per_test: float = trial.PER_TEST

    def __post_init__(self) -> None:
        self.known = Known(self.tree)

    def tested(self, row: Row) -> Row:
        """Return a row with the result of its mutant."""
        change = located(self.tree, row)
        if change is None:
            return row | {"status": "gone"}
        plan = self.tree.plan(change, self.seconds, self.per_test)
        files = [str(path) for path in self.tree.tests.nearest(self.tree.nodes(change))]
        mode = "interpreted" if plan.interpreted else "compiled" if plan.affected else "plain"
        way = " ".join(sorted(plan.affected)) if plan.interpreted else ""
        plan = replace(plan, took=self.known.took.get(PYTHON if way else "", {}))
        seconds, status, by, ran = 0.0, "alive" if files else "untested", "", set[str]()
        for _ in range(RETRIES if files else 0):
            with self.tree.holding(change):
                outcome = trial.run(plan, files, self.known.skipped(way))
            seconds += outcome.seconds
            ran.update(outcome.passed)
            self.known.passed(way, outcome.passed)
            if outcome.status == "passed":
                break
            hung = outcome.status == "hung"
            if hung:  # a test that needs half of the time anyhow proves nothing
                plan = replace(plan, per_test=0.5 * outcome.allowed)
            if self._passes(plan, way, outcome.by, hung):
                status, by = ("timeout" if hung else "killed"), outcome.by
                break
            self.known.failed(way, outcome.by, hung)
            print(f"not counted, for it fails without the change too: {outcome.by}", flush=True)
            if hung:
                break  # the mutant's time is used up
        self.known.save()
        found = (status, by, mode, str(len(ran) + bool(by)), f"{seconds:.1f}")
        return row | dict(zip(FOUND, found, strict=True))

    def _passes(self, plan: trial.Plan, way: str, test: str, hung: bool) -> bool:
        """Return whether a test, or a file that could not be collected, passes without the change."""
        if not test or (test in self.known.sound.get(way, ()) and not hung):
            return True  # if no test began, the change broke a common import
        outcome = trial.run(plan, [test])
        self.known.passed(way, outcome.passed)
        return outcome.status == "passed" or ("::" not in test and bool(outcome.passed))


_tester: Tester | None = None


def _begin(checkout: Path, work: Path, package: str, seconds: float, per_test: float) -> None:
    """Make this process a worker that tests mutants in its own copy of the tree."""
    global _tester
    _tester = Tester(Tree(checkout, work / str(os.getpid()), package), seconds, per_test)
    trial.preload(_tester.tree.needed())


def _tested(row: Row) -> Row:
    assert _tester is not None
    return _tester.tested(row)


def tested(
    rows: Sequence[Row], tester: Tester, workers: int, checkout: Path, package: str
) -> Iterator[tuple[int, Row]]:
    """Yield the rows with their results as they finish, each with its number."""
    if workers == 1:
        trial.preload(tester.tree.needed())
        for number, row in enumerate(rows):
            yield number, tester.tested(row)
        return
    begin = (checkout, tester.tree.work, package, tester.seconds, tester.per_test)
    with ProcessPoolExecutor(workers, get_context("spawn"), _begin, begin) as pool:
        waiting = {pool.submit(_tested, row): number for number, row in enumerate(rows)}
        for done in as_completed(waiting):
            yield waiting[done], done.result()


def read(path: Path) -> list[Row]:
    """Return the rows of a table."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def write(path: Path, rows: Sequence[Row]) -> None:
    """Write a table to a temporary file and rename it, so that it is complete or absent."""
    passing = path.with_name(f".{path.name}.tmp")
    with passing.open("w", newline="") as file:
        writer = csv.DictWriter(file, [*PLACE, *FOUND])
        writer.writeheader()
        writer.writerows(rows)
    passing.replace(path)


def equivalent(row: Row, listed: Sequence[Row]) -> bool:
    """Return whether a mutant is in the list of mutants that do not change the behaviour."""
    return any(all(row[key] == one[key] for key in one if key != "reason") for one in listed)


def summary(rows: Sequence[Row], listed: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the counts of results for each part of the package, and for all parts."""
    parts: dict[str, list[Row]] = {}
    for row in rows:
        parts.setdefault("/".join(Path(row["file"]).parts[:2]), []).append(row)
    table = []
    for part, some in [*sorted(parts.items()), ("all", list(rows))]:
        killed = sum(row["status"] in KILLED for row in some)
        same = sum(row["status"] not in KILLED and equivalent(row, listed) for row in some)
        table.append(
            {
                "part": part,
                "mutants": len(some),
                "killed": killed,
                "equivalent": same,
                "alive": len(some) - killed - same,
                "killed of those that matter": f"{100.0 * killed / max(len(some) - same, 1):.0f} %",
            }
        )
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    about = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=about)
    parser.add_argument("--count", type=int, default=200, help="mutants to draw")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--where", action="append", help=f"pattern of files; default {' '.join(WHERE)}")
    parser.add_argument("--seconds", type=float, default=30.0, help="processor time of tests per mutant")
    parser.add_argument("--per-test", type=float, default=trial.PER_TEST, help="and of one that hangs")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--again", action="append", default=[], help="a status whose mutants are tested again"
    )
    parser.add_argument("--first", type=int, help="test no more than so many mutants now")
    parser.add_argument("--checkout", type=Path, default=ROOT, help="tree to copy and test")
    parser.add_argument("--package", default="hydro")
    parser.add_argument(
        "--work", type=Path, help="folder for the copy; default build/mutants of the checkout"
    )
    parser.add_argument(
        "-o", "--out", type=Path, help="table, gone on with; default mutants.csv in that folder"
    )
    chosen = parser.parse_args(arguments)
    work = chosen.work or chosen.checkout / "build" / "mutants"
    work.mkdir(parents=True, exist_ok=True)
    out = chosen.out or work / "mutants.csv"
    tester = Tester(Tree(chosen.checkout, work, chosen.package), chosen.seconds, chosen.per_test)
    if out.exists():
        rows = read(out)
    else:
        rows = drawn(tester.tree, chosen.count, chosen.seed, chosen.where or WHERE)
        write(out, rows)
    waiting = [n for n, row in enumerate(rows) if not row["status"] or row["status"] in chosen.again]
    waiting = waiting[: chosen.first]
    some = [rows[n] for n in waiting]
    for done, (number, row) in enumerate(
        tested(some, tester, chosen.workers, chosen.checkout, chosen.package), start=1
    ):
        rows[waiting[number]] = row
        write(out, rows)
        what = f"{row['file']}:{row['line']} {row['old']!r} -> {row['new']!r}"
        print(f"{done}/{len(some)} {row['status']:8} {row['seconds']:>6} s {what} {row['by']}", flush=True)
    listed = read(EQUIVALENT) if EQUIVALENT.exists() else []
    for line in summary([row for row in rows if row["status"]], listed):
        print("  ".join(f"{name} {value}" for name, value in line.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
