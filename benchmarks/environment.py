"""Speed of the environment, compared with bare MuJoCo with the same vehicles.

Eight vehicles get a new action each at 25 Hz, with physics at 500 Hz on two threads.  Control steps per
second of all vehicles together:

    bare        MuJoCo alone, as in benchmarks/student.py: the body and plain first-order thrusters
    R_…         the whole environment under a condition: mixing, physics, sonar, observations, noise,
                collisions, reward, and new episodes

A round times every case once, in alternating order.  Results are medians over rounds, and medians of each
round's ratio to its bare MuJoCo.  The profile then divides the processor time of a step on one thread, which
a busy machine does not change.  Every part is timed by itself, on the arrays of a step.  Networks have random
weights, which do not affect their cost.

    python benchmarks/environment.py -o environment.parquet
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
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
    without_callbacks,
    write,
)

from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.rl.environment import conditions
from hydro.rl.environment.action import ACTIONS, command_kernel
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.observation import OBSERVATIONS
from hydro.rl.environment.step import sense_kernel
from hydro.rl.world.config import Settings

SUBSTEPS = 20
WIDTHS = {"mlp": (12, *PHYSFEAT[1:]), "physfeat": PHYSFEAT}


def fleets(settings: Settings, count: int, threads: int) -> dict[str, Fleet]:
    """A fleet under each condition, in a row of eight pillars."""
    vehicle = files.read(bundled("vehicles") / "auv151.toml")[0]
    found = {}
    for condition in (conditions.NO_WATER, *conditions.MODELS, conditions.EFFECTS):
        kind = conditions.MODELS.get(condition)
        if kind is not None and kind not in WIDTHS:
            continue
        model = None if kind is None else random_model(kind, WIDTHS[kind])
        known = conditions.Condition(condition, model)
        plant = conditions.plant(known, vehicle, settings, count, threads=threads)
        found[condition] = Fleet(settings, plant)
        found[condition].set_level("pillar_row", 8)
        found[condition].reset()
    return found


def steps_of(fleet: Fleet) -> Work:
    """Return a step of a fleet under random actions, which end more episodes than any policy."""
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (256, fleet.count, ACTIONS))
    tick = 0

    def step() -> int:
        nonlocal tick
        fleet.step(actions[tick % len(actions)])
        tick += 1
        return fleet.count

    return step


def bare_steps(model: mujoco.MjModel, count: int, threads: int) -> Work:
    """Control steps of bare MuJoCo."""
    work = side_by_side(model, count, threads)
    return lambda: work() // SUBSTEPS


def timed(work: Callable[[], object], seconds: float) -> float:
    """Microseconds of the processor that a call takes: the median of seven means."""
    means = []
    for _ in range(7):
        calls, start = 0, time.process_time()
        while (spent := time.process_time() - start) < seconds / 7 or calls < 3:
            work()
            calls += 1
        means.append(spent / calls)
    return 1e6 * float(np.median(means))


def profile(fleet: Fleet, seconds: float) -> dict[str, float]:
    """Microseconds of a step of the fleet, and of its parts."""
    work, plant = steps_of(fleet), fleet.plant
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (fleet.count, ACTIONS))
    noise = np.zeros((fleet.count, OBSERVATIONS))
    parts = {
        "actions to commands": lambda: command_kernel(
            *fleet._mixing, actions.copy(), np.empty(ACTIONS), fleet._commands
        ),
        "physics": lambda: plant._student.march(SUBSTEPS),
        "motion in NED and FRD": lambda: plant._read(fleet._all),
        "random numbers": lambda: fleet._noise.standard_normal((fleet.count, OBSERVATIONS)),
        "sonar and observations": lambda: sense_kernel(
            fleet._all, fleet._senses, fleet._motion, fleet._scenes, noise, fleet._least, fleet._now
        ),
    }
    found = {"whole step": timed(work, seconds)}
    fleet.reset()
    found |= {name: timed(part, seconds) for name, part in parts.items()}
    rest = found["whole step"] - sum(found[name] for name in parts)
    return found | {"collisions, reward, ends of episodes, Python": rest}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=8, help="vehicles")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--seconds", type=float, default=0.15, help="of every case in every round")
    parser.add_argument("--quick", action="store_true", help="see that it runs; the figures mean nothing")
    parser.add_argument("--processor", action="store_true", help="by processor time, as student.py has it")
    parser.add_argument("-o", "--out", type=Path, help="write the rows as .parquet or .json")
    chosen = parser.parse_args()
    if chosen.processor:
        Clock.of_the_processor()
    rounds, seconds = (2, 0.005) if chosen.quick else (chosen.rounds, chosen.seconds)
    flown = fleets(Settings(), chosen.count, chosen.threads)
    model = bare(files.read(bundled("vehicles") / "auv151.toml")[0])
    cases: dict[str, Callable[[float], float]] = {
        "bare": partial(silenced, bare_steps(model, chosen.count, chosen.threads))
    }
    cases |= {name: partial(rate, steps_of(fleet)) for name, fleet in flown.items()}
    found, sharing = interleaved(cases, rounds, seconds), min(chosen.threads, chosen.count)
    results: Rows = rows_of(found, "environment", chosen.count, chosen.threads, "control steps", sharing)
    setting = f"{chosen.count} vehicles, {chosen.threads} threads, MuJoCo {mujoco.__version__}"
    print(f"{setting}, medians of {rounds} rounds\n")
    print("| case | control steps per second | share of bare MuJoCo |\n|---|---:|---:|")
    for row in results:
        share = f"{row['ratio']:.2f} [{row['ratio_low']:.2f}, {row['ratio_high']:.2f}]"
        print(f"| {row['case']} | {row['per_second']:,.0f} | {share} |")
    with without_callbacks():
        alone = timed(bare_steps(model, chosen.count, 1), 4.0 * seconds)
    print(f"\nProcessor time of a step of all vehicles; bare MuJoCo's is {alone:.0f} µs")
    for name, fleet in fleets(Settings(), chosen.count, 1).items():
        parts = profile(fleet, 4.0 * seconds)
        print(f"\n| {name}: {alone / parts['whole step']:.2f} of bare MuJoCo | µs | share |\n|---|---:|---:|")
        for part, spent in parts.items():
            print(f"| {part} | {spent:.1f} | {spent / parts['whole step']:.2f} |")
    if chosen.out:
        write(results, chosen.out)


if __name__ == "__main__":
    main()
