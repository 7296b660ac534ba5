"""Result tables of `hydro rl eval`, by task and by setting.

Cells contain the success rate with Wilson's 95 % interval, median time to goal, and root mean square distance
from the reference path.  They also contain the energy in seconds of all thrusters at full thrust, and the
collision rate.  With several trainings they are those of the median training by success, with the range of
success rates.

    # Test policies:
    hydro rl eval datasets/vehicles/auv151.toml --task slalom --in teacher -o slalom-teacher.parquet
    # Keep the results:
    python -m benchmarks.policies tasks *.parquet --commit COMMIT --command "hydro rl eval ..."
    # Measure trainings:
    /usr/bin/time -f "%U %S" -o run-0.time hydro rl train datasets/vehicles/auv151.toml --seed 0 -o run-0
    # Keep the results:
    python -m benchmarks.policies trainings run-* --commit COMMIT --command "hydro rl train ..."
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import polars as pl

from benchmarks.kept_tables import Row, keep, origin
from hydro.io import table

POLICY = "policy"
HOLDING = ("station_keeping", "circle", "helix", "lemniscate")
"""Tasks with a fixed duration, for which a time to the goal has no meaning."""


def arrivals(row: Row) -> list[str]:
    """Return the success rate of one evaluation, and its median time to the goal, in words."""
    low, high = 100.0 * row["success_low"], 100.0 * row["success_high"]
    words = [f"{100.0 * row['success']:.3g}% ({low:.1f} to {high:.1f}){spread(row)}"]
    if row["task"] not in HOLDING and row["time_to_goal"] is not None:
        words.append(f"{row['time_to_goal']:.1f} s")
    return words


def cell(row: Row) -> str:
    """Return one evaluation in words."""
    words = arrivals(row)
    if row["success"] > 0.5:
        words += [f"{row['tracking_error']:.2f} m off", f"energy {row['energy']:.2g} s"]
    return ", ".join(words) + (f"; hit {100.0 * row['collision']:.3g}%" if row["collision"] else "")


def of_seeds(rows: Sequence[Row]) -> Row:
    """Return the evaluation of the training with the median success, with all success rates.

    Of an even number, the lower of the two middle ones counts.
    """
    ranked = sorted(rows, key=lambda row: (row["success"], -row["collision"]))
    return ranked[(len(ranked) - 1) // 2] | {"all": [row["success"] for row in ranked]}


def spread(row: Row) -> str:
    """Return the range of several trainings in words; empty for one."""
    shares = row["all"]
    return f" [{100.0 * shares[0]:.3g} to {100.0 * shares[-1]:.3g}]" if len(shares) > 1 else ""


def named(row: Row, counted: dict[str, str]) -> str:
    """Return a task with its level in words."""
    level = counted.get(row["task"], "")
    return row["task"].replace("_", " ") + (f", {row['level']} {level}" if level else "")


def medians(found: pl.DataFrame) -> list[Row]:
    """Return evaluations with the trainings of each policy merged by `of_seeds`.

    Of a pilot, which is the same for every training, one evaluation is kept.
    """
    alike = ["task", "level", "flown_by", "condition", "plant", "setting", "episodes"]
    once = found.unique([*alike, "seed"], keep="first", maintain_order=True)
    once = once.filter((pl.col("flown_by") == POLICY) | (pl.col("seed") == pl.col("seed").min().over(alike)))
    return [of_seeds(each.to_dicts()) for each in once.partition_by(alike, maintain_order=True)]


def flyer(row: Row) -> str:
    """Return the name of the actor of an evaluation; for a policy, the physics of its training."""
    return str(row["condition"] if row["flown_by"] == POLICY else row["flown_by"])


def by_task(found: pl.DataFrame, counted: dict[str, str]) -> list[Row]:
    """Return a row for each task and actor, with cells for the MuJoCo model and the reference simulator."""
    rows: dict[tuple[str, str], Row] = {}
    for row in medians(found.filter(setting="nominal")):
        key = named(row, counted), flyer(row)
        made = rows.setdefault(key, {"task": key[0], "flown by": key[1]})
        made["in Stonefish" if row["plant"] == "stonefish" else f"in the {row['plant']}"] = cell(row)
    return list(rows.values())


def by_setting(found: pl.DataFrame, counted: dict[str, str]) -> list[Row]:
    """Return a row for each task, actor and simulator: success rates and times by test setting."""
    rows: dict[tuple[str, str, str], Row] = {}
    for row in medians(found):
        key = named(row, counted), flyer(row), row["plant"]
        columns = dict(zip(("task", "flown by", "in the"), key, strict=True))
        made = rows.setdefault(key, columns | {"tasks": str(row["episodes"])})
        made[row["setting"].replace("_", " ")] = ", ".join(arrivals(row))
    return list(rows.values())


def passed_exams(evaluations: pl.DataFrame) -> pl.DataFrame:
    """Return the passed examinations of a training."""
    from hydro.rl.training.config import Curriculum

    return evaluations.filter(pl.col("purpose") == "exam", pl.col("success") >= Curriculum.share)


def training(run: Path) -> Row:
    """Return the row of one training: steps until it first passed each task, and tasks of its last policy."""
    from hydro.rl.tasks.registry import STAGES

    found = table.read(run / "evaluations.parquet", "evaluations").frame
    passed = passed_exams(found)
    first: dict[str, int] = {row["task"]: row["steps"] for row in reversed(passed.to_dicts())}
    at_last = passed.filter(steps=pl.col("steps").max())["task"].n_unique()
    end = f"{found['steps'].max():,}"
    user, system = map(float, run.with_suffix(".time").read_text().split())
    return (
        {"seed": str(found["seed"][0])}
        | {
            f"{task.replace('_', ' ')}": f"{first[task]:,}" if task in first else "not passed"
            for task in STAGES
        }
        | {"all with one policy": end if at_last == len(STAGES) else f"not passed by {end}"}
        | {"processor time": f"{(user + system) / 60.0:.1f} min"}
    )


def main() -> None:
    from hydro.rl.tasks.registry import TASKS

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("which", choices=["tasks", "settings", "trained", "trainings"])
    parser.add_argument("files", nargs="+", type=Path, help="tables of evaluations, or folders of trainings")
    parser.add_argument("--commit", required=True, help="commit of the measured code")
    parser.add_argument("--command", required=True, help="command of the evaluations")
    given = parser.parse_args()
    if given.which == "trainings":
        rows = [training(run) for run in given.files]
        where = origin(
            pl.DataFrame({"seed": [int(row["seed"]) for row in rows]}), given.command, given.commit
        )
        keep("rl_trainings", [row | where for row in rows])
        return
    found = pl.concat([table.read(path, "evaluations").frame for path in given.files])
    counted = {name: task.levels for name, task in TASKS.items() if task.levels}
    trained = found.filter(flown_by=POLICY)["seed"].unique().sort()
    seeds = f"training {', '.join(map(str, trained))}; " if len(trained) else ""
    rows = (by_setting if given.which == "settings" else by_task)(found, counted)
    where = origin(found, given.command, given.commit) | {"seeds": f"{seeds}tasks of 1000000"}
    keep(f"rl_{given.which}", [row | where for row in rows])


if __name__ == "__main__":
    main()
