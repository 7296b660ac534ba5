"""Speed of vehicle simulation on a GPU, compared with the processor.

A thousand to a million vehicles fly on one machine, with commands that change at every control step of 0.04
s.  On the GPU they use Runge-Kutta steps of 0.01 s, alone and with tasks, sonar, rewards and new episodes.
On the processor they use the same kernels, one after another on one thread, and MuJoCo models on all threads
(implicitfast at 2 ms).  Rounds alternate; medians are reported.

    python benchmarks/gpu.py
    python benchmarks/gpu.py --vehicles 1000 --vehicles 100000 -o gpu.parquet
    python benchmarks/gpu.py --model physfeat.parquet   # also with a residual network
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.effects import assemble
from hydro.core.errors import HydroError, UsageError
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.rl.environment import conditions
from hydro.rl.world.config import Settings
from hydro.sim.gpu import memory

COUNTS = (1_000, 10_000, 100_000, 1_000_000)
PERIOD, STEPS = 0.04, 4
ROOM = 200_000_000
"""Maximum size of the commands, all control steps together."""
ON_PROCESSOR, STUDENTS = 250, 512
"""Vehicles in a round of kernels and of MuJoCo on the processor: time per vehicle is constant beyond that."""

Flight = Callable[[], int]
"""Function that flies some control steps of many vehicles and returns their number."""


def of_gpu(vehicle: Vehicle, commands: Array, condition: conditions.Condition | None = None) -> Flight:
    """Fly N vehicles on the GPU under commands (K, N, n); by default with all effects of the file."""
    from numba import cuda

    from hydro.sim.gpu.plant import GpuPlant

    rows, count = commands.shape[:2]
    water = conditions.waters(condition or conditions.Condition(), vehicle, PERIOD)
    plant = GpuPlant(vehicle, water, count=count, period=PERIOD, timestep=PERIOD / STEPS)
    held = [memory.put(row) for row in commands]
    pose = np.tile([0.0, 0, 50, 1, 0, 0, 0], (count, 1))
    plant.reset(np.ones(count, dtype=bool), pose, np.zeros((count, 6)))

    def fly() -> int:
        for row in held:
            plant.step(row)
        cuda.synchronize()
        return rows * count

    return fly


def of_gpu_with_tasks(vehicle: Vehicle, commands: Array) -> Flight:
    """Fly vehicles to goals between eight pillars at random demands, with new episodes at the end."""
    import torch

    from hydro.rl.environment.blocks import TERMINATED, TRUNCATED
    from hydro.rl.gpu.fleet import GpuFleet

    rows, count = commands.shape[:2]
    fleet = GpuFleet(Settings(), vehicle, count=count, task="pillar_row", timestep=PERIOD / STEPS)
    fleet.reset()
    demands = torch.rand((rows, count, 6), device=fleet.device) * 2.0 - 1.0

    def fly() -> int:
        for row in demands:
            fleet.step(row)
            if (done := fleet.flags[TERMINATED] | fleet.flags[TRUNCATED]).any():
                fleet.reset(done)
        torch.cuda.synchronize()
        return rows * count

    return fly


def of_processor(vehicle: Vehicle, commands: Array) -> Flight:
    """Fly a part of the vehicles on the processor by the loop of `simulate`."""
    program, rows = assemble(vehicle), len(commands)
    few = np.ascontiguousarray(np.moveaxis(commands[:, :ON_PROCESSOR], 1, 0))
    t = np.arange(rows) * PERIOD

    def fly() -> int:
        for row in few:
            trajectory(program, row, t, eta=(0.0, 0.0, 50.0, 0.0, 0.0, 0.0), steps=STEPS)
        return (rows - 1) * len(few)

    return fly


def of_mujoco(vehicle: Vehicle, commands: Array) -> Flight:
    """Fly a part of the vehicles as MuJoCo models, on all threads."""
    few = np.ascontiguousarray(commands[:, :STUDENTS])
    threads = len(os.sched_getaffinity(0))
    plant = conditions.plant(conditions.Condition(), vehicle, Settings(), few.shape[1], threads=threads)
    pose = np.tile([0.0, 0, 50, 1, 0, 0, 0], (few.shape[1], 1))
    plant.reset(np.ones(len(pose), dtype=bool), pose, np.zeros((len(pose), 6)))

    def fly() -> int:
        for row in few:
            plant.step(row)
        return few.shape[0] * few.shape[1]

    return fly


Ways = dict[str, Callable[[Vehicle, Array], Flight]]
WAYS: Ways = {"gpu": of_gpu, "gpu_tasks": of_gpu_with_tasks, "processor": of_processor, "mujoco": of_mujoco}
TITLES = {"gpu": "GPU", "gpu_tasks": "with tasks", "processor": "simulate, 1 thread",
          "mujoco": "MuJoCo, all threads", "gpu_network": "GPU, network"}  # fmt: skip


def networked(path: Path) -> Ways:
    """Return the ways to fly with the residual network in a file."""
    from hydro.io import table
    from hydro.io.model import from_artefact

    model = from_artefact(table.read(path, "model"))
    names = {kind: name for name, kind in conditions.MODELS.items()}
    condition = conditions.Condition(names[str(model.architecture["model"])], model)
    return {"gpu_network": lambda vehicle, commands: of_gpu(vehicle, commands, condition)}


def measured(
    ways: Ways, vehicle: Vehicle, counts: list[int], rows: int, rounds: int
) -> Iterator[dict[str, float]]:
    """Yield the control steps per second of all ways to fly, one dict for each number of vehicles.

    Args:
        ways: Ways to fly by name.
        vehicle: Vehicle file.
        counts: Numbers of vehicles.
        rows: Number of control steps.
        rounds: Number of rounds, of which medians are reported.
    """
    for count in counts:
        rng = np.random.default_rng(2)
        thrusters = len(vehicle.thruster)
        some = max(2, min(rows, ROOM // (count * thrusters)))
        commands = rng.uniform(-0.3, 0.3, (some, count, thrusters))
        flown = {name: way(vehicle, commands) for name, way in ways.items()}
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
        yield {"vehicles": count, **middle, "ratio": ratio, "ratio_low": low, "ratio_high": high,
               "rounds": rounds}  # fmt: skip


def card() -> str:
    """Return the name of the GPU."""
    from numba import cuda

    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else str(name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicle", default="auv151", help="preset")
    parser.add_argument("--model", type=Path, help="residual network to fly under as well")
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
        print(f"{vehicle.name}: control steps per second, on {os.cpu_count()} cores and {card()}\n")
        ways = WAYS | (networked(chosen.model) if chosen.model else {})
        print(f"| vehicles | {' | '.join(TITLES[name] for name in ways)} | GPU / simulate |")
        print("|---:|" + "---:|" * (len(ways) + 1))
        rows = []
        for row in measured(ways, vehicle, chosen.vehicles or list(COUNTS), chosen.rows, chosen.rounds):
            rows.append(row)
            rates = " | ".join(f"{row[f'{name}_per_second']:,.0f}" for name in ways)
            print(f"| {row['vehicles']} | {rates} |", end="")
            print(f" {row['ratio']:.0f} [{row['ratio_low']:.0f}, {row['ratio_high']:.0f}] |", flush=True)
            if chosen.out:
                pl.DataFrame(rows).write_parquet(chosen.out)
    except HydroError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
