"""Keep what `hydro rl eval` wrote as result tables: the tasks, and the settings that they are flown in.

    hydro rl eval datasets/vehicles/auv151.toml --task slalom --in teacher -o slalom-teacher.parquet
    python -m benchmarks.policies tasks *.parquet --commit COMMIT --command "hydro rl eval ..."

Cells are the share that succeeded with Wilson's 95 % interval, median time to goal, root mean square distance
from what is to be followed, energy in seconds of all thrusters at full thrust, and the share of collisions.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import polars as pl

from benchmarks.kept_tables import Row, keep, origin
from hydro.io import table

HOLDING = ("station_keeping", "circle", "helix", "lemniscate")
"""Tasks that go on to their end, so that no time tells."""


def cell(row: Row) -> str:
    """One evaluation in words."""
    low, high = 100.0 * row["success_low"], 100.0 * row["success_high"]
    words = [f"{100.0 * row['success']:.3g}% ({low:.1f} to {high:.1f})"]
    if row["task"] not in HOLDING and row["time_to_goal"] is not None:
        words.append(f"{row['time_to_goal']:.1f} s")
    if row["success"] > 0.5:
        words += [f"{row['tracking_error']:.2f} m off", f"energy {row['energy']:.2g} s"]
    return ", ".join(words) + (f"; hit {100.0 * row['collision']:.3g}%" if row["collision"] else "")


def named(row: Row, counted: dict[str, str]) -> str:
    """A task with its level in words."""
    level = counted.get(row["task"], "")
    return row["task"].replace("_", " ") + (f", {row['level']} {level}" if level else "")


def by_task(found: pl.DataFrame, counted: dict[str, str]) -> list[Row]:
    """A row for each task and who flies it: cells in student and teacher."""
    rows: dict[tuple[str, str], Row] = {}
    for row in found.filter(setting="nominal").iter_rows(named=True):
        key = named(row, counted), row["flown_by"]
        made = rows.setdefault(key, {"task": key[0], "flown by": key[1]})
        made["in Stonefish" if row["plant"] == "stonefish" else f"in the {row['plant']}"] = cell(row)
    return list(rows.values())


def by_setting(found: pl.DataFrame, counted: dict[str, str]) -> list[Row]:
    """A row for each task, who flies it and where: shares that succeeded by setting."""
    rows: dict[tuple[str, str, str], Row] = {}
    for row in found.iter_rows(named=True):
        key = named(row, counted), row["flown_by"], row["plant"]
        columns = dict(zip(("task", "flown by", "in the"), key, strict=True))
        made = rows.setdefault(key, columns | {"tasks": str(row["episodes"])})
        made[row["setting"].replace("_", " ")] = f"{100.0 * row['success']:.3g}%"
    return list(rows.values())


def main() -> None:
    from hydro.rl.tasks.registry import TASKS

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("which", choices=["tasks", "settings", "trained"])
    parser.add_argument("files", nargs="+", type=Path, help="tables of evaluations")
    parser.add_argument("--commit", required=True, help="of the code that was measured")
    parser.add_argument("--command", required=True, help="by which")
    given = parser.parse_args()
    found = pl.concat([table.read(path, "evaluations").frame for path in given.files])
    counted = {name: task.levels for name, task in TASKS.items() if task.levels}
    seeds = "tasks of 1000000"
    if given.which == "trained":
        found = found.filter(flown_by="policy").with_columns(flown_by=pl.col("condition"))
        seeds = f"training {', '.join(map(str, sorted(set(found['seed']))))}; {seeds}"
    rows = (by_setting if given.which == "settings" else by_task)(found, counted)
    where = origin(found, given.command, given.commit) | {"seeds": seeds}
    keep(f"rl_{given.which}", [row | where for row in rows])


if __name__ == "__main__":
    main()
