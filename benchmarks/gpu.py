"""How fast do vehicles fly on a GPU, beside the processor?

One run of one machine: a thousand to a million vehicles under commands that change at every control step of
0.04 s, by the same kernels on both sides, in Runge-Kutta steps of 0.01 s.  On the processor they fly one
after another on one thread.  Rounds of both take turns; what is told is medians.

    python benchmarks/gpu.py
    python benchmarks/gpu.py --vehicles 1000 --vehicles 100000 -o gpu.parquet
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl

import hydro
from hydro.core.columns import Array
from hydro.core.effects import assemble
from hydro.core.errors import HydroError, UsageError
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.sim.gpu import memory

COUNTS = (1_000, 10_000, 100_000, 1_000_000)
PERIOD, STEPS = 0.04, 4
ON_PROCESSOR = 250
"""Vehicles that the processor flies in a round: it takes as long for each of them, however many there are."""


def of_gpu(vehicle: Vehicle, commands: Array) -> Callable[[], int]:
    """Fly so many vehicles under commands (K, N, n), which lie on the device; control steps of one call."""
    from numba import cuda

    rows, count = commands.shape[:2]
    plant = hydro.student(vehicle, device="cuda", count=count, period=PERIOD, timestep=PERIOD / STEPS)
    held = [memory.put(row) for row in commands]
    pose = np.tile([0.0, 0, 50, 1, 0, 0, 0], (count, 1))
    plant.reset(np.ones(count, dtype=bool), pose, np.zeros((count, 6)))

    def fly() -> int:
        for row in held:
            plant.step(row)
        cuda.synchronize()
        return rows * count

    return fly


def of_processor(vehicle: Vehicle, commands: Array) -> Callable[[], int]:
    """Fly some of them by `simulate`'s loop; control steps of one call."""
    program, rows = assemble(vehicle), len(commands)
    few = np.ascontiguousarray(np.moveaxis(commands[:, :ON_PROCESSOR], 1, 0))
    t = np.arange(rows) * PERIOD

    def fly() -> int:
        for row in few:
            trajectory(program, row, t, eta=(0.0, 0.0, 50.0, 0.0, 0.0, 0.0), steps=STEPS)
        return (rows - 1) * len(few)

    return fly


def measured(vehicle: Vehicle, counts: list[int], rows: int, rounds: int) -> pl.DataFrame:
    """Control steps per second of both, by the number of vehicles."""
    found = []
    for count in counts:
        rng = np.random.default_rng(2)
        commands = rng.uniform(-0.3, 0.3, (rows, count, len(vehicle.thruster)))
        flown = {"gpu": of_gpu(vehicle, commands), "processor": of_processor(vehicle, commands)}
        for fly in flown.values():
            fly()  # compiled by now
        rates: dict[str, list[float]] = {name: [] for name in flown}
        for _ in range(rounds):
            for name, fly in flown.items():
                began = time.perf_counter()
                done = fly()
                rates[name].append(done / (time.perf_counter() - began))
        low, ratio, high = np.quantile(np.divide(rates["gpu"], rates["processor"]), [0.25, 0.5, 0.75])
        middle = {f"{name}_per_second": float(np.median(rate)) for name, rate in rates.items()}
        found.append(
            {
                "vehicles": count,
                **middle,
                "ratio": ratio,
                "ratio_low": low,
                "ratio_high": high,
                "rounds": rounds,
            }
        )
        print(
            f"| {count} | {middle['gpu_per_second']:,.0f} | {middle['processor_per_second']:,.0f} |", end=""
        )
        print(f" {ratio:.1f} [{low:.1f}, {high:.1f}] |", flush=True)
    return pl.DataFrame(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicle", default="auv151", help="preset")
    parser.add_argument("--vehicles", type=int, action="append", help="how many; repeat for several")
    parser.add_argument("--rows", type=int, default=25, help="control steps of a round")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("-o", "--out", type=Path, help="write the rows as .parquet")
    chosen = parser.parse_args()
    try:
        memory.require()
        if memory.simulated():
            raise UsageError("numba-cuda's simulator times nothing; unset NUMBA_ENABLE_CUDASIM")
        vehicle = files.read(bundled("vehicles") / f"{chosen.vehicle}.toml")[0]
        print(f"{vehicle.name}: control steps per second\n\n| vehicles | GPU | processor, 1 thread | ratio |")
        print("|---:|---:|---:|---:|")
        table = measured(vehicle, chosen.vehicles or list(COUNTS), chosen.rows, chosen.rounds)
    except HydroError as error:
        sys.exit(f"error: {error}")
    if chosen.out:
        table.write_parquet(chosen.out)


if __name__ == "__main__":
    main()
