"""Result tables of `hydro rl study`: training of every condition, and performance of its policies.

The cells of the tests are those of `benchmarks.policies`: the median training, with the range of all.  Expert
pilots are included, in the MuJoCo model of each condition and once in the reference simulator.

    # Train every condition and test the policies.
    hydro rl study datasets/vehicles/auv151.toml --model physfeat.parquet --model mlp.parquet
        --model structured.parquet --identified identified.toml --recipe imitation -o study
    # Write the tables.
    python -m benchmarks.paper_study study --commit COMMIT
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from pathlib import Path

import polars as pl

from benchmarks.commands import ranged
from benchmarks.kept_tables import Row, keep, origin
from benchmarks.policies import POLICY, cell, named, of_seeds, passed_exams
from hydro.io import table

COMMAND = (
    "hydro rl study datasets/vehicles/auv151.toml --model physfeat.parquet --model mlp.parquet "
    "--model structured.parquet --identified identified.toml --recipe imitation -o study"
)
WITH_MAP = "helmsman with map"


def flights(tests: pl.DataFrame, counted: dict[str, str]) -> list[Row]:
    """Return a row for each task and condition, and one for each pilot in the reference simulator."""
    rows: list[Row] = []
    for each in tests.partition_by("task", maintain_order=True):
        task, teacher = named(each.row(0, named=True), counted), each.filter(plant="teacher")
        pilots = teacher.filter(pl.col("flown_by") != POLICY).unique("flown_by", maintain_order=True)
        rows += [
            {"task": task, "flown by": row["flown_by"], "in the teacher": cell(of_seeds([row]))}
            for row in pilots.to_dicts()
        ]
        for condition in each["condition"].unique(maintain_order=True):
            own = each.filter(condition=condition)
            student = own.filter(plant="student")
            by_hand = WITH_MAP if WITH_MAP in student["flown_by"] else "helmsman"
            rows.append(
                {
                    "task": task,
                    "flown by": f"policies of {condition}",
                    "in the teacher": _words(own.filter(plant="teacher"), POLICY),
                    "in their student": _words(student, POLICY),
                    "pilot by hand, in their student": _words(student, by_hand),
                }
            )
    return rows


def _words(found: pl.DataFrame, by: str) -> str:
    """Return the flights of a pilot, or of the policies of all trainings, in words."""
    rows = found.filter(flown_by=by).to_dicts()
    return cell(of_seeds(rows)) if rows else ""


def trainings(folder: Path, conditions: Iterable[str]) -> list[Row]:
    """Return a row for each condition: steps until one policy passed all tasks, and minutes of training."""
    from hydro.rl.tasks.registry import STAGES

    minutes = {
        Path(line.rsplit(" ", 1)[1]).name: float(step["seconds"]) / 60.0
        for line, step in json.loads((folder / "steps.json").read_text()).items()
        if line.startswith("rl train")
    }
    rows: list[Row] = []
    for condition in conditions:
        runs = sorted(folder.glob(f"{condition}-seed*"))
        passed, last, diverged = [], [], 0
        for run in runs:
            found = table.read(run / "evaluations.parquet", "evaluations").frame
            whole = (
                passed_exams(found).group_by("steps").agg(pl.col("task").n_unique()).filter(task=len(STAGES))
            )
            passed += [int(whole["steps"].min())] if len(whole) else []
            last.append(int(found["steps"].max()))
            diverged += int(table.read(run / "curves.parquet", "curves").frame["diverged"].sum() > 0)
        rows.append(
            {
                "condition": condition,
                "passed all three": f"{len(passed)} of {len(runs)}",
                "steps until then": ranged(passed, ",.0f") if passed else f"not by {max(last):,}",
                "minutes of training": ranged([minutes[run.name] for run in runs], ".1f"),
                "trainings with numerical divergence": f"{diverged} of {len(runs)}",
            }
        )
    return rows


def main() -> None:
    from hydro.rl.tasks.registry import TASKS

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of a study")
    parser.add_argument("--commit", required=True, help="commit of the measured code")
    parser.add_argument("--command", default=COMMAND, help="command of the study")
    given = parser.parse_args()
    tests = table.read(given.folder / "tests.parquet", "evaluations").frame
    counted = {name: task.levels for name, task in TASKS.items() if task.levels}
    seeds = pl.DataFrame({"seed": tests.filter(flown_by=POLICY)["seed"].unique().sort()})
    where = origin(seeds, given.command, given.commit)
    keep("rl_study", [row | where for row in flights(tests, counted)])
    conditions = tests["condition"].unique(maintain_order=True)
    keep("rl_study_trainings", [row | where for row in trainings(given.folder, conditions)])


if __name__ == "__main__":
    main()
