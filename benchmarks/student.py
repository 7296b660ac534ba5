"""Speed of the MuJoCo model, compared with MuJoCo without water.

The same vehicle is stepped by `mujoco.batch.Batch`, with a new command for every vehicle and control step.

    bare       MuJoCo alone: body, weight, buoyancy and the same number of thrusters with first-order lag.
    effects    all effects of the vehicle file with exact added mass, and thrusters with dead band.
    network    M_A and PhysicsFeature-MLP at every control step, no effects.
    both       all effects and the network.

A round times every case once, in alternating order.  Results are medians over rounds, of steps per second and
of each round's ratio to bare MuJoCo, so that other load slows all cases of a round equally.  Callbacks
are removed from the process while bare MuJoCo runs.  Also measured: one vehicle in a loop, with quadratic
drag compiled and as a Python callback; `hydro simulate`; and the reference simulator of `hydro collect`.

    python benchmarks/student.py -o student.parquet

`--processor` measures the processor time of the simulation threads, for a busy machine.  Two threads count as
one second if both run for a second.
"""

from __future__ import annotations

import argparse
import ctypes
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import mujoco
import numpy as np
import polars as pl
from mujoco import batch

from hydro.core.effects import assemble
from hydro.core.residual.network import Network
from hydro.core.simulation.simulate import INTEGRATION_RATE, steps_of_row, trajectory
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files
from hydro.sim.bridge import mjcf, native
from hydro.sim.bridge.water import PREFIX, residual, wet
from hydro.sim.residual.control import Control
from hydro.sim.teacher import collect, teacher

VEHICLES = Path(__file__).resolve().parents[1] / "datasets" / "vehicles"
TIMESTEP, CONTROL_STEP = 0.002, 0.04
SUBSTEPS = round(CONTROL_STEP / TIMESTEP)
COUNTS, THREADS = (1, 8, 64, 512), (1, 2)
SLOTS = ("mjcb_passive", "mjcb_sensor", "mjcb_act_dyn", "mjcb_act_bias")
EPISODE = 128  # control steps until all vehicles are reset
ROW = 0.02  # s between commands of `hydro simulate` and of the reference simulator
PHYSFEAT = (45, 128, 256, 128, 6)
Rows = list[dict[str, Any]]
Work = Callable[[], int]
"""Function that does some work and returns the number of steps."""


class Clock:
    """Clock that rates are measured with: wall time or processor time."""

    now = time.perf_counter
    processor = False

    @classmethod
    def of_the_processor(cls) -> None:
        """Use the processor time of all threads from now on."""
        cls.now, cls.processor = time.process_time, True


def random_model(kind: str = "physfeat", widths: tuple[int, ...] = PHYSFEAT) -> SimpleNamespace:
    """Return a residual model with random weights and a weak output, which do not affect its cost."""
    rng = np.random.default_rng(0)
    tensors = {}
    for i, (wide, next_wide) in enumerate(pairwise(widths)):
        tensors[f"layers.{i}.weight"] = rng.normal(size=(next_wide, wide)) / np.sqrt(wide)
        tensors[f"layers.{i}.bias"] = rng.normal(size=next_wide) / np.sqrt(wide)
    scalers = {
        f"{side}_{what}": np.full(length, value)
        for side, length in (("input", widths[0]), ("output", widths[-1]))
        for what, value in (("mean", 0.0), ("scale", 1.0))
    }
    features = "physfeat" if kind == "physfeat" else "raw"
    architecture = {"model": kind, "features": features, "layers": widths, "activation": "silu"}
    return SimpleNamespace(
        name=kind,
        architecture=architecture,
        tensors=tensors,
        scalers=scalers,
        subtract="inertia",
        labelled=None,
    )


def bare(vehicle: Vehicle) -> mujoco.MjModel:
    """Return the body and its thrusters as in plain MuJoCo, without hydro."""
    spec = mjcf.scene(msgspec.structs.replace(vehicle, effect=()), timestep=TIMESTEP)
    for actuator, thruster in zip(spec.actuators, vehicle.thruster, strict=True):
        actuator.biastype = mujoco.mjtBias.mjBIAS_NONE
        actuator.gainprm[0] = thruster.max_thrust
        actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        actuator.dynprm[0] = thruster.time_constant
    spec.delete(spec.numeric(PREFIX + vehicle.name))
    return spec.compile()


def models(vehicle: Vehicle) -> dict[str, mujoco.MjModel]:
    """Return the compiled models of the four cases."""
    control = Control(Network.of(random_model()), CONTROL_STEP)
    waters = {
        "effects": wet(vehicle),
        "network": residual(vehicle, control),
        "both": replace(wet(vehicle), control=control),
    }
    flown = {
        name: native.prepare(mjcf.scene(vehicle, water, timestep=TIMESTEP).compile())
        for name, water in waters.items()
    }
    return {"bare": bare(vehicle)} | flown


@contextmanager
def without_callbacks() -> Iterator[None]:
    """Run MuJoCo without hydro's callbacks."""
    slots = [ctypes.c_void_p.in_dll(native._library(), name) for name in SLOTS]
    addresses = [slot.value for slot in slots]
    try:
        for slot in slots:
            slot.value = None
        yield
    finally:
        for slot, address in zip(slots, addresses, strict=True):
            slot.value = address


def excitation(shape: tuple[int, ...]) -> np.ndarray:
    """Return commands (EPISODE, *shape) in opposite pairs, so that a vehicle without drag stays slow."""
    pairs = np.random.default_rng(1).uniform(-0.4, 0.4, (EPISODE // 2, 1, *shape))
    return (pairs * np.array([1.0, -1.0]).reshape(1, 2, *[1] * len(shape))).reshape(EPISODE, *shape)


def side_by_side(model: mujoco.MjModel, count: int, threads: int) -> Work:
    """Return a function that advances `count` vehicles one control step under new commands."""
    many = batch.Batch(model, count, nthread=threads)
    commands = excitation((count, model.nu))
    tick = 0

    def control_step() -> int:
        nonlocal tick
        if tick % EPISODE == 0:
            many.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        many.ctrl[:] = commands[tick % EPISODE]
        tick += 1
        many.step(nstep=SUBSTEPS)
        return count * SUBSTEPS

    return control_step


def in_a_loop(model: mujoco.MjModel) -> Work:
    """Return a function that advances one vehicle one control step by `mj_step`."""
    data = mujoco.MjData(model)
    commands = excitation((model.nu,))
    tick = 0

    def control_step() -> int:
        nonlocal tick
        if tick % EPISODE == 0:
            mujoco.mj_resetData(model, data)
        data.ctrl[:] = commands[tick % EPISODE]
        tick += 1
        mujoco.mj_step(model, data, SUBSTEPS)
        return SUBSTEPS

    return control_step


def python_drag(vehicle: Vehicle) -> Callable[[Any, Any], None]:
    """Return quadratic drag as a plain Python callback."""
    table = next(effect for effect in vehicle.effect if effect["name"] == "quadratic_damping")
    factors = np.array(table["diagonal"])

    def passive(_model: Any, data: Any) -> None:
        R = data.xmat[1].reshape(3, 3)
        force = data.qfrc_passive
        v, omega = R.T @ data.qvel[:3], data.qvel[3:6]
        force[:3] -= R @ (factors[:3] * np.abs(v) * v)
        force[3:6] -= factors[3:] * np.abs(omega) * omega

    return passive


def rate(work: Work, seconds: float) -> float:
    """Return the steps per second over at least `seconds`."""
    done, start = 0, Clock.now()
    while (spent := Clock.now() - start) < seconds or not done:
        done += work()
    return done / spent


def interleaved(cases: dict[str, Callable[[float], float]], rounds: int, seconds: float) -> dict[str, Any]:
    """Return the rates (rounds,) of every case; each round starts with the next case."""
    found: dict[str, list[float]] = {name: [] for name in cases}
    names = list(cases)
    for name in names:
        cases[name](0.2 * seconds)
    for turn in range(rounds):
        for k in range(len(names)):
            name = names[(turn + k) % len(names)]
            found[name].append(cases[name](seconds))
    return {name: np.array(rates) for name, rates in found.items()}


def silenced(work: Work, seconds: float) -> float:
    """Return the `rate` without hydro's callbacks."""
    with without_callbacks():
        return rate(work, seconds)


def with_python(work: Work, passive: Any, seconds: float) -> float:
    """Return the `rate` with a Python callback instead of hydro's."""
    with without_callbacks():
        mujoco.set_mjcb_passive(passive)
        try:
            return rate(work, seconds)
        finally:
            mujoco.set_mjcb_passive(None)


def rows_of(
    found: dict[str, Any], what: str, vehicles: int, threads: int, unit: str, sharing: int = 1
) -> Rows:
    """Return rows of the results table, with the ratio to the first case in each round.

    By processor time, a rate is that of one thread and is multiplied by the number of threads, `sharing`.
    Waiting of threads for one another is not included.
    """
    base = next(iter(found.values()))
    rows = []
    shared = sharing if Clock.processor else 1
    for case, rates in found.items():
        low, ratio, high = np.quantile(rates / base, [0.25, 0.5, 0.75])
        rows.append(
            {
                "what": what,
                "vehicles": vehicles,
                "threads": threads,
                "case": case,
                "per_second": shared * float(np.median(rates)),
                "unit": unit,
                "ratio": float(ratio),
                "ratio_low": float(low),
                "ratio_high": float(high),
                "rounds": len(rates),
            }
        )
    return rows


def of_batches(
    flown: dict[str, mujoco.MjModel], count: int, threads: int, rounds: int, seconds: float
) -> Rows:
    """Return rows of the four cases in batches."""
    works = {name: side_by_side(model, count, threads) for name, model in flown.items()}
    cases: dict[str, Callable[[float], float]] = {
        name: partial(silenced if name == "bare" else rate, work) for name, work in works.items()
    }
    sharing = min(threads, count)
    return rows_of(interleaved(cases, rounds, seconds), "batch", count, threads, "physics steps", sharing)


def of_callbacks(vehicle: Vehicle, flown: dict[str, mujoco.MjModel], rounds: int, seconds: float) -> Rows:
    """Return rows of one vehicle in a loop: the cost of a callback, compiled and in Python."""
    drag = tuple(effect for effect in vehicle.effect if effect["name"] == "quadratic_damping")
    dragged = wet(msgspec.structs.replace(vehicle, effect=drag))
    compiled = native.prepare(mjcf.scene(vehicle, dragged, timestep=TIMESTEP).compile())
    plain = flown["bare"]
    cases: dict[str, Callable[[float], float]] = {
        "bare": partial(silenced, in_a_loop(plain)),
        "quadratic drag, compiled": partial(rate, in_a_loop(compiled)),
        "all effects, compiled": partial(rate, in_a_loop(flown["effects"])),
        "quadratic drag in Python": partial(with_python, in_a_loop(plain), python_drag(vehicle)),
    }
    return rows_of(interleaved(cases, rounds, seconds), "loop", 1, 1, "physics steps")


def of_others(vehicle: Vehicle, rounds: int, seconds: float, rows: int) -> Rows:
    """Return rows of `hydro simulate` (RK4 at 500 Hz) and of the embedded reference simulator."""
    program, master = assemble(vehicle), teacher(vehicle)
    t = np.arange(rows) * ROW
    commands = np.random.default_rng(2).uniform(-0.3, 0.3, (rows, program.thrusters))

    def simulated() -> int:
        trajectory(program, commands, t, eta=(0.0, 0.0, 50.0, 0.0, 0.0, 0.0), steps=steps_of_row(ROW))
        return round((rows - 1) * ROW * INTEGRATION_RATE)

    found = interleaved({"hydro simulate": partial(rate, simulated)}, rounds, seconds)
    results = rows_of(found, "simulate", 1, 1, "physics steps")
    for threads in THREADS:
        case = {
            "embedded teacher": partial(rate, lambda n=threads: collect(master, rows, 3, threads=n).height)
        }
        results += rows_of(interleaved(case, rounds, seconds), "teacher", 1, threads, "rows of 50 Hz")
    return results


def show(results: Rows) -> None:
    """Print the results as tables."""
    print("\nMany vehicles by mujoco.batch.Batch: thousands of physics steps per second,")
    print("and shares of bare MuJoCo's with the quartiles of the rounds\n")
    print("| vehicles | threads | bare | effects | network | both |", end="")
    print(" effects / bare | network / bare | both / bare |")
    print("|" + "---:|" * 9)
    settings = list(dict.fromkeys((r["vehicles"], r["threads"]) for r in results if r["what"] == "batch"))
    for setting in settings:
        line = [r for r in results if r["what"] == "batch" and (r["vehicles"], r["threads"]) == setting]
        speeds = [f"{r['per_second'] / 1e3:.0f}" for r in line]
        shares = [f"{r['ratio']:.2f} [{r['ratio_low']:.2f}, {r['ratio_high']:.2f}]" for r in line[1:]]
        print(f"| {' | '.join([*map(str, setting), *speeds, *shares])} |")
    print(f"\nControl steps per second are physics steps / {SUBSTEPS}.\n")
    print("| case | threads | per second | time a step, bare = 1 |")
    print("|---|---:|---:|---:|")
    for r in results:
        if r["what"] != "batch":
            factor = f"{1 / r['ratio']:.2f}" if r["what"] == "loop" else ""
            print(f"| {r['case']} | {r['threads']} | {r['per_second']:,.0f} {r['unit']} | {factor} |")


def write(results: Rows, path: Path) -> None:
    """Write the rows as JSON or Parquet, by the name's ending."""
    frame = pl.DataFrame(results)
    if path.suffix == ".json":
        frame.write_json(path)
    else:
        frame.write_parquet(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicle", default="auv151", help="preset")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--seconds", type=float, default=0.15, help="time per case and round")
    parser.add_argument(
        "--vehicles", type=int, action="append", help="number of vehicles; repeat for several"
    )
    parser.add_argument("--quick", action="store_true", help="short test run; the figures are meaningless")
    parser.add_argument("--processor", action="store_true", help="measure processor time")
    parser.add_argument("-o", "--out", type=Path, help="write the rows as .parquet or .json")
    chosen = parser.parse_args()
    if chosen.processor:
        Clock.of_the_processor()
    rounds, seconds = (2, 0.005) if chosen.quick else (chosen.rounds, chosen.seconds)
    vehicle = files.read(VEHICLES / f"{chosen.vehicle}.toml")[0]
    flown = models(vehicle)
    print(
        f"{vehicle.name}, MuJoCo {mujoco.__version__}, {1 / TIMESTEP:g} Hz, implicitfast, new commands at "
        f"{1 / CONTROL_STEP:g} Hz; medians of {rounds} interleaved rounds of {seconds:g} s"
    )
    results: Rows = []
    for count in chosen.vehicles or COUNTS[: 2 if chosen.quick else None]:
        for threads in THREADS:
            results += of_batches(flown, count, threads, rounds, seconds)
    results += of_callbacks(vehicle, flown, rounds, seconds)
    results += of_others(vehicle, max(2, rounds // 3), seconds, rows=500 if chosen.quick else 20_000)
    show(results)
    if chosen.out:
        write(results, chosen.out)


if __name__ == "__main__":
    main()
