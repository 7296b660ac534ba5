"""Results files of the scoreboard: reading several files as one table, and the command that made it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import polars as pl

from benchmarks.judge.rows import KEY, SCHEMA
from benchmarks.judge.studies import LISTS
from benchmarks.work import together


def read(paths: Iterable[Path]) -> pl.DataFrame:
    """Return results files as one table; the last file takes precedence for repeated studies.

    Raises:
        SystemExit: A file holds no results of the scoreboard.
    """
    found = pl.DataFrame(schema=SCHEMA)
    for path in paths:
        table = pl.read_parquet(path)
        if not {*KEY, "role", "called"} <= set(table.columns):
            raise SystemExit(f"{path} holds no results of `python -m benchmarks.judge run`")
        found = together([found.join(table.select(KEY).unique(), on=KEY, how="anti"), table])
    return found


def made_by(table: pl.DataFrame) -> str:
    """Return the command lines that run the studies of a table, one for each range of successive seeds.

    The seeds of each list start at the first one of the range.
    """
    studies = table.select(KEY).unique(maintain_order=True)
    seeds = studies["seed"].unique().sort()
    starts = seeds.filter(seeds.diff().fill_null(2) > 1)
    ranges = studies.with_columns(first=starts.gather(starts.search_sorted(studies["seed"], "right") - 1))
    return "; ".join(map(_made_by, ranges.partition_by("first", maintain_order=True, include_key=False)))


def _made_by(studies: pl.DataFrame) -> str:
    """Return the command line that runs studies whose seeds are successive in each list."""
    lists = studies["list"].value_counts(sort=True).sort("list")
    usual = all(LISTS[name].seconds == seconds for name, seconds in studies.select("list", "seconds").rows())
    words = [f"--list {name}={count}" for name, count in lists.rows()]
    words.append(f"--first-seed {studies['seed'].min()}")
    words += [] if usual else [f"--seconds {studies['seconds'][0]:g}"]
    return f"python -m benchmarks.judge run {' '.join(words)}"
