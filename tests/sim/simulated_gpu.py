"""Comparison of vehicles on a GPU (or its simulator) with `simulate`, run by `test_gpu` in a process.

Prints one line of JSON: the largest differences, and other observations.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import msgspec
import numpy as np
import polars as pl
from effects import DT, EFFECTS, NU, with_effect

import hydro
from hydro.core.columns import POSE, VELOCITY, command_columns
from hydro.core.vehicle.frames import euler_from_quaternion, quaternion_from_euler
from hydro.io import vehicle as files

COUNT, ROWS = 12, 9


def crafts(path: Path) -> list[hydro.core.vehicle.description.Vehicle]:
    """Return two vehicles with all effects of the shared tests, with different numbers."""
    known = files.read(path)[0]
    for name in EFFECTS:
        known = with_effect(known, name)
    heavier = msgspec.structs.replace(known.rigid_body, mass=1.1 * known.rigid_body.mass)
    return [known, msgspec.structs.replace(known, rigid_body=heavier)]


def begun(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (N, 6) with Euler angles, and velocities (N, 6)."""
    rng = np.random.default_rng(3)
    eta = rng.uniform(-0.5, 0.5, (count, 6)) + np.array([0, 0, 3, 0, 0, 0])
    return eta, NU + rng.uniform(-0.2, 0.2, (count, 6))


def told(vehicle, eta, nu, commands):
    """Return pose and velocity (N, 12) at the last row, by `simulate`."""
    frames = [
        pl.DataFrame(np.hstack([np.tile([*eta[k], *nu[k]], (len(held), 1)), held]),
                     schema=[*POSE, *VELOCITY, *command_columns(held.shape[1])])
        .with_columns(session=pl.lit(f"s{k:03d}"), t=np.arange(len(held)) * DT)
        for k, held in enumerate(commands)
    ]  # fmt: skip
    moved = hydro.simulate(vehicle, pl.concat(frames))
    return moved.group_by("session", maintain_order=True).last().select(*POSE, *VELOCITY).to_numpy()


def main() -> None:
    both = crafts(Path(sys.argv[1]))
    eta, nu = begun(COUNT)
    rng = np.random.default_rng(4)
    commands = rng.uniform(-0.8, 0.8, (COUNT, ROWS, len(both[0].thruster)))
    kind = rng.integers(0, 2, COUNT)
    plant = hydro.student(both[0], device="cuda", count=COUNT, period=DT, timestep=0.002)
    plant.change({int(k): both[1] for k in np.flatnonzero(kind)})
    everyone = np.ones(COUNT, dtype=bool)
    pose = np.hstack([eta[:, :3], quaternion_from_euler(*eta[:, 3:].T).reshape(COUNT, 4)])
    plant.reset(everyone, pose, nu)
    kept = None
    for k in range(ROWS - 1):
        kept = plant.snapshot() if k == ROWS - 3 else kept
        plant.step(commands[:, k])
    ended = plant.snapshot()
    pose_now, velocity_now = ended["pose"], ended["velocity"]
    flown = np.hstack([pose_now[:, :3], euler_from_quaternion(pose_now[:, 3:]), velocity_now])
    found = [told(one, eta, nu, commands) for one in both]
    wanted = np.where(kind[:, None] == 0, *found)
    plant.restore(kept)
    for k in range(ROWS - 3, ROWS - 1):
        plant.step(commands[:, k])
    again = plant.snapshot()
    plant.reset(~everyone | (np.arange(COUNT) == 5), pose, np.full((COUNT, 6), 1e200))
    lost = plant.readings().diverged.tolist()
    plant.reset(everyone, pose, nu)
    refused = []
    for wrong in (np.zeros((COUNT, 2)), np.zeros((3, commands.shape[2]))):
        try:
            plant.step(wrong)
        except hydro.core.errors.DataError as error:
            refused.append(str(error))
    print(
        json.dumps(
            {
                "difference": float(np.abs(flown - wanted).max()),
                "moved": float(np.abs(flown - np.hstack([eta, nu])).max(axis=1).min()),
                "kinds_apart": float(np.abs(found[0] - found[1]).max()),
                "states": int(plant.snapshot()["y"].shape[1]),
                "back": all(np.array_equal(ended[name], again[name]) for name in ended),
                "lost": [k for k, gone in enumerate(lost) if gone],
                "found_again": not plant.readings().diverged.any(),
                "refused": refused,
            }
        )
    )


if __name__ == "__main__":
    main()
