"""Detection of changes over simulated histories: found in time, dated, and no alarms without a change.

A history is one of five hulls (three simulated from their files with a wrong damping, two with panel
hulls that no file describes) with one change, or none:

    abrupt    one thruster loses 20 % of its thrust, or the drag of one axis grows by 20 %, between two dives;
    gradual   the drag of one axis grows by 3 % of its first value with each dive from some dive on;
    none      nothing changes.

Every dive has its own demands, heading and noise.  A results file grows by one history at a time; the same
command continues an earlier run.  Seeds below 10,000 are for development.  `write` makes
benchmarks/results/track.csv.

    # Simulate and estimate:
    python -m benchmarks.track run --histories 50 --dives 30 --seconds 300 --first-seed 90000 -o track.parquet
    # Report, and keep the table:
    python -m benchmarks.track report track.parquet
    python -m benchmarks.track write track.parquet --commit 1234567
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.hidden_effects import flights, vehicles
from benchmarks.kept_tables import Row, keep, markdown, origin
from benchmarks.shares import rate
from benchmarks.work import Results, add_workers, done
from hydro.core.columns import DOF
from hydro.core.effects.sums import damping_in_sum
from hydro.core.errors import DataError
from hydro.core.history.baseline import learn_baseline
from hydro.core.history.estimate import estimate
from hydro.core.history.history import history
from hydro.core.vehicle.description import Vehicle

HULLS = (
    ("auv151", "simulate"),
    ("bluerov2_heavy", "simulate"),
    ("stonefish", "simulate"),
    ("auv151", "panels"),
    ("bluerov2_heavy", "panels"),
)
KINDS = ("abrupt", "abrupt", "none", "gradual", "none")
"""Kind of the history of each seed in turn: two fifths abrupt, one fifth gradual, two fifths unchanged."""
BASELINE = 4
SESSIONS = 5
"""Number of sessions of a dive, each with a demand of its own."""
ABRUPT, GRADUAL = 0.2, 0.03
"""Size of an abrupt change, and of a gradual one per dive [1]."""
IN_TIME, CLOSE = 2, 1
"""Number of dives after a change within which it counts as found in time, and greatest error of its date."""
DEPTH, NOISE = 20.0, 1.0
"""Depth of the dives [m], and sensor noise in units of the ordinary one."""

SCHEMA: dict[str, Any] = {
    **{"seed": pl.Int64, "hull": pl.String, "source": pl.String, "kind": pl.String, "dives": pl.Int64},
    **{"seconds": pl.Float64, "parameter": pl.String, "date": pl.Int64, "found": pl.Int64},
    **{"dated": pl.Int64, "before": pl.Float64, "after": pl.Float64, "named": pl.String},
    **{"false_alarms": pl.Int64, "unchanged_dives": pl.Int64, "undetermined": pl.String},
    **{"cpu": pl.Float64, "cpu_baseline": pl.Float64, "failure": pl.String},
}
"""Columns of a results file, one row per history.

`date` is the first dive with the change, `found` the dive that raised the alarm on its parameter and `dated`
the stated date, all from 0.  `unchanged_dives` are the dives after the baseline and before the change.  `cpu`
is the processor time of an estimate of one dive [s], `cpu_baseline` that of learning the baseline [s].
"""


@dataclass(frozen=True)
class Case:
    """One history.

    Attributes:
        seed: Seed of everything random in the history.
        hull: Name of the vehicle.
        source: `simulate` or `panels`.
        kind: `abrupt`, `gradual` or `none`.
        parameter: Changed parameter by its name in `hydro track`; empty without a change.
        date: First dive with the change, from 0; the number of dives without a change.
        dives: Number of dives.
        seconds: Length of each dive [s].
    """

    seed: int
    hull: str
    source: str
    kind: str
    parameter: str
    date: int
    dives: int
    seconds: float

    @classmethod
    def of(cls, seed: int, dives: int, seconds: float) -> Case:
        """Draw the history of a seed."""
        rng = np.random.default_rng([seed, 1])
        hull, source = HULLS[seed % len(HULLS)]
        kind = KINDS[(seed // len(HULLS) + seed) % len(KINDS)]
        count = len(vehicles.preset(hull).thruster)
        thruster, axis = rng.integers(count), rng.integers(3)
        drag = kind == "gradual" or rng.random() < 1.0 / 3.0
        parameter = f"drag_{DOF[axis]}" if drag else f"thrust_{thruster + 1}"
        date = int(rng.integers(BASELINE, max(dives - IN_TIME, BASELINE) + 1))
        if kind == "none":
            return cls(seed, hull, source, kind, "", dives, dives, seconds)
        return cls(seed, hull, source, kind, parameter, date, dives, seconds)

    def size(self, dive: int) -> float:
        """Return the size of the change in a dive, as a share of the unchanged value."""
        if dive < self.date or self.kind == "none":
            return 0.0
        return ABRUPT if self.kind == "abrupt" else GRADUAL * (dive - self.date + 1)

    def hidden(self, vehicle: Vehicle, dive: int) -> list[dict[str, Any]]:
        """Return the effects that the change adds in a dive."""
        size = self.size(dive)
        if not size:
            return []
        if self.parameter.startswith("thrust_"):
            gains = np.zeros(len(vehicle.thruster))
            gains[int(self.parameter.removeprefix("thrust_")) - 1] = -size
            return [{"name": "thruster_gain", "g": gains.tolist()}]
        axis = np.eye(6)[DOF.index(self.parameter.removeprefix("drag_"))]
        linear, quadratic, _ = damping_in_sum(vehicle)
        return [
            {"name": "linear_damping", "diagonal": (size * axis * np.diag(linear)).tolist()},
            {"name": "quadratic_damping", "diagonal": (size * axis * quadratic).tolist()},
        ]


def fly(case: Case, exact: Vehicle, dive: int) -> pl.DataFrame:
    """Record one dive of a history."""
    seed = case.seed * 1000 + dive
    rows = [round(case.seconds / SESSIONS / flights.DT)] * SESSIONS
    how: dict[str, Any] = {"rows": rows, "depth": DEPTH, "noise": NOISE, "seed": seed}
    hidden = case.hidden(exact, dive)
    if case.source == "panels":
        return pl.concat(flights.by_teacher(exact, hidden, **how))
    return pl.concat(flights.by_simulate(exact, vehicles.joined(exact, hidden), **how))


def study(seed: int, dives: int, seconds: float) -> Row:
    """Return the row of one history."""
    case = Case.of(seed, dives, seconds)
    row: Row = {
        **{"seed": seed, "hull": case.hull, "source": case.source, "kind": case.kind, "dives": dives},
        **{"seconds": seconds, "parameter": case.parameter, "date": case.date},
    }
    try:
        return row | judged(case)
    except DataError as error:
        return row | {"failure": str(error)}


def judged(case: Case) -> Row:
    """Return the results of one history."""
    exact = vehicles.preset(case.hull)
    given = vehicles.misjudged(exact, np.random.default_rng([case.seed, 2]))
    flown = {f"dive{number}": fly(case, exact, number) for number in range(case.dives)}
    begun, names = time.process_time(), list(flown)[:BASELINE]
    baseline = learn_baseline(given, {name: flown[name] for name in names})
    learnt = time.process_time()
    estimates = {name: estimate(baseline, name, raw) for name, raw in flown.items()}
    ended = time.process_time()
    whole = history(baseline.parameters, estimates, names)
    labels = [one.name for one in whole.parameters]
    right = [one for one in whole.found if labels[one.parameter] == case.parameter and one.found >= case.date]
    wrong = [one for one in whole.found if one.found < case.date]
    first = right[0] if right else None
    return {
        "found": first.found if first else None,
        "dated": first.date if first else None,
        "before": first.before if first else None,
        "after": first.after if first else None,
        "named": first.kind if first else None,
        "false_alarms": len(wrong),
        "unchanged_dives": min(case.date, case.dives) - BASELINE,
        "undetermined": " ".join(one.name for one in whole.undetermined),
        "cpu": (ended - learnt) / len(flown),
        "cpu_baseline": learnt - begun,
    }


def rows_of(results: pl.DataFrame) -> Iterator[Row]:
    """Yield the rows of the kept table: each kind of history on each kind of hull."""
    for (source, kind), one in results.sort("source", "kind", "seed").group_by(
        ["source", "kind"], maintain_order=True
    ):
        good = one.filter(pl.col("failure").is_null())
        late = good["found"] - good["date"]
        off = (good["dated"] - good["date"]).abs()
        changed = kind != "none"
        yield {
            "hulls": "panels" if source == "panels" else "simulated",
            "change": kind,
            "histories": f"{good.height} of {one.height}",
            "dives": f"{good['dives'].min()} of {good['seconds'].min():g} s",
            "found": rate(good["found"].is_not_null()) if changed else "",
            "within two dives": rate((late < IN_TIME).fill_null(value=False)) if kind == "abrupt" else "",
            "date right to one dive": rate((off <= CLOSE).fill_null(value=False)) if changed else "",
            "alarms in unchanged dives": f"{good['false_alarms'].sum()} of {good['unchanged_dives'].sum()}",
            "processor seconds per dive": f"{good['cpu'].median():.1f}",
        }


def run(chosen: argparse.Namespace) -> None:
    """Judge the histories that a results file lacks."""
    results = Results(chosen.output, SCHEMA)
    there = set(results.table["seed"])
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.histories)
    todo = [(seed, chosen.dives, chosen.seconds) for seed in seeds if seed not in there]
    for row in done(study, todo, chosen):
        results.add({name: row.get(name) for name in SCHEMA})
        print(summary_line(row), flush=True)


def summary_line(row: Mapping[str, Any]) -> str:
    """Return the result of one history in one line."""
    changed = f"{row['parameter']} at {row['date']}" if row["parameter"] else "no change"
    outcome = row.get("failure") or f"found {row.get('found')}, dated {row.get('dated')}"
    case = f"{row['seed']} {row['hull']} {row['source']} {row['kind']}"
    return f"{case} {changed}: {outcome}; false alarms {row.get('false_alarms', '-')}"


def write(chosen: argparse.Namespace) -> None:
    """Keep the table of a results file."""
    results = pl.read_parquet(chosen.results)
    count, dives, seconds = results.height, results["dives"].max(), results["seconds"].max()
    command = (
        f"python -m benchmarks.track run --histories {count} --dives {dives} --seconds {seconds:g} "
        f"--first-seed {results['seed'].min()}"
    )
    made = origin(results, command, chosen.commit)
    keep("track", [row | made for row in rows_of(results)])


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    commands = parser.add_subparsers(required=True)
    runs = commands.add_parser("run", help="judge histories and add them to a results file")
    runs.add_argument("--histories", type=int, default=50)
    runs.add_argument("--dives", type=int, default=30)
    runs.add_argument("--seconds", type=float, default=300.0, help="length of each dive")
    runs.add_argument("--first-seed", type=int, required=True)
    runs.add_argument("-o", "--output", type=Path, required=True)
    add_workers(runs)
    runs.set_defaults(action=run)
    reports = commands.add_parser("report", help="print the table as Markdown")
    reports.add_argument("results", type=Path)
    reports.set_defaults(
        action=lambda chosen: print(markdown(list(rows_of(pl.read_parquet(chosen.results)))))
    )
    writes = commands.add_parser("write", help="keep the table in benchmarks/results")
    writes.add_argument("results", type=Path)
    writes.add_argument("--commit", required=True, help="commit that recorded the figures")
    writes.set_defaults(action=write)
    chosen = parser.parse_args(arguments)
    chosen.action(chosen)


if __name__ == "__main__":
    main()
