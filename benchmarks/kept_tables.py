"""Result tables that are kept in benchmarks/results, and the pages of the documentation that show them."""

from __future__ import annotations

import csv
import datetime
import runpy
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import polars as pl

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
GENERATOR = ROOT / "docs" / "generate_benchmarks.py"
Row = dict[str, Any]


def origin(results: pl.DataFrame, command: str, commit: str) -> Row:
    """Return the origin of a table's figures, in the columns that docs/generate_benchmarks.py reads.

    Args:
        results: Table of results, with the seeds.
        command: Command that repeats the measurement.
        commit: Measured commit.
    """
    seeds = f"{results['seed'].min()} to {results['seed'].max()}"
    return {
        **{"commit": commit, "recorded": "", "date": datetime.date.today().isoformat()},
        **{"command": command, "seeds": seeds},
    }


def keep_timed(script: str, name: str, rows: Sequence[Row], commit: str, seed: int, **options: Any) -> None:
    """Keep the processor times that a script measured, with the command that repeats it.

    Args:
        script: File name of the script in benchmarks.
        name: Name of the table.
        rows: Cells by column.
        commit: Measured commit.
        seed: Seed of the script.
        options: Values of the script's options by their name, in the order of the command.
    """
    values = {key: f"{value:g}" if isinstance(value, float) else value for key, value in options.items()}
    words = " ".join(f"--{key} {value}" for key, value in values.items())
    command = f"OMP_NUM_THREADS=1 python benchmarks/{script} {words}"
    where = origin(pl.DataFrame({"seed": [seed]}), command, commit)
    keep(name, [row | where for row in rows])


def keep(name: str, rows: Sequence[Row], folder: Path = RESULTS) -> None:
    """Write a table of rows with their origin, and regenerate the pages if it is a kept table.

    Args:
        name: Name of the table.
        rows: Cells by column, as displayed; missing cells are empty.
        folder: Folder of the table.
    """
    columns = list(dict.fromkeys(column for row in rows for column in row))
    last = [column for column in columns if column in origin(pl.DataFrame({"seed": [0]}), "", "")]
    with (folder / f"{name}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, [*(c for c in columns if c not in last), *last], restval="")
        writer.writeheader()
        writer.writerows(rows)
    if folder == RESULTS:
        runpy.run_path(str(GENERATOR), run_name="__main__")


def markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a table in Markdown."""
    columns = list(dict.fromkeys(column for row in rows for column in row))
    cells = [[str(row.get(column, "")) for column in columns] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in [columns, ["---"] * len(columns), *cells])
