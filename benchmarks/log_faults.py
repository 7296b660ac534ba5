"""Detection rate and false alarms of log faults.

    python -m benchmarks.log_faults --studies 60 --first-seed 65300

Flights of `benchmarks.hidden_effects` have no hidden effect, one effect, or an effect outside the catalogue,
in turn.  They are tested by `diagnosis.log_faults` without a fault, and once more with each fault planted in
them.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.hidden_effects import cases, study
from benchmarks.shares import interval
from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis.log_faults import Preprocessed, preprocess
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

SECONDS = 300.0
KINDS = ("none", "one", "unknown")
DVL = ("u", "v", "w")
MOTION = (*POSE, *VELOCITY)
Check = Callable[[Preprocessed], bool]
Plant = Callable[[pl.DataFrame, np.random.Generator], tuple[pl.DataFrame, Check]]


def changed(raw: pl.DataFrame, values: dict[str, NDArray[np.float64]]) -> pl.DataFrame:
    """Return a raw table with the values of some columns replaced."""
    return raw.with_columns(pl.Series(name, column) for name, column in values.items())


def reported(*columns: str) -> Check:
    """Return a check that exactly these columns are reported."""
    return lambda log: {name for one in log.faults for name in one.members} == set(columns)


def spikes(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Plant spikes of about half a metre per second in 0.3 % of the velocity readings."""
    size = {name: (rng.random(raw.height) < 0.003) * rng.normal(0.0, 0.5, raw.height) for name in DVL}
    return changed(raw, {name: raw[name].to_numpy() + size[name] for name in DVL}), reported(*DVL)


def dropouts(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Write the velocities of 0.5 % of the rows as 0."""
    kept = rng.random(raw.height) > 0.005
    return changed(raw, {name: raw[name].to_numpy() * kept for name in DVL}), reported(*DVL)


def frozen(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Hold the velocities for three seconds, once."""
    at = int(rng.integers(500, raw.height - 1000))
    columns = {name: raw[name].to_numpy().copy() for name in DVL}
    for values in columns.values():
        values[at : at + 150] = values[at]
    return changed(raw, columns), reported(*DVL)


def biased(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Add a bias of 0.01 rad/s to one axis of the gyro."""
    name = str(rng.choice(["p", "q", "r"]))
    return raw.with_columns(pl.col(name) + 0.01 * rng.choice([-1.0, 1.0])), reported(name)


def exchanged(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Exchange two command columns."""
    names = [name for name in raw.columns if name.startswith("cmd_")]
    first, second = rng.choice(names, 2, replace=False)
    swapped = raw.with_columns(pl.col(second).alias(first), pl.col(first).alias(second))
    return swapped, lambda log: log.raw.select(names).equals(raw.select(names))


def reversed_(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Reverse the sign of one command column."""
    names = [name for name in raw.columns if name.startswith("cmd_")]
    turned = raw.with_columns(-pl.col(str(rng.choice(names))))
    return turned, lambda log: log.raw.select(names).equals(raw.select(names))


def repeated(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Repeat the motion of the previous row in 5 % of the rows."""
    lost = rng.random(raw.height) < 0.05
    lost[0] = False
    source = np.maximum.accumulate(np.where(lost, 0, np.arange(raw.height)))
    return changed(raw, {name: raw[name].to_numpy()[source] for name in MOTION}), reported(*MOTION)


def put_right(spoilt: pl.DataFrame, raw: pl.DataFrame) -> tuple[pl.DataFrame, Check]:
    """Return the log with a fault of its columns, and a check that the fault is reported and corrected.

    Args:
        spoilt: Log with the fault.
        raw: Log without the fault.
    """

    def right(log: Preprocessed) -> bool:
        if not log.faults or log.raw.height != raw.height:
            return False
        away = (log.raw.select(MOTION) - raw.select(MOTION)).to_numpy()
        away[:, 3:6] = np.angle(np.exp(1j * away[:, 3:6]))
        return bool(np.median(np.abs(away), axis=0).max() < 1e-6)

    return spoilt, right


def opposite(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Reverse the sign of one velocity or rate."""
    return put_right(raw.with_columns(-pl.col(str(rng.choice(MOTION[6:])))), raw)


def sideways(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Exchange x and y, or u and v."""
    first, second = (("x", "y"), ("u", "v"))[int(rng.integers(2))]
    return put_right(raw.with_columns(pl.col(first).alias(second), pl.col(second).alias(first)), raw)


def upward(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Make z positive up: alone, with the world's axes ENU, or v and w as in FLU."""
    kind = int(rng.integers(3))
    if kind == 2:
        return put_right(raw.with_columns(-pl.col("v"), -pl.col("w")), raw)
    spoilt = raw.with_columns(-pl.col("z"))
    return put_right(spoilt.with_columns(x="y", y="x") if kind else spoilt, raw)


def tilted(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Reverse the sign of roll, pitch or both."""
    names = (("phi",), ("theta",), ("phi", "theta"))[int(rng.integers(3))]
    return put_right(raw.with_columns(-pl.col(name) for name in names), raw)


def degrees(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Write angles or rates in degrees."""
    names = (MOTION[3:6], MOTION[9:])[int(rng.integers(2))]
    return put_right(raw.with_columns(pl.col(name) * (180.0 / np.pi) for name in names), raw)


def never_measured(raw: pl.DataFrame, rng: np.random.Generator) -> tuple[pl.DataFrame, Check]:
    """Hold one velocity at one value throughout, so that the diagnosis must stop and name it."""
    name = str(rng.choice(DVL))
    stuck = raw.with_columns(pl.lit(0.1).alias(name))
    return stuck, lambda log: False


PLANTS: tuple[Plant, ...] = (
    *(spikes, dropouts, frozen, biased, exchanged, reversed_, repeated),
    *(opposite, sideways, upward, tilted, degrees, never_measured),
)


def told(plant: Plant, given: Vehicle, raw: pl.DataFrame, rng: np.random.Generator) -> bool:
    """Return whether a planted fault is reported correctly; a fault without correction must be refused."""
    spoilt, found = plant(raw, rng)
    try:
        return found(preprocess(given, spoilt))
    except DataError as error:
        return plant is never_measured and str(error).startswith(DVL) and "in every row" in str(error)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--studies", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=0)
    chosen = parser.parse_args()
    alarms, right = 0, np.zeros(len(PLANTS), int)
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.studies):
        case = cases.draw(KINDS[seed % len(KINDS)], seed)
        _, flown = study.flyable(case, SECONDS)
        alarms += bool(preprocess(flown.given, flown.measured).faults)
        for i, plant in enumerate(PLANTS):
            right[i] += told(plant, flown.given, flown.measured, np.random.default_rng([seed, i]))
        done = seed - chosen.first_seed + 1
        print(f"{done}: {alarms} alarms, right {right.tolist()}", flush=True)
    names = [(plant.__doc__ or "").rstrip(".").lower() for plant in PLANTS]
    print("\n| planted | told rightly | 95 % interval |\n| --- | ---: | ---: |")
    for name, hits in zip([*names, "nothing: an alarm"], [*right.tolist(), alarms], strict=True):
        low, high = interval(hits, chosen.studies)
        print(f"| {name} | {hits} of {chosen.studies} | {low:.0%} to {high:.0%} |")


if __name__ == "__main__":
    main()
