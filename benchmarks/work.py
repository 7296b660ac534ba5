"""Parallel tasks of a benchmark, and a results file that grows with them."""

from __future__ import annotations

import argparse
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, TypeVar

import polars as pl

Result = TypeVar("Result")


def done(
    task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]], chosen: argparse.Namespace
) -> Iterator[Result]:
    """Run a task with each tuple of arguments, and yield results as they end.

    Args:
        task: Function of a module.
        arguments: Arguments of each call.
        chosen: Values of the options of `add_workers`, which say where tasks run.
    """
    if chosen.engine == "ray":
        from hydro.study.cluster import Cluster

        with Cluster(chosen.address) as cluster:
            cluster.prepare()
            yield from cluster.as_they_end(task, arguments)
        return
    if chosen.workers == 1:
        yield from (task(*each) for each in arguments)
        return
    with ProcessPoolExecutor(chosen.workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(task, *each) for each in arguments]):
            yield future.result()


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where tasks run.

    Each node of a Ray cluster needs this checkout at the same path.
    """
    parser.add_argument("--workers", type=int, default=1, help="processes of this machine")
    parser.add_argument("--engine", choices=("here", "ray"), default="here", help="or the nodes of a cluster")
    parser.add_argument("--address", help="HOST:PORT of the cluster's head")


def add_report(commands: Any, summary: Callable[[pl.DataFrame], str], key: Sequence[str]) -> None:
    """Add a subcommand that prints the summary of one or more results files, each study once."""
    report = commands.add_parser("report", help="sum up results, as Markdown")
    report.add_argument("results", type=Path, nargs="+")
    report.set_defaults(
        action=lambda chosen: print(
            summary(together(map(pl.read_parquet, chosen.results)).unique(key)), end=""
        )
    )


def together(tables: Iterable[pl.DataFrame]) -> pl.DataFrame:
    """Return several tables of results as one; a column that a table lacks is null in its rows."""
    return pl.concat(tables, how="diagonal")


class Results:
    """Table of results on disk; each addition replaces the file atomically."""

    def __init__(self, path: Path, schema: Mapping[str, Any]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path, self.schema = path, schema
        self.table = pl.DataFrame(schema=schema)
        if path.exists():
            self.table = together([self.table, pl.read_parquet(path)])

    def add(self, *rows: Mapping[str, Any]) -> None:
        """Add rows, and write the file."""
        self.table = pl.concat([self.table, pl.DataFrame(rows, schema=self.schema)])
        partial = self.path.with_suffix(".partial")
        self.table.write_parquet(partial)
        partial.replace(self.path)
