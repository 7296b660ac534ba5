"""Result tables of `hydro study paper`, and verdicts on the claims of the paper.

    # Run the study:
    hydro study paper datasets/stonefish/sample.parquet --replay datasets/stonefish/replay90.parquet
        --vehicle datasets/stonefish/vehicle.toml --given benchmarks/paper_given.toml -o study
    # Keep its tables:
    python -m benchmarks.paper_rl study --commit COMMIT
    # Likewise for the recipe of the paper, stage 1 only:
    hydro study paper datasets/stonefish/sample.parquet --replay datasets/stonefish/replay90.parquet
        --vehicle datasets/stonefish/vehicle.toml --model mlp --model physfeat --condition R_PhysFeat
        --condition R_MLP --condition R_0 --recipe paper --stages 1 --steps 500000 --seeds 3 --epochs 60
        --episodes 50 -o slow
    python -m benchmarks.paper_rl slow --recipe paper --commit COMMIT

Of a study that was stopped, rows of steps that were not reached say so.
"""

from __future__ import annotations

import argparse
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import polars as pl

from benchmarks.kept_tables import Row, keep, origin
from hydro.study import paper, paper_tables
from hydro.study.paper_tables import NOT_RUN, PASSED, UNFINISHED
from hydro.study.policies import Run

DATA = (
    "hydro study paper datasets/stonefish/sample.parquet --replay datasets/stonefish/replay90.parquet "
    "--vehicle datasets/stonefish/vehicle.toml"
)
COMMANDS = {
    "sac": f"{DATA} --given benchmarks/paper_given.toml --epochs 60 --episodes 50 -o study",
    "paper": f"{DATA} --model mlp --model physfeat --condition R_PhysFeat --condition R_MLP --condition R_0 "
    "--recipe paper --stages 1 --steps 500000 --seeds 3 --epochs 60 --episodes 50 -o slow",
}
"""Command of the study of each recipe."""
PLACES = {"kernels": "in kernels", "student": "in MuJoCo", "teacher": "in the reference simulator"}
SURGE = {"MJ0": 1.784, "MJ1": 0.996, "MJ4": 0.998}
"""Root mean square errors of the surge velocity in Table III of the paper [m/s]."""
NEAR = 0.1
"""Relative difference from the paper's figure below which a figure counts as reproduced."""
TRAININGS = "recipe sac, kernels, networks from the bundled sample; the paper: SAC in MuJoCo, 857,542 samples"
CAUSES = "possible causes: [Does training diverge?](divergence.md)"
"""Reference to the study of `benchmarks.divergence`."""
SAMPLE = "networks from the bundled sample of 59,914 rows; the paper: 857,542 samples"
Verdict = tuple[str, str, str]
REPRODUCED, NOT_REPRODUCED, WAITING = "reproduced", "not reproduced", "not yet run"


def cell(row: Row) -> str:
    """Return one evaluation in words: arrivals with 95 % interval, time, energy, collisions."""
    low, high = 100.0 * row["success_low"], 100.0 * row["success_high"]
    words = f"{100.0 * row['success']:.3g}% ({low:.1f} to {high:.1f})"
    if row["time_to_goal"] is not None:
        words += f", {row['time_to_goal']:.1f} s, energy {row['energy']:.2g} s"
    return words + (f"; hit {100.0 * row['collision']:.3g}%" if row["collision"] else "")


Continued = Mapping[Path, float]
"""Copies of trainings that went on beyond the budget, with the processor time of the continuation [s]."""


def further(study: paper.Study, continued: Continued) -> list[Run]:
    """Return the continued trainings."""
    runs = {run.folder.name: run for run in paper.runs(study)}
    return [replace(runs[folder.name], folder=folder) for folder in continued]


def trained(study: paper.Study, continued: Continued) -> list[Row]:
    """Return a row for every training: its progress, steps and time."""
    done = paper_tables.trainings(study).to_dicts()
    before = {(row["condition"], row["seed"]): row["processor"] for row in done}
    if continued:
        again = paper_tables.trainings(study, further(study, continued)).to_dicts()
        for row, seconds in zip(again, continued.values(), strict=True):
            spent = before[row["condition"], row["seed"]]
            other = {"condition": f"{row['condition']}, continued", "state": _state(row, study)}
            done.append(row | other | {"processor": None if spent is None else spent + seconds})
    rows, missing = list[Row](), dict[str, list[int]]()
    for row in done:
        made: Row = {"recipe": row["recipe"], "condition": row["condition"], "seed": row["seed"]}
        if row["state"] == NOT_RUN:
            missing.setdefault(row["condition"], []).append(row["seed"])
            continue
        made["result"] = f"{row['state']}, {row['stages']} of {study.stages} stages"
        made |= {"SAC updates": f"{row['updates']:,}", "steps": f"{row['steps']:,}"}
        for stage in range(1, study.stages + 1):
            after = row[f"updates_{stage}"]
            made[f"stage {stage} passed after"] = "" if after is None else f"{after:,}"
        spent = row["processor"]
        made["processor time"] = "" if spent is None else f"{spent:.0f} s"
        rows.append(made | {"divergence": row["diverged"] or "none"})
    for condition, seeds in missing.items():
        made = {"recipe": study.recipe, "condition": condition, "seed": ", ".join(map(str, seeds))}
        rows.append(made | {"result": NOT_RUN})
    return rows


def _state(row: Row, study: paper.Study) -> str:
    """Return the state of a continued training."""
    return PASSED if row["stages"] == study.stages else "stopped"


def cells(rows: Sequence[Row]) -> str:
    """Return evaluations of one task by several policies in words: arrivals of each, and means over all."""
    share = ", ".join(f"{100.0 * row['success']:.3g}" for row in rows)
    words = f"{share}%"
    arrived = [row for row in rows if row["time_to_goal"] is not None]
    if arrived:
        time, energy = (statistics.fmean(row[name] for row in arrived) for name in ("time_to_goal", "energy"))
        words += f"; {time:.1f} s, energy {energy:.2g} s"
    hit = statistics.fmean(row["collision"] for row in rows)
    return words + (f"; hit {100.0 * hit:.3g}%" if hit else "")


def flown(study: paper.Study, counted: dict[str, str], continued: Continued) -> list[Row]:
    """Return a row for every task and condition, and for every task and pilot in the reference simulator.

    Each condition has its trainings in the order of their seeds, and the pilots in its MuJoCo model.
    """
    tests = [row | {"by": f"policies, {row['condition']}"} for row in paper_tables.flights(study).to_dicts()]
    if continued:
        again = paper_tables.flights(study, further(study, continued)).filter(flown_by="policy")
        tests += [row | {"by": f"policy, {row['condition']}, continued"} for row in again.to_dicts()]
    groups = dict[tuple[str, ...], list[Row]]()
    for row in sorted(tests, key=lambda row: row["seed"]):
        who = row["by"] if row["flown_by"] == "policy" else row["flown_by"]
        condition = row["condition"] if row["flown_by"] != "policy" and row["plant"] != "teacher" else ""
        groups.setdefault((row["task"], who, row["plant"], condition), []).append(row)
    rows = list[Row]()
    for task in dict.fromkeys(row["task"] for row in tests):
        level = counted.get(task, "")
        each = [row for row in tests if row["task"] == task]
        title = task.replace("_", " ") + (f", {each[0]['level']} {level}" if level else "")
        for who in dict.fromkeys(row["by"] for row in each if row["flown_by"] == "policy"):
            flights = {plant: groups.get((task, who, plant, "")) for plant in PLACES}
            known = next(made for made in flights.values() if made)
            condition, updates = known[0]["condition"], [row["updates"] for row in known]
            among = f"{min(updates):,}" + (f" to {max(updates):,}" if max(updates) > min(updates) else "")
            made: Row = {"task": title, "flown by": who, "recipe": known[0]["recipe"], "SAC updates": among}
            made |= {
                words: cells(flights[plant] or []) if flights[plant] else ""
                for plant, words in PLACES.items()
            }
            for pilot, words in (("helmsman", "pilot"), ("helmsman with map", "pilot with map")):
                alike = groups.get((task, pilot, "student", condition))
                made[f"{words}, in MuJoCo"] = cell(alike[0]) if alike else ""
            rows.append(made)
        for pilot in dict.fromkeys(row["flown_by"] for row in each if row["flown_by"] != "policy"):
            if alike := groups.get((task, pilot, "teacher", "")):
                said = {"task": title, "flown by": pilot, "recipe": "none", PLACES["teacher"]: cell(alike[0])}
                rows.append(said)
    return rows


def compared(study: paper.Study) -> list[Row]:
    """Return the differences of arrival rates between conditions, in percentage points, by simulator."""
    tests = paper_tables.flights(study)
    found = paper_tables.differences(tests) if len(tests) else tests
    rows: dict[tuple[str, str], Row] = {}
    for row in found.to_dicts():
        task, difference = row["task"].replace("_", " "), f"{row['condition']} - {row['compared_with']}"
        made = rows.setdefault((task, difference), {"task": task, "difference": difference})
        low, high = 100.0 * row["low"], 100.0 * row["high"]
        made[PLACES[row["plant"]]] = f"{100.0 * row['difference']:+.0f} ({low:.0f} to {high:.0f})"
        made["trainings"] = f"{row['seeds']} and {row['compared_seeds']}"
    return list(rows.values())


def errors(study: paper.Study) -> list[Row]:
    """Return Tables II and III with the paper's surge errors, as far as they were run."""
    offline, replayed = paper_tables.networks(study)
    rows: list[Row] = [
        {"table": "II, wrench", "protocol": row["protocol"], "model": row["model"]}
        | {"RMSE": f"{row['RMSE']:.2f}", "MAE": f"{row['MAE']:.2f}", "mean R2": f"{row['R2']:.4f}"}
        for row in offline.to_dicts()
    ]
    seen = set[tuple[str, ...]]()
    for row in replayed.to_dicts():
        alone = not row["variant"].startswith(("MJ1", "MJ2", "MJ3", "MJ4", "moe"))
        key = (
            (row["variant"],)
            if alone
            else (row["variant"], *map(str, (row["protocol"], row["conditioning"], row["lead"])))
        )
        if key in seen:
            continue
        seen.add(key)
        made: Row = {
            "table": "III, replay",
            "protocol": "" if alone else row["protocol"],
            "model": row["variant"],
        }
        if not alone:
            made |= {"conditioning": row["conditioning"], "lead": f"{row['lead']:g}"}
        made |= {axis: "diverged" if row[axis] is None else f"{row[axis]:.3f}" for axis in "uvwpqr"}
        made["u in the paper"] = f"{SURGE[row['variant']]:.3f}" if row["variant"] in SURGE else ""
        rows.append(made)
    return rows


def claims(study: paper.Study) -> list[Row]:
    """Return the verdict on every claim of the paper, from the tables of the study."""
    done, (offline, replayed) = paper_tables.trainings(study), paper_tables.networks(study)
    ended = done.filter(~pl.col("state").is_in([NOT_RUN, UNFINISHED]))
    found = {
        "The best network offline is not the best in replay (V-A, V-B)": _ranking(offline, replayed),
        "R_0 converges fastest (V-C)": _fastest(done),
        "R_MLP diverges in all runs (V-C)": _diverges(done),
        "R_PhysFeat trains stably (V-C)": _stable(done),
        "R_PhysFeat achieves the best task performance of the three (V-C)": _best(
            paper_tables.flights(study)
        ),
        "Learned hydrodynamics reduces the surge error to 0.996 m/s (Table III)": _surge(replayed),
    }
    rows: list[Row] = []
    for claim, (verdict, words, other) in found.items():
        if other == TRAININGS and verdict != WAITING and len(ended) < len(done):
            verdict += f" so far ({len(ended)} of {len(done)} trainings have ended)"
        rows.append(
            {"claim of the paper": claim, "verdict": verdict, "result here": words, "deviation": other}
        )
    return rows


def _ranking(offline: pl.DataFrame, replayed: pl.DataFrame) -> Verdict:
    """Compare the best network offline with the best in replay, by protocol."""
    if offline.is_empty() or replayed.is_empty():
        return WAITING, "", SAMPLE
    from hydro.sim.replay import PAPER_NAMES

    same, words = [], []
    plain = replayed.filter(pl.col("conditioning") == "off", pl.col("lead") == 0.0).drop_nulls("u")
    for protocol in offline["protocol"].unique(maintain_order=True):
        predicted = offline.filter(protocol=protocol).sort("RMSE")["model"].to_list()
        names = {PAPER_NAMES.get(name, name): name for name in predicted}
        flights = plain.filter(pl.col("protocol") == protocol, pl.col("variant").is_in(list(names)))
        if flights.is_empty() or len(predicted) < 2:
            continue
        ranked = flights.with_columns(all=pl.mean_horizontal(*(pl.col(a) ** 2 for a in "uvwpqr"))).sort("all")
        best = names[ranked["variant"][0]]
        same.append(best == predicted[0])
        words.append(
            f"protocol {protocol}: best offline {predicted[0]}, best in replay {best}, of {len(predicted)}"
        )
    if not same:
        return WAITING, "", SAMPLE
    return (NOT_REPRODUCED if all(same) else REPRODUCED), "; ".join(words), SAMPLE


def _ended(done: pl.DataFrame, condition: str) -> list[Row]:
    """Return the trainings of a condition that are complete."""
    return [
        row
        for row in done.filter(condition=condition).to_dicts()
        if row["state"] not in (NOT_RUN, UNFINISHED)
    ]


def _count(rows: Sequence[Row]) -> str:
    """Return the number of trainings in words."""
    return f"{len(rows)} training" + ("" if len(rows) == 1 else "s")


def _passed(rows: Sequence[Row]) -> int:
    """Return the number of trainings that passed all stages."""
    return sum(row["state"] == PASSED for row in rows)


def _updates(count: float) -> str:
    """Return a number of updates in words; infinite if the stage was not passed."""
    return "more than the budget" if count == math.inf else f"{count:,.0f} updates"


def _fastest(done: pl.DataFrame) -> Verdict:
    """Compare the SAC updates until stage 1 was passed."""
    first = {
        name: [row["updates_1"] for row in _ended(done, name)]
        for name in done["condition"].unique(maintain_order=True)
    }
    medians = {
        name: statistics.median([math.inf if each is None else each for each in found])
        for name, found in first.items()
        if found
    }
    bases = [name for name in ("R_0+M_A", "R_0") if name in medians]
    words = "; ".join(
        f"{name}: stage 1 after {_updates(value)} (median of {len(first[name])})"
        for name, value in medians.items()
    )
    if not bases or len(medians) == len(bases):
        return WAITING, words, TRAININGS
    others = [value for name, value in medians.items() if name not in bases]
    fastest = all(medians[base] < min(others) for base in bases)
    return (REPRODUCED if fastest else NOT_REPRODUCED), words, TRAININGS


def _diverges(done: pl.DataFrame) -> Verdict:
    """Count the trainings of R_MLP that diverged."""
    rows = _ended(done, "R_MLP")
    if not rows:
        return WAITING, "", TRAININGS
    bad = [row for row in rows if row["diverged"]]
    words = f"{len(bad)} of {_count(rows)} diverged; {_passed(rows)} passed all stages; {CAUSES}"
    return (REPRODUCED if len(bad) == len(rows) else NOT_REPRODUCED), words, TRAININGS


def _stable(done: pl.DataFrame) -> Verdict:
    """Count the trainings of R_PhysFeat that did not diverge."""
    rows = _ended(done, "R_PhysFeat")
    if not rows:
        return WAITING, "", TRAININGS
    good = [row for row in rows if not row["diverged"]]
    words = f"{len(good)} of {_count(rows)} without divergence; {_passed(rows)} passed all stages"
    return (REPRODUCED if len(good) == len(rows) else NOT_REPRODUCED), words, TRAININGS


def _best(tests: pl.DataFrame) -> Verdict:
    """Compare the arrivals of the conditions of the paper, each in its own MuJoCo model."""
    if tests.is_empty():
        return WAITING, "", TRAININGS
    own = tests.filter(pl.col("flown_by") == "policy", pl.col("plant") == "student")
    means = {
        row["condition"]: row["success"]
        for row in own.group_by("condition", maintain_order=True).agg(pl.col("success").mean()).to_dicts()
        if row["condition"] in ("R_0", "R_0+M_A", "R_MLP", "R_PhysFeat")
    }
    words = "arrivals over all tasks in MuJoCo: " + ", ".join(f"{k} {v:.0%}" for k, v in means.items())
    if not {"R_MLP", "R_PhysFeat"} < set(means):
        return WAITING, words, TRAININGS
    best = max(means, key=means.__getitem__) == "R_PhysFeat"
    return (REPRODUCED if best else NOT_REPRODUCED), words, TRAININGS


def _surge(replayed: pl.DataFrame) -> Verdict:
    """Find the replay of the baseline MLP whose surge error is nearest to the paper's."""
    found = [] if replayed.is_empty() else replayed.filter(variant="MJ1").drop_nulls("u").to_dicts()
    if not found:
        return WAITING, "", SAMPLE
    nearest = min(found, key=lambda row: abs(row["u"] - SURGE["MJ1"]))
    low = min(row["u"] for row in found)
    words = (
        f"nearest: {nearest['u']:.3f} m/s with conditioning {nearest['conditioning']}, lead "
        f"{nearest['lead']:g}, protocol {nearest['protocol']}; smallest: {low:.3f} m/s"
    )
    near = abs(nearest["u"] - SURGE["MJ1"]) <= NEAR * SURGE["MJ1"]
    return (REPRODUCED if near else NOT_REPRODUCED), words, SAMPLE


def study_of(given: argparse.Namespace) -> paper.Study:
    """Return the settings of the study in a folder, as its command in `COMMANDS` has them."""
    data = Path("datasets/stonefish")
    found = paper.Study(
        given.folder, data / "sample.parquet", data / "replay90.parquet", data / "vehicle.toml",
        Path("benchmarks/paper_given.toml"), epochs=60, episodes=given.episodes,
    )  # fmt: skip
    if given.recipe == "sac":
        return found
    conditions = ("R_PhysFeat", "R_MLP", "R_0")
    return replace(
        found, given=None, networks=("mlp", "physfeat"), conditions=conditions, recipe="paper", stages=1,
        steps=500_000, seeds=3,
    )  # fmt: skip


def main() -> None:
    from hydro.rl.tasks.registry import TASKS

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of a study")
    parser.add_argument("--commit", required=True, help="commit of the measured code")
    parser.add_argument("--recipe", choices=list(COMMANDS), default="sac", help="recipe of the trainings")
    parser.add_argument("--command", help="command of the study, if it is another than that of the recipe")
    parser.add_argument("--networks", help="command of the tables of networks, if it is another")
    parser.add_argument(
        "--continued",
        nargs="*",
        default=[],
        metavar="FOLDER=SECONDS",
        help="copies of trainings with more steps, and the processor time of the continuation",
    )
    parser.add_argument("--episodes", type=int, default=50, help="episodes of each test")
    given = parser.parse_args()
    study = study_of(given)
    pairs = (one.rpartition("=") for one in given.continued)
    continued = {Path(folder): float(seconds) for folder, _, seconds in pairs}
    counted = {name: task.levels for name, task in TASKS.items() if task.levels}
    begun = paper_tables.trainings(study).filter(pl.col("state") != NOT_RUN)
    where = origin(begun, given.command or COMMANDS[given.recipe], given.commit)
    kept = {"paper_rl": trained(study, continued), "paper_flights": flown(study, counted, continued)}
    if given.recipe == "paper":
        kept = {name.replace("paper_", "paper_recipe_"): rows for name, rows in kept.items()}
    else:
        kept |= {
            "paper_differences": compared(study),
            "paper_networks": errors(study),
            "paper_claims": claims(study),
        }
    for name, rows in kept.items():
        if rows:
            made_by = {"command": given.networks} if given.networks and name == "paper_networks" else {}
            keep(name, [row | where | made_by for row in rows])


if __name__ == "__main__":
    main()
