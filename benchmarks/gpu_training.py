"""Training time of a task entirely on a GPU: vehicles, sonar, rewards, networks and memory.

Soft actor-critic of `hydro.rl.gpu` trains until 97 % of new episodes succeed without exploration, one episode
per vehicle.  Seeds run one after another in one process, so only the first includes compilation.  With
`--device cpu` the same learner trains with MuJoCo on the processor, as a baseline.

Each seed creates a folder with a policy, which `hydro rl eval` tests in the MuJoCo model and in the reference
simulator.

    python benchmarks/gpu_training.py -o trained
    python benchmarks/gpu_training.py --device cpu --vehicles 128 --updates 4 --batch 512 -o trained_cpu
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import torch

from hydro.core.errors import HydroError
from hydro.io import table
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.rl.environment.environments import FleetConfig, make_fleet
from hydro.rl.environment.observation import encoding
from hydro.rl.environment.torch_env import Batch, FleetEnv
from hydro.rl.gpu.learner import DeviceLearner
from hydro.rl.tasks.registry import task_of
from hydro.rl.training.config import Curriculum, SACConfig, TrainingConfig
from hydro.rl.training.runs import POLICY, RUN, policy_artefact, run_artefact
from hydro.rl.training.train import EXAM_SEED
from hydro.rl.world.config import Settings

PASSED = 0.97  # success rate at which a training ends


def environment(device: str, vehicle: str, task: str, count: int, seed: int) -> Batch:
    """Return an environment with `count` vehicles of a preset at a task's highest level."""
    if device == "cpu":
        return FleetEnv(make_fleet(FleetConfig(task, vehicle=vehicle), count=count, seed=seed))
    from hydro.rl.gpu.env import GpuEnv
    from hydro.rl.gpu.fleet import GpuFleet

    known = files.read(bundled("vehicles") / f"{vehicle}.toml")[0]
    return GpuEnv(GpuFleet(Settings(), known, count=count, seed=seed, task=task))


def trained(chosen: argparse.Namespace, config: TrainingConfig, exam: Batch) -> tuple[Any, dict[str, Any]]:
    """Train until the learner passes or runs out of steps; return the learner and its results."""
    env = environment(chosen.device, chosen.vehicle, chosen.task, config.vehicles, config.seed)
    learner = DeviceLearner(env, encoding(config.settings), config.sac, config.seed)
    limit = task_of(chosen.task).steps(config.settings)
    began, examining, share, last = time.perf_counter(), 0.0, 0.0, 0
    while share < PASSED and learner.steps < config.steps:
        learner.advance()
        if learner.updates - last < chosen.examine:
            continue
        last, at = learner.updates, time.perf_counter()
        share = learner.success(exam, limit)
        examining += time.perf_counter() - at
        spent = time.perf_counter() - began
        print(f"seed {config.seed}: {spent:.1f} s, {learner.steps:,} steps, {learner.updates:,} updates: "
              f"{share:.1%} succeed", flush=True)  # fmt: skip
    return learner, {
        "device": chosen.device,
        "task": chosen.task,
        "seed": config.seed,
        "seconds": time.perf_counter() - began,
        "examining": examining,
        "steps": learner.steps,
        "updates": learner.updates,
        "success": share,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--vehicle", default="auv151", help="preset")
    parser.add_argument("--task", default="point_to_point")
    parser.add_argument("--vehicles", type=int, default=1024)
    parser.add_argument(
        "--updates", type=int, default=16, help="gradient updates per control step of all vehicles"
    )
    parser.add_argument("--batch", type=int, default=2048)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument(
        "--steps", type=int, default=20_000_000, help="maximum number of steps of all vehicles together"
    )
    parser.add_argument("--examine", type=int, default=500, help="updates between two examinations")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for policies and table.parquet")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    learner = SACConfig(
        layers=(128, 128), norm=True, batch=chosen.batch, updates=chosen.updates, random=5 * chosen.vehicles
    )
    plain = TrainingConfig(
        vehicles=chosen.vehicles, steps=chosen.steps, sac=learner, curriculum=Curriculum(task=chosen.task),
        record=4 * chosen.vehicles, evaluate=20 * chosen.vehicles,
    )  # fmt: skip
    text = (bundled("vehicles") / f"{chosen.vehicle}.toml").read_text()
    rows = []
    try:
        exam = environment(chosen.device, chosen.vehicle, chosen.task, chosen.vehicles, EXAM_SEED)
        for seed in range(chosen.seeds):
            config = replace(plain, seed=seed)
            taught, row = trained(chosen, config, exam)
            rows.append(row)
            folder = chosen.out / f"seed-{seed}"
            folder.mkdir(parents=True, exist_ok=True)
            words = {"steps": taught.steps, "levels_passed": int(row["success"] >= PASSED)}
            words |= dict(zip(("task", "level"), config.curriculum.levels[0], strict=True))
            run = run_artefact(config, text)
            table.write(run, folder / RUN)
            table.write(policy_artefact(taught.policy(words), run, seed), folder / POLICY)
            pl.DataFrame(rows).write_parquet(chosen.out / "table.parquet")
    except HydroError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
