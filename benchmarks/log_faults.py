"""How often faults of a log are found, and how often one is told where there is none.

    python -m benchmarks.log_faults --studies 60 --first-seed 65300

Flights of `benchmarks.hidden_effects`, in turn with nothing hidden, one effect and something outside the
catalogue, are held to `diagnosis.log_faults` as they are, and once more with each fault planted in them.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.hidden_effects import cases, study
from benchmarks.hidden_effects.scoring import interval
from hydro.core.diagnosis.log_faults import Preprocessed, preprocess

SECONDS = 300.0
KINDS = ("none", "one", "unknown")
DVL = ("u", "v", "w")
Check = Callable[[Preprocessed], bool]
Plant = Callable[[pl.DataFrame, np.random.Generator], tuple[pl.DataFrame, Check]]


def changed(raw: pl.DataFrame, values: dict[str, NDArray[np.float64]]) -> pl.DataFrame:
    return raw.with_columns(pl.Series(name, column) for name, column in values.items())


def reported(*columns: str) -> Check:
    """Whether just these columns are reported."""
    return lambda log: {name for one in log.faults for name in one.members} == set(columns)


def spikes(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """0.3 % of the velocity readings off by half a metre per second or so."""
    size = {name: (rng.random(raw.height) < 0.003) * rng.normal(0.0, 0.5, raw.height) for name in DVL}
    return changed(raw, {name: raw[name].to_numpy() + size[name] for name in DVL}), reported(*DVL)


def dropouts(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """0.5 % of the rows without a velocity, written as 0."""
    kept = rng.random(raw.height) > 0.005
    return changed(raw, {name: raw[name].to_numpy() * kept for name in DVL}), reported(*DVL)


def frozen(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Velocities that stand still for three seconds, once."""
    at = int(rng.integers(500, raw.height - 1000))
    columns = {name: raw[name].to_numpy().copy() for name in DVL}
    for values in columns.values():
        values[at : at + 150] = values[at]
    return changed(raw, columns), reported(*DVL)


def biased(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """A gyro that reads 0.01 rad/s too much or too little about one axis."""
    name = str(rng.choice(["p", "q", "r"]))
    return raw.with_columns(pl.col(name) + 0.01 * rng.choice([-1.0, 1.0])), reported(name)


def exchanged(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Two command columns exchanged."""
    names = [name for name in raw.columns if name.startswith("cmd_")]
    first, second = rng.choice(names, 2, replace=False)
    swapped = raw.with_columns(pl.col(second).alias(first), pl.col(first).alias(second))
    return swapped, lambda log: log.raw.select(names).equals(raw.select(names))


def reversed_(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """One command column reversed."""
    names = [name for name in raw.columns if name.startswith("cmd_")]
    turned = raw.with_columns(-pl.col(str(rng.choice(names))))
    return turned, lambda log: log.raw.select(names).equals(raw.select(names))


PLANTS: tuple[Plant, ...] = (spikes, dropouts, frozen, biased, exchanged, reversed_)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--studies", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=0)
    chosen = parser.parse_args()
    alarms, right = 0, np.zeros(len(PLANTS), int)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.studies):
            case = cases.draw(KINDS[seed % len(KINDS)], seed)
            _, flown = study.flyable(case, SECONDS, Path(folder))
            alarms += bool(preprocess(flown.given, flown.measured).faults)
            for i, plant in enumerate(PLANTS):
                raw, found = plant(flown.measured, np.random.default_rng([seed, i]))
                right[i] += found(preprocess(flown.given, raw))
            done = seed - chosen.first_seed + 1
            print(f"{done}: {alarms} alarms, right {right.tolist()}", flush=True)
    names = [(plant.__doc__ or "").rstrip(".").lower() for plant in PLANTS]
    print("\n| planted | told rightly | 95 % interval |\n| --- | ---: | ---: |")
    for name, hits in zip([*names, "nothing: an alarm"], [*right.tolist(), alarms], strict=True):
        low, high = interval(hits, chosen.studies)
        print(f"| {name} | {hits} of {chosen.studies} | {low:.0%} to {high:.0%} |")


if __name__ == "__main__":
    main()
