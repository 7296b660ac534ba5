"""Effect of posterior randomisation on the robustness of policies in other vehicles.

All policies use `--recipe imitation`.  They are trained either on the values of a vehicle file, or with each
episode's vehicle drawn from the covariance of the fit (`--randomise posterior`).  The test is the forest,
in vehicles drawn from that covariance.  A second test is the reference simulator to which the file was
fitted, as it is and with a current, a payload or a dead thruster.  Expert pilots with and without a map run
all tests too.

    # Record one minute:
    hydro collect --vehicle datasets/vehicles/auv151.toml --rows 3000 --seed 44 --noise dvl -o minute.parquet
    # Fit a vehicle file with its covariance:
    hydro fit datasets/vehicles/auv151.toml minute.parquet --effect added_mass --effect linear_damping
        --effect quadratic_damping -o fitted.toml
    # Train, test, and keep the results:
    python -m benchmarks.posterior run fitted.toml -o posterior
    python -m benchmarks.posterior keep posterior --commit COMMIT
"""

from __future__ import annotations

import argparse
from pathlib import Path

import polars as pl

from benchmarks.commands import made, parser, place
from benchmarks.kept_tables import Row, keep, origin
from benchmarks.policies import POLICY, arrivals, of_seeds
from hydro.io import table

TRAINED = {"its values": (), "its posterior": ("--randomise", "posterior")}
"""Options of trainings on each distribution of vehicles."""
RECIPE = ("--recipe", "imitation", "--stages", "3", "--steps", "2000000")
FLOWN = {
    "student, drawn": ("student", ("posterior",)),
    "teacher": ("teacher", ("nominal", "current", "load", "dead_thruster")),
}
"""Simulator and settings of each group of flights."""


def run(chosen: argparse.Namespace) -> None:
    """Train and fly the missing runs, seed by seed."""
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
        for name, options in TRAINED.items():
            folder = place(chosen.out, name, seed)
            made(("rl", "train", chosen.vehicle, *RECIPE, "--seed", str(seed), *options), folder)
            for plant, settings in FLOWN.values():
                wanted = [word for one in settings for word in ("--setting", one)]
                pilot = "--pilot" if seed == chosen.first_seed and not options else "--no-pilot"
                line = ("rl", "eval", folder, "--stage", "3", "--in", plant, *wanted, pilot)
                out = chosen.out / f"{folder.name}-{plant}.parquet"
                made((*line, "--episodes", str(chosen.episodes)), out)


def flights(folder: Path) -> list[Row]:
    """Return every evaluation of a study, with the vehicles that its policy was trained with."""
    rows = []
    for name in TRAINED:
        for path in sorted(folder.glob(f"{place(Path(), name, '*')}.parquet")):
            for row in table.read(path, "evaluations").frame.to_dicts():
                rows.append(row | {"trained": name if row["flown_by"] == POLICY else ""})
    return rows


def by_flyer(found: list[Row]) -> list[Row]:
    """Return a row for each pilot and kind of training: the median training and all, by test."""
    places: dict[str, dict[str, list[Row]]] = {}
    for row in found:
        who = f"policy trained on {row['trained']}" if row["trained"] else str(row["flown_by"])
        place = f"{row['plant']}, {row['setting'].replace('_', ' ')}"
        rows = places.setdefault(who, {}).setdefault(place, [])
        if row["trained"] or not rows:  # repeated flights of a pilot are identical
            rows.append(row)
    return [
        {"flown by": who} | {place: ", ".join(arrivals(of_seeds(rows))) for place, rows in each.items()}
        for who, each in places.items()
    ]


def kept(chosen: argparse.Namespace) -> None:
    """Write the results table of a study."""
    found = flights(chosen.folder)
    trained = sorted({row["seed"] for row in found if row["trained"]})
    command = "python -m benchmarks.posterior run fitted.toml -o posterior"
    where = origin(pl.DataFrame({"seed": trained}), command, chosen.commit)
    keep("rl_posterior", [row | where for row in by_flyer(found)])


def main() -> None:
    whole, runs = parser(__doc__.splitlines()[0], run, kept, seeds=5)
    runs.add_argument("vehicle", type=Path, help="vehicle file with the covariance of a fit")
    runs.add_argument("--episodes", type=int, default=100)
    chosen = whole.parse_args()
    chosen.what(chosen)


if __name__ == "__main__":
    main()
