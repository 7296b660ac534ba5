"""Ablation of `--recipe imitation` for soft actor-critic: stage 1, with one choice reverted at a time.

No behaviour cloning and no corrections are used.  The policy learns by rewards alone, from the expert pilot's
flights in half of every batch, and is evaluated every 5,000 steps.

    python -m benchmarks.ablations run -o ablations
    python -m benchmarks.ablations keep ablations --commit COMMIT

Every training is an ordinary command in its own folder; the same line continues an earlier run.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import polars as pl

from benchmarks.commands import made, parser, place, ranged, seconds
from benchmarks.kept_tables import Row, keep, origin
from benchmarks.policies import passed_exams
from hydro.io import table

VEHICLE = Path("datasets/vehicles/auv151.toml")
STEPS = 200_000
PLAIN = ("clone=0", "corrections=0", "lessons=0", "curriculum.examine=5000", "sac.random=1000")
VARIANTS: dict[str, tuple[str, ...]] = {
    "all of it": (),
    "without demonstrations": ("demonstrations=0",),
    "without layer normalisation": ("sac.norm=false",),
    "256 wide, not 128": ("sac.layers=[256,256]",),
    "batches of 512, not 256": ("sac.batch=512",),
    "none of it": ("demonstrations=0", "sac.norm=false", "sac.layers=[256,256]", "sac.batch=512"),
}
"""Reverted choices, in words and as options."""


def line(choices: Sequence[str], seed: int | str) -> list[str]:
    """Return the words of the command that runs one training, without `hydro`.

    Args:
        choices: Changed settings, each `NAME=VALUE`.
        seed: Seed of the training.
    """
    chosen = [word for choice in (*PLAIN, *choices) for word in ("--set", choice)]
    return ["rl", "train", str(VEHICLE), "--recipe", "imitation", "--stages", "1", "--steps", str(STEPS),
            "--seed", str(seed), *chosen]  # fmt: skip


def run(chosen: argparse.Namespace) -> None:
    """Run the missing trainings one after another."""
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
        for name, choices in VARIANTS.items():
            made(line(choices, seed), place(chosen.out, name, seed))


def training(folder: Path) -> tuple[int | None, float]:
    """Return the number of steps until a training passed, None if it did not, and its processor time [s]."""
    found = table.read(folder / "evaluations.parquet", "evaluations").frame
    passed = passed_exams(found)["steps"]
    return (int(passed.to_list()[0]) if len(passed) else None), seconds(folder)


def row(name: str, found: Sequence[tuple[int | None, float]]) -> Row:
    """Return the medians of the trainings of one variant, with minimum and maximum.

    Args:
        name: Name of the variant.
        found: Steps until each training passed, and its processor time [s].
    """
    passed = sum(one is not None for one, _ in found)
    return {
        "learnt with": name,
        "passed": f"{passed} of {len(found)}",
        "steps until then": ranged([STEPS if one is None else one for one, _ in found], ",.0f"),
        "processor time": ranged([seconds / 60.0 for _, seconds in found], ".1f", " min"),
    }


def kept(chosen: argparse.Namespace) -> None:
    """Write the results table of a folder of trainings."""
    rows, seeds = [], set[int]()
    for name in VARIANTS:
        folders = [path.with_suffix("") for path in chosen.folder.glob(f"{place(Path(), name, '*')}.time")]
        seeds |= {int(path.name.rpartition("-")[2]) for path in folders}
        if folders:
            rows.append(row(name, [training(path) for path in folders]))
    command = f"python -m benchmarks.ablations run -o ablations; hydro {' '.join(line((), 'SEED'))} -o RUN"
    where = origin(pl.DataFrame({"seed": sorted(seeds)}), command, chosen.commit)
    keep("rl_ablations", [one | where for one in rows])


def main() -> None:
    whole, _ = parser(__doc__.splitlines()[0], run, kept, seeds=3)
    chosen = whole.parse_args()
    chosen.what(chosen)


if __name__ == "__main__":
    main()
