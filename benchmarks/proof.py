"""Tables of `hydro study proof`: a second change, rival methods on the held-out log, and the kept results.

    # Record a stronger change in the reference simulator:
    python -m benchmarks.proof make strong
    # Run the studies.
    hydro study proof -o proof
    hydro study proof strong/log.parquet --vehicle strong/vehicle.toml --before strong/before.parquet
        --holdout strong/heldout.parquet --truth strong/true.toml -o proof-strong
    # Run the rivals on the log of a study; each is run once.
    python -m benchmarks.proof rivals proof
    # Keep the tables of several studies, and draw the figure.
    python -m benchmarks.proof keep COMMIT "Stonefish, thruster 3 at 60 %=proof" "TITLE=proof-strong"
    # Test policies that were trained in the file as given with other changes, and keep the table.
    python -m benchmarks.proof changes COMMIT proof

A rival whose package is not installed is kept with that reason instead of an error.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
from pathlib import Path
from typing import Any

import polars as pl

from benchmarks.kept_tables import Row, keep, origin
from benchmarks.rivals.contest import answer_of
from hydro import cli
from hydro.core.evaluation.replay_error import Ahead
from hydro.io import table
from hydro.io import vehicle as vehicles
from hydro.io.files import bundled
from hydro.report.words import percent
from hydro.study import proof, proof_tables
from hydro.study.proof import Study
from hydro.study.steps import LEDGER

STRONG: dict[str, Any] = {"name": "net_buoyancy", "dB": -250.0}
"""Second change: 250 N less buoyancy, as of 25 kg of water in a housing.  It was chosen among CHANGES,
because policies that were trained without it miss most goals, and the pilot misses none."""
HIDDEN = "net_buoyancy={dB=-250}"
"""The same as an option of `hydro collect`."""
ROWS = {"before": 9_000, "log": 4_500, "heldout": 2_000}
"""Rows at 50 Hz of the recordings of the second change."""
SEEDS = {"before": 11, "log": 12, "heldout": 13}
"""Seeds of these recordings."""
EPISODES = 50
"""Tasks of each test with another change, the first of those of the study."""
RESULTS = "rivals.json"
"""File of a study's folder with the errors of the rivals."""
COMMAND = "hydro study proof -o proof"


RIVALS = {
    "PySINDy": "sindy",
    "residual network": "residual_network",
    "scipy output error": "output_error",
    "mujoco.sysid": "mujoco_sysid",
}
"""Modules of methods in addition to those of `hydro study proof`, the quickest first."""


def gains(**left: float) -> dict[str, Any]:
    """Return the effect of thrusters that deliver a share of their thrust, given by name, T1 to T8."""
    return {"name": "thruster_gain", "g": [left.get(f"T{i + 1}", 1.0) - 1.0 for i in range(8)]}


def current(speed: float) -> dict[str, Any]:
    """Return the effect of a current to the north-east with a speed [m/s]."""
    part = round(speed / 2**0.5, 4)
    return {"name": "ocean_current", "v_N": part, "v_E": part, "v_D": 0.0}


CHANGES: dict[str, dict[str, Any]] = {
    "thruster 3 dead": gains(T3=0.0),
    "thrusters 1 and 3 (port) at 20 %": gains(T1=0.2, T3=0.2),
    "current 0.6 m/s": current(0.6),
    "150 N less buoyancy": STRONG | {"dB": -150.0},
    "250 N less buoyancy": STRONG,
}
"""Changes that policies are tested with which were trained in the file as given."""


def make(folder: Path) -> None:
    """Record the second change in the reference simulator, and write its vehicle files."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(bundled("changed") / "vehicle.toml", folder / "vehicle.toml")
    text = vehicles.set_effect((folder / "vehicle.toml").read_text(), STRONG)
    vehicles.write(text, folder / "true.toml")
    for name, rows in ROWS.items():
        line = ["collect", "--vehicle", str(folder / "vehicle.toml"), "--rows", str(rows)]
        line += ["--seed", str(SEEDS[name]), "--noise", "ordinary"]
        line += [] if name == "before" else ["--hide", HIDDEN]
        if cli.main([*line, "-o", str(folder / f"{name}.parquet")]):
            raise SystemExit(f"benchmarks.proof: {name} was not recorded")


def study_of(folder: Path) -> Study:
    """Return the settings of a study from the command lines of its ledger."""
    ledger = json.loads((folder / LEDGER).read_bytes())
    words = next(line for line in ledger if line.startswith("explain ")).split()
    truth = next(line for line in ledger if line.startswith("compare ")).split()[1]
    trained = [line.split() for line in ledger if line.startswith("rl train ")]
    steps = {int(line[line.index("--steps") + 1]) for line in trained} or {Study.steps}
    before = Path(words[words.index("--before") + 1]) if "--before" in words else None
    places = (Path(words[1]), Path(words[2]), Path(words[words.index("--holdout") + 1]), Path(truth))
    return Study(folder, *places, before=before, steps=max(steps))


def rivals(folder: Path) -> None:
    """Run the rival methods that a study has no result of, and write their errors into its folder."""
    study, path = study_of(folder), folder / RESULTS
    known = json.loads(path.read_text()) if path.is_file() else {}
    given = vehicles.read(study.vehicle)[0]
    log, held = (table.read(one, "raw").frame for one in (study.log, study.holdout))
    errors = Ahead(held, given)
    for name, module in RIVALS.items():
        if name in known:
            continue
        begun = time.process_time()
        try:
            found = answer_of(module)(given, log)
            known[name] = {"error": found.error(errors, held), "named": found.name}
        except ImportError as missing:
            known[name] = {"missing": f"not installed: {missing.name}"}
        known[name]["seconds"] = time.process_time() - begun
        path.write_text(json.dumps(known, indent=1))
        print(name, known[name], flush=True)


def errors_of(title: str, study: Study) -> list[Row]:
    """Return the rows of the held-out errors of a study and of the rivals."""
    rows: list[Row] = [
        {"change": title, "method": row["method"], "error [m/s]": f"{row['error']:.4g}", "note": ""}
        for row in proof_tables.errors(study).iter_rows(named=True)
    ]
    path = study.folder / RESULTS
    known = json.loads(path.read_text()) if path.is_file() else {}
    for name in RIVALS:
        one = known.get(name, {"missing": "not run"})
        error = f"{one['error']:.4g}" if "error" in one else ""
        note = one.get("missing") or (f"names {one['named']}" if one["named"] else "names nothing")
        rows.append({"change": title, "method": name, "error [m/s]": error, "note": note})
    return rows


def named_of(title: str, study: Study) -> list[Row]:
    """Return the rows of the found and the true values of a study."""
    found = proof_tables.named(study, proof.chosen(study))
    return [
        {"change": title, "value": row["value"]}
        | {key: "" if row[key] is None else f"{row[key]:.4g}" for key in ("given", "found", "low", "high")}
        | {"true": f"{row['true']:.4g}"}
        for row in found.iter_rows(named=True)
    ]


def flights_of(title: str, study: Study) -> list[Row]:
    """Return the rows of a study's flights: one per policy and vehicle, and those of the pilot.

    Seeds that were not run share one row.
    """
    flights = proof_tables.flights(study)
    rows: list[Row] = []
    for file, vehicle in dict.fromkeys((run.file, flown) for run in study.runs for flown in run.tests):
        head = {"change": title, "flown by": "policy", "trained": file, "vehicle": vehicle}
        known = flights.filter(flown_by="policy", file=file, vehicle=vehicle).to_dicts()
        rows += [head | {"seed": str(row["seed"])} | _flown(row) for row in known]
        left = sorted(set(range(study.seeds)) - {row["seed"] for row in known})
        if left:
            rows.append(head | {"seed": ", ".join(map(str, left)), "result": "not run"})
    for one in flights.filter(pl.col("flown_by") != "policy").iter_rows(named=True):
        row = {"change": title, "flown by": one["flown_by"], "vehicle": one["vehicle"]}
        rows.append(row | _flown(one) | {"SAC updates": ""})
    return rows


def _flown(row: dict[str, Any]) -> Row:
    """Return the cells of tested flights."""
    return {
        "result": "flown",
        "SAC updates": f"{row['updates']:,}",
        "episodes": str(row["episodes"]),
        "arrived": f"{row['success']:.3g}",
        "low": f"{row['success_low']:.3f}",
        "high": f"{row['success_high']:.3f}",
    }


def changed(study: Study, number: int, effect: dict[str, Any], actor: Path) -> dict[str, Any]:
    """Return the result of flights with a change; they are flown once and then read.

    Args:
        study: The study.
        number: Number of the change.
        effect: Table of the change.
        actor: Folder of a policy's training, or a vehicle file, which the pilot flies.
    """
    folder = study.folder / "changes"
    folder.mkdir(exist_ok=True)
    truth, out = folder / f"{number}.toml", folder / f"{number}-{actor.stem}.parquet"
    text = study.vehicle.read_text()
    vehicles.write(vehicles.set_effect(text, effect), truth)
    if not out.is_file():
        line = ["rl", "eval", str(actor), "--task", proof.TASK, "--level", str(proof.LEVEL)]
        line += ["--in", "teacher", "--truth", str(truth), "--episodes", str(EPISODES)]
        line += [] if actor == study.vehicle else ["--last", "--no-pilot"]
        if cli.main([*line, "-o", str(out)]):
            raise SystemExit(f"benchmarks.proof: {actor} was not tested")
    return table.read(out, "evaluations").frame.row(0, named=True)


def changes(commit: str, folder: Path) -> None:
    """Fly the pilot and the policies of a study under each of CHANGES, and keep the shares of arrivals.

    Args:
        commit: Commit of the measured code, kept with the table.
        folder: Folder of the study.
    """
    study = study_of(folder)
    policies = {run.seed: run.folder for run in study.runs if run.file == proof.BEFORE}
    rows: list[Row] = []
    for number, (title, effect) in enumerate(CHANGES.items()):
        row: Row = {"change": title}
        flown = [changed(study, number, effect, one) for one in (study.vehicle, *policies.values())]
        shares = [percent(one["success"]) for one in flown]
        row |= dict(zip(("pilot", *(f"policy, seed {seed}" for seed in policies)), shares, strict=True))
        mean = sum(one["success"] for one in flown[1:]) / len(policies)
        rows.append(row | {"mean of the policies": percent(mean)})
    seeds = pl.DataFrame({"seed": list(policies)})
    where = origin(seeds, "python -m benchmarks.proof changes COMMIT proof", commit)
    keep("proof_changes", [row | where for row in rows])


def keeps(commit: str, named: dict[str, Path]) -> None:
    """Write the kept tables of studies, given by title."""
    studies = {title: study_of(folder) for title, folder in named.items()}
    last = max(study.seeds for study in studies.values()) - 1
    where = origin(pl.DataFrame({"seed": [0, last]}), COMMAND, commit)
    for name, rows in (("proof_errors", errors_of), ("proof_named", named_of), ("proof_flights", flights_of)):
        kept = [row | where for title, study in studies.items() for row in rows(title, study)]
        keep(name, kept)


def main() -> None:
    top = argparse.ArgumentParser(
        prog="python -m benchmarks.proof",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = top.add_subparsers(required=True, dest="command")
    commands.add_parser("make", help="record the second change").add_argument("folder", type=Path)
    commands.add_parser("rivals", help="run the rivals of a study").add_argument("folder", type=Path)
    kept = commands.add_parser("keep", help="keep the tables of studies")
    kept.add_argument("commit", help="commit of the measured code")
    kept.add_argument("studies", nargs="+", metavar="TITLE=FOLDER")
    others = commands.add_parser("changes", help="test the policies of a study with other changes")
    others.add_argument("commit", help="commit of the measured code")
    others.add_argument("folder", type=Path)
    chosen = top.parse_args()
    if chosen.command == "keep":
        parts = (one.rpartition("=") for one in chosen.studies)
        keeps(chosen.commit, {title: Path(folder) for title, _, folder in parts})
    elif chosen.command == "changes":
        changes(chosen.commit, chosen.folder)
    else:
        {"make": make, "rivals": rivals}[chosen.command](chosen.folder)


if __name__ == "__main__":
    main()
