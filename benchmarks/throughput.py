"""Throughput against error: simulators and water models by speed and by error against Stonefish.

Error: open-loop replay of the bundled 90 s manoeuvre, recorded in Stonefish.  Every simulator starts at the
recorded state and gets the recorded commands at 50 Hz.  The error is the RMSE of all six velocities.

Speed: control steps of 25 Hz of 64 vehicles together, per second of processor time of one thread, with a new
command for each.  GPU speeds are those of the kept table gpu.csv, recorded with the effects of auv151.  A GPU
runs the kernels, so its error is theirs.

    bare MuJoCo                   rigid body, weight and buoyancy, thrusters;
    ... with added mass           M_A in the mass matrix;
    ... with MuJoCo's ellipsoid   MuJoCo's own fluid model on an ellipsoid of the hull's size;
    effects                       M_A, and linear and quadratic damping fitted to the bundled sample;
    network                       M_A and a PhysicsFeature-MLP trained on the bundled sample.

Effects and network run in MuJoCo at 500 Hz and in this project's own kernels, Runge-Kutta at 10 ms.  If
Stonefish is installed, its speed is measured too; its error is zero by definition.

    python benchmarks/throughput.py --keep throughput --plot docs/images/throughput.png
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from kept_tables import RESULTS, keep_timed

import hydro
from hydro.core.columns import POSE, VELOCITY, Array
from hydro.core.errors import UsageError
from hydro.core.evaluation.metrics import Subject, measure
from hydro.core.residual.network import Network
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import quaternion_from_euler
from hydro.io import vehicle as files
from hydro.sim.bridge.water import Water, dry, residual, wet
from hydro.sim.kernel_plant import KernelPlant
from hydro.sim.plant import Plant, StudentPlant
from hydro.sim.residual.control import Control
from hydro.sim.stonefish.plant import StonefishPlant
from hydro.sim.stonefish.program import installed

DATA = Path(__file__).resolve().parents[1] / "datasets" / "stonefish"
LOG, CONTROL_STEP = 0.02, 0.04
COUNT, EPOCHS, SHOTS = 64, 8, 150
EPISODE = 128  # control steps until the vehicles are reset
DAMPING = ("linear_damping", "quadratic_damping")
STONEFISH = "Stonefish"
GPUS = {"H200": "100,000", "H100": "100,000"}  # number of vehicles by GPU in gpu.csv
Make = Callable[[int, float], Plant]
"""Function that makes the plant of a number of vehicles with a control step [s]."""


@dataclass(frozen=True)
class Case:
    """Simulator with a water model."""

    simulator: str
    water: str
    make: Make


def learnt(vehicle: Vehicle, epochs: int) -> tuple[Vehicle, Any]:
    """Return the vehicle with fitted damping, and a network trained on the bundled sample."""
    sample = pl.read_parquet(DATA / "sample.parquet")
    fitted = hydro.fit(vehicle, sample, list(DAMPING), shots=SHOTS).vehicle
    parts, _ = hydro.split(hydro.labels(vehicle, sample))
    model = hydro.train(parts, model="physfeat", epochs=epochs)
    return fitted, model


def cases(vehicle: Vehicle, fitted: Vehicle, model: Any) -> list[Case]:
    """Return all cases that this machine can run."""

    def network(one: Vehicle) -> Water:
        return residual(one, Control(Network.of(model), CONTROL_STEP))

    def mujoco(subject: Vehicle, water: Callable[[Vehicle], Water]) -> Make:
        return lambda count, period: StudentPlant(subject, water, count=count, period=period)

    def kernels(subject: Vehicle, water: Callable[[Vehicle], Water]) -> Make:
        return lambda count, period: KernelPlant(subject, water, count=count, period=period)

    found = [
        Case("MuJoCo", "no water", mujoco(vehicle, dry)),
        Case("MuJoCo", "added mass", mujoco(vehicle, lambda one: dry(one, added_mass=True))),
        Case("MuJoCo", "ellipsoid", mujoco(vehicle, lambda one: dry(one, ellipsoid=True))),
        Case("MuJoCo", "effects", mujoco(fitted, wet)),
        Case("MuJoCo", "network", mujoco(vehicle, network)),
        Case("kernels", "effects", kernels(fitted, wet)),
        Case("kernels", "network", kernels(vehicle, network)),
    ]
    try:
        installed()
    except UsageError as missing:
        print(f"no row of Stonefish: {missing}")
        return found
    own: Make = lambda count, period: StonefishPlant(vehicle, count=count, period=period)  # noqa: E731
    return [*found, Case(STONEFISH, "its own", own)]


def replayed(plant: Plant, raw: pl.DataFrame) -> float:
    """Return the RMSE of all six velocities in a replay of one session [m/s and rad/s]."""
    measured, commands = raw.select(VELOCITY).to_numpy(), raw.select(pl.col("^cmd_.*$")).to_numpy()
    pose = raw.select(POSE).to_numpy()[0].astype(float)
    start = np.concatenate([pose[:3], quaternion_from_euler(*pose[3:])])[None]
    plant.reset(np.ones(1, dtype=bool), start, measured[:1].astype(float))
    motion = [plant.velocity[0].copy()]
    for row in commands[:-1].astype(float):
        plant.step(row[None])
        motion.append(plant.velocity[0].copy())
    flown: Array = np.array(motion)
    errors = measure(measured, flown, np.zeros(len(flown)), Subject("", "replay90"), axes=VELOCITY)
    return float(errors.filter(pl.col("axis") == "all", pl.col("metric") == "rmse")["value"].item())


def speed(plant: Plant, rounds: int, seconds: float) -> float:
    """Return the control steps of all vehicles per second of processor time, the median of some rounds."""
    count, thrusters = plant.thrust.shape
    pairs = np.random.default_rng(1).uniform(-0.4, 0.4, (EPISODE // 2, 1, count, thrusters))
    commands = (pairs * np.array([1.0, -1.0]).reshape(1, 2, 1, 1)).reshape(EPISODE, count, thrusters)
    every, pose = np.ones(count, dtype=bool), np.tile([0.0, 0.0, 4.0, 1.0, 0.0, 0.0, 0.0], (count, 1))
    rates, tick = [], 0
    for _ in range(rounds + 1):
        done, start = 0, time.process_time()
        while (spent := time.process_time() - start) < seconds or not done:
            if tick % EPISODE == 0:
                plant.reset(every, pose, np.zeros((count, 6)))
            plant.step(commands[tick % EPISODE])
            tick, done = tick + 1, done + count
        rates.append(done / spent)
    return float(np.median(rates[1:]))


def measured(chosen: list[Case], raw: pl.DataFrame, rounds: int, seconds: float) -> list[dict[str, Any]]:
    """Return simulator, water model, speed [control steps/s] and error of every case."""
    rows = []
    for case in chosen:
        error = 0.0 if case.simulator == STONEFISH else replayed(case.make(1, LOG), raw)
        rate = speed(case.make(COUNT, CONTROL_STEP), rounds, seconds)
        rows.append({"simulator": case.simulator, "water": case.water, "speed": rate, "error": error})
        print(f"{case.simulator}, {case.water}: {rate:,.0f} control steps/s, {error:.4f}", flush=True)
    return rows


def of_gpus(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows of the kept speeds on GPUs, with the error of the same kernels with effects."""
    error = next(r["error"] for r in rows if (r["simulator"], r["water"]) == ("kernels", "effects"))
    with (RESULTS / "gpu.csv").open(newline="") as file:
        kept = {(r["GPU"], r["vehicles"]): r["control steps"] for r in csv.DictReader(file)}
    found = []
    for gpu, vehicles in GPUS.items():
        speed = 1e6 * float(kept[gpu, vehicles].removesuffix(" million"))
        found.append({"simulator": f"kernels on {gpu}", "water": "effects", "speed": speed, "error": error})
    return found


def cells(rows: list[dict[str, Any]]) -> list[dict[str, str]]:
    """Return the rows as cells of the kept table."""
    bare = next(r["speed"] for r in rows if (r["simulator"], r["water"]) == ("MuJoCo", "no water"))
    return [
        {
            "simulator": r["simulator"],
            "water forces": r["water"],
            "control steps per second": f"{r['speed']:,.0f}",
            "times bare MuJoCo": f"{r['speed'] / bare:,.{2 if r['speed'] < 100 * bare else 0}f}",
            "replay error, m/s and rad/s": f"{r['error']:.4f}",
        }
        for r in rows
    ]


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw one point per case: speed against error, both logarithmic."""
    from matplotlib.figure import Figure

    below = {f"kernels on {gpu}" for gpu in list(GPUS)[1:]}  # labels that would hide others
    colours = {"MuJoCo": "#4477aa", "kernels": "#cc6677", STONEFISH: "#117733"}
    figure = Figure(figsize=(7.5, 4.6), dpi=150, layout="constrained")
    axes = figure.add_subplot()
    for row in rows:
        colour = colours.get(row["simulator"], "#aa3377")
        if row["error"] == 0.0:
            axes.axvline(row["speed"], color=colour, linestyle="--", linewidth=0.9)
            continue
        axes.loglog(row["speed"], row["error"], "o", color=colour)
        axes.annotate(
            f"{row['simulator']}, {row['water']}",
            (row["speed"], row["error"]),
            textcoords="offset points",
            xytext=(0, -13 if row["simulator"] in below else 7),
            ha="center",
            fontsize=8,
            color=colour,
        )
    axes.margins(x=0.15, y=0.15)
    axes.set_xlabel("control steps of 25 Hz per second (one processor thread, or one GPU)")
    axes.set_ylabel("replay error over 90 s, m/s and rad/s (RMSE)")
    axes.grid(visible=True, which="both", color="#eeeeee")
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=0.3, help="of every case in every round")
    parser.add_argument("--epochs", type=int, default=EPOCHS, help="passes over the data for the network")
    parser.add_argument("--rows", type=int, help="rows of the replay, for a short test run")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the figure")
    parser.add_argument("--keep", metavar="NAME", help="write benchmarks/results/NAME.csv")
    parser.add_argument("--commit", default="", help="measured commit, for --keep")
    chosen = parser.parse_args()
    vehicle = files.read(DATA / "vehicle.toml")[0]
    raw = pl.read_parquet(DATA / "replay90.parquet").slice(0, chosen.rows)
    rows = measured(cases(vehicle, *learnt(vehicle, chosen.epochs)), raw, chosen.rounds, chosen.seconds)
    rows += of_gpus(rows)
    if chosen.plot:
        plot(rows, chosen.plot)
    if chosen.keep:
        timed = {"rounds": chosen.rounds, "seconds": float(chosen.seconds)}
        options = {**timed, "keep": chosen.keep, "plot": chosen.plot}
        keep_timed("throughput.py", chosen.keep, cells(rows), chosen.commit, 0, **options)


if __name__ == "__main__":
    main()
