"""Comparison of a fleet on a GPU (or its simulator) with the processor's, run by `test_gpu_fleet`.

Prints one line of JSON: the differences of the two, and other observations.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from sim.trained import trained

from hydro.core.errors import UsageError
from hydro.io import vehicle as files
from hydro.rl.environment.conditions import Condition, waters
from hydro.rl.environment.fleet import Fleet
from hydro.rl.gpu import fleet
from hydro.rl.gpu.env import GpuEnv
from hydro.rl.gpu.fleet import GpuFleet
from hydro.rl.world.config import Episode, Noise, Randomisation, Settings
from hydro.sim.gpu.plant import GpuPlant

COUNT, STEPS = 6, 14
SILENT = Settings(noise=Noise(0.0, 0.0, 0.0, 0.0), task=Episode(steps=6))


class Plant:
    """Plant of the GPU fleet with the interface of the processor's: live arrays of the host."""

    def __init__(self, vehicle, condition):
        water = waters(condition, vehicle, SILENT.period)
        self._flying = GpuPlant(vehicle, water, count=COUNT, period=SILENT.period, timestep=0.02)
        self.vehicle, self._readings = vehicle, self._flying.readings()
        self.pose, self.velocity, self.specific_force, self.thrust, self.diverged = self._readings

    def _renew(self):
        for array, now in zip(self._readings, self._flying.readings(), strict=True):
            array[:] = now

    def reset(self, mask, pose, velocity):
        self._flying.reset(mask, pose, velocity)
        self._renew()

    def step(self, commands, flying=None):
        self._flying.step(commands)
        self._renew()


def beside(vehicle, task, level) -> dict[str, float]:
    """Return the largest differences over steps with several resets of every vehicle, with a network."""
    condition = Condition("R_MLP", trained("mlp")[1])
    flown = {"count": COUNT, "seed": 3, "task": task, "level": level, "timestep": 0.02}
    ours = GpuFleet(SILENT, vehicle, condition=condition, **flown)
    theirs = Fleet(SILENT, Plant(vehicle, condition), seed=3)
    theirs.set_level(task, level)
    rng = np.random.default_rng(4)
    seen = [np.abs(ours.reset().cpu().numpy() - theirs.reset()).max()]
    paid, ended, same = [], 0, True
    for _ in range(STEPS):
        actions = rng.uniform(-1.4, 1.4, (COUNT, 6))
        step = theirs.step(actions)
        ours.step(torch.from_numpy(actions))
        seen.append(np.abs(ours.observations.cpu().numpy() - step.final_obs).max())
        paid.append(np.abs(ours.reward.cpu().numpy() - step.reward).max())
        told = step.info.success, step.info.collision, step.info.diverged
        flags = np.array([*told, step.info.overspeed, step.terminated, step.truncated])
        same &= np.array_equal(ours.flags.cpu().numpy(), flags)
        done = step.terminated | step.truncated
        ended += int(done.sum())
        if done.any():
            ours.reset(torch.from_numpy(done))
            seen.append(np.abs(ours.observations.cpu().numpy() - step.obs).max())
    return {"seen": float(max(seen)), "paid": float(max(paid)), "same": bool(same), "ended": ended}


def wrapped(vehicle) -> dict[str, object]:
    """Return the fleet as a TorchRL environment."""
    from torchrl.envs.utils import check_env_specs

    env = GpuEnv(GpuFleet(replace(SILENT, noise=Noise()), vehicle, count=3, timestep=0.04))
    check_env_specs(env)
    start = env.reset()
    done, after = env.step_and_maybe_reset(start.set("action", torch.zeros(3, 6, device=env.device)))
    lost = torch.zeros(3, 6, device=env.device)
    lost[1] = torch.nan
    done, after = env.step_and_maybe_reset(after.set("action", lost))
    return {
        "lost": done["next", "diverged"].flatten().tolist(),
        "over": done["next", "terminated"].flatten().tolist(),
        "anew": bool(torch.isfinite(after["observation"]).all()),
        "kept": bool((done["next", "observation"][0] == after["observation"][0]).all()),
    }


def refused(vehicle) -> list[str]:
    """Return the error messages of unsupported settings."""
    said = []
    for settings, task in (
        (replace(SILENT, history=2), "point_to_point"),
        (replace(SILENT, randomise=Randomisation(load=0.1)), "point_to_point"),
        (SILENT, "forest"),
        (SILENT, "circle"),
    ):
        try:
            GpuFleet(settings, vehicle, count=2, task=task)
        except UsageError as error:
            said.append(str(error))
    return said


def main() -> None:
    fleet.POOL = 60  # of 16,384 scenes, whose drawing would take all the time
    vehicle = files.read(Path(sys.argv[1]))[0]
    row = beside(vehicle, "pillar_row", 8)
    print(json.dumps({"row": row, "env": wrapped(vehicle), "refused": refused(vehicle)}))


if __name__ == "__main__":
    main()
