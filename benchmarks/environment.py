"""Speed of the environment in both engines, by processor time, compared with bare MuJoCo.

Vehicles in a row of eight pillars get a new random action each at 25 Hz, on one thread.  Control steps of all
vehicles per second of processor time:

    bare             MuJoCo alone at 500 Hz, as in benchmarks/student.py: the body and first-order thrusters;
    R_…, mujoco      the whole environment under a condition: allocation, physics at 500 Hz, sonar,
                     observations, noise, collisions, reward, and new episodes;
    R_…, kernels     the same with the project's own kernels, Runge-Kutta at 10 ms.

A round times every case once, in alternating order.  Results are medians over rounds, of each case and of the
ratio of both engines in a round, with quartiles.  The profile then divides the processor time of a step.
Networks have random weights, which do not affect their cost.

    python benchmarks/environment.py -o environment.parquet --keep environment_speed
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from kept_tables import keep_timed
from student import (
    PHYSFEAT,
    Clock,
    Rows,
    Work,
    bare,
    interleaved,
    random_model,
    rate,
    rows_of,
    side_by_side,
    silenced,
    write,
)

from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.rl.environment import conditions
from hydro.rl.environment.action import ACTIONS, command_kernel
from hydro.rl.environment.blocks import FLAGS, Outcome
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.observation import OBSERVATIONS
from hydro.rl.environment.reward import TERMS
from hydro.rl.environment.step import sense_kernel, step_kernel
from hydro.rl.world.config import Engine, Settings

SUBSTEPS = 20
ENGINES: tuple[Engine, ...] = ("mujoco", "kernels")
CASES = {
    conditions.NO_WATER: "no water",
    conditions.EFFECTS: "effects of the file",
    "R_MLP": "MLP",
    "R_PhysFeat": "PhysicsFeature-MLP",
}
WIDTHS = {"R_MLP": (12, *PHYSFEAT[1:]), "R_PhysFeat": PHYSFEAT}


def fleet(vehicle: Vehicle, condition: str, engine: Engine, count: int) -> Fleet:
    """Return a fleet of `count` vehicles under a condition, in a row of eight pillars."""
    kind = conditions.MODELS.get(condition)
    model = None if kind is None else random_model(kind, WIDTHS[condition])
    settings = replace(Settings(), engine=engine)
    plant = conditions.plant(conditions.Condition(condition, model), vehicle, settings, count)
    made = Fleet(settings, plant)
    made.set_level("pillar_row", 8)
    made.reset()
    return made


def steps_of(flown: Fleet) -> Work:
    """Return a function that makes one step of a fleet under random actions.

    Random actions end more episodes than any policy.
    """
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (256, flown.count, ACTIONS))
    tick = 0

    def step() -> int:
        nonlocal tick
        flown.step(actions[tick % len(actions)])
        tick += 1
        return flown.count

    return step


def bare_steps(model: mujoco.MjModel, count: int) -> Work:
    """Return a function that makes control steps of `count` vehicles in MuJoCo without hydro."""
    work = side_by_side(model, count, 1)
    return lambda: work() // SUBSTEPS


def timed(work: Callable[[], object], seconds: float) -> float:
    """Return the processor time of one call [µs]: the median of seven means.

    Args:
        work: The call.
        seconds: Duration of each mean [s].
    """
    means = []
    for _ in range(7):
        calls, start = 0, time.process_time()
        while (spent := time.process_time() - start) < seconds / 7 or calls < 3:
            work()
            calls += 1
        means.append(spent / calls)
    return 1e6 * float(np.median(means))


def profile(flown: Fleet, seconds: float) -> dict[str, float]:
    """Return the processor time of a step of the fleet and of its parts [µs]."""
    whole, count = timed(steps_of(flown), seconds), flown.count
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (count, ACTIONS))
    noise, every = np.zeros((count, OBSERVATIONS)), flown._all
    outcome = Outcome(
        np.zeros(count, np.float32), np.zeros((FLAGS, count), np.bool_), np.zeros((count, len(TERMS)))
    )
    flown.reset()
    held = np.zeros_like(flown._commands)
    parts: dict[str, Callable[[], Any]] = {
        "thruster allocation": lambda: command_kernel(
            *flown._mixing, actions.copy(), np.empty(ACTIONS), flown._commands
        ),
        "plant": lambda: flown.plant.step(held),
        "random numbers": lambda: flown._noise.standard_normal((count, OBSERVATIONS)),
        "sonar and observations": lambda: sense_kernel(
            every, flown._senses, flown._motion, flown._scenes, noise, flown._least, flown._now
        ),
        "collisions, reward, ends of episodes": lambda: step_kernel(
            flown._rules, flown._motion, flown._scenes, flown._episodes, actions, outcome
        ),
    }
    found = {name: timed(part, seconds) for name, part in parts.items()}
    return {"whole step": whole} | found | {"new episodes, histories, Python": whole - sum(found.values())}


def engines_of(found: dict[str, Any], count: int) -> Rows:
    """Return rows of the kept table: speed of both engines and their ratio, by condition."""
    rows: Rows = []
    for condition, words in CASES.items():
        slow, fast = (found[f"{condition}, {engine}"] for engine in ENGINES)
        low, ratio, high = np.quantile(fast / slow, [0.25, 0.5, 0.75])
        rows.append(
            {
                "vehicles": count,
                "physics": f"{condition}: {words}",
                "MuJoCo, 500 Hz": f"{np.median(slow):,.0f}",
                "kernels, RK4 at 10 ms": f"{np.median(fast):,.0f}",
                "kernels / MuJoCo": f"{ratio:.1f} [{low:.1f}, {high:.1f}]",
            }
        )
    return rows


def show(rows: Rows) -> None:
    """Print rows as a table."""
    print(f"| {' | '.join(rows[0])} |\n|{'---|' * len(rows[0])}")
    for row in rows:
        print(f"| {' | '.join(map(str, row.values()))} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, action="append", help="vehicles; repeat for several")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--seconds", type=float, default=0.15, help="of every case in every round")
    parser.add_argument("--quick", action="store_true", help="short test run; the figures are meaningless")
    parser.add_argument("-o", "--out", type=Path, help="write the rows as .parquet or .json")
    parser.add_argument("--keep", metavar="NAME", help="write benchmarks/results/NAME.csv")
    parser.add_argument("--commit", default="", help="measured commit, for --keep")
    chosen = parser.parse_args()
    Clock.of_the_processor()
    rounds, seconds = (2, 0.005) if chosen.quick else (chosen.rounds, chosen.seconds)
    vehicle = files.read(bundled("vehicles") / "auv151.toml")[0]
    model = bare(vehicle)
    results: Rows = []
    table: Rows = []
    for count in chosen.count or (8, 64):
        flown = {
            f"{condition}, {engine}": fleet(vehicle, condition, engine, count)
            for condition, engine in product(CASES, ENGINES)
        }
        cases: dict[str, Callable[[float], float]] = {"bare": partial(silenced, bare_steps(model, count))}
        cases |= {name: partial(rate, steps_of(one)) for name, one in flown.items()}
        found = interleaved(cases, rounds, seconds)
        results += rows_of(found, "environment", count, 1, "control steps")
        table += engines_of(found, count)
        for engine in ENGINES:
            name = f"{conditions.EFFECTS}, {engine}"
            parts = profile(flown[name], 2.0 * seconds)
            print(
                f"\nProcessor time of a step of {count} vehicles, {name}\n\n"
                "| part | µs | share |\n|---|---:|---:|"
            )
            for part, spent in parts.items():
                print(f"| {part} | {spent:.1f} | {spent / parts['whole step']:.2f} |")
    print(f"\nControl steps per second of processor time, MuJoCo {mujoco.__version__}, {rounds} rounds\n")
    show(table)
    if chosen.out:
        write(results, chosen.out)
    if chosen.keep:
        timed = {"rounds": rounds, "seconds": float(seconds), "keep": chosen.keep}
        keep_timed("environment.py", chosen.keep, table, chosen.commit, 1, **timed)


if __name__ == "__main__":
    main()
