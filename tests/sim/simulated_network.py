"""Comparison of residual networks on a GPU (or its simulator) with MuJoCo, run by `test_gpu`.

Prints one line of JSON: the distance covered by the vehicles, and the difference of the two.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import msgspec
import numpy as np
from sim.trained import trained

from hydro.core.errors import UsageError
from hydro.core.residual.network import Network
from hydro.io import vehicle as files
from hydro.sim.bridge.water import dry, residual
from hydro.sim.gpu.plant import GpuPlant
from hydro.sim.plant import StudentPlant
from hydro.sim.residual.conditioning import preset
from hydro.sim.residual.control import Control
from hydro.sim.student import Physics

COUNT, STEPS, PERIOD = 2, 10, 0.04
CURRENT = {"name": "ocean_current", "v_N": 0.3, "v_E": -0.2}


def craft(path: Path):
    """Return the vehicle without delays, which MuJoCo rounds to its steps."""
    known = files.read(path)[0]
    thrusters = tuple(msgspec.structs.replace(one, delay=0.0) for one in known.thruster)
    return msgspec.structs.replace(known, thruster=thrusters)


def learnt(kind: str) -> Network:
    """Return a network with random weights and a wrench of a few newtons."""
    _, artefact = trained(kind)
    artefact.scalers = artefact.scalers | {"output_mean": np.full(6, 2.0), "output_scale": np.full(6, 9.0)}
    return Network.of(artefact)


def waters(known) -> dict[str, object]:
    """Return the water models of the vehicles by name."""

    def control(kind: str, conditioning: str = "off") -> Control:
        return Control(learnt(kind), PERIOD, conditioning=preset(conditioning, known))

    return {
        "no water": dry,
        "physfeat": lambda one: residual(one, control("physfeat")),
        "physfeat, conditioned": lambda one: residual(one, control("physfeat", "paper")),
        "temporal": lambda one: residual(one, control("temporal")),
        "structured": lambda one: residual(one, control("structured")),
        "mlp beside effects": lambda one: residual(one, control("mlp"), effects=True),
        "mlp in a current": lambda one: residual(one, control("mlp"), beside=[CURRENT]),
    }  # fmt: skip


def flown(plant, commands) -> np.ndarray:
    """Return pose and velocity (N, 13) of the vehicles after some steps."""
    rng = np.random.default_rng(5)
    pose = np.tile([0.0, 0.0, 4.0, 1.0, 0.0, 0.0, 0.0], (COUNT, 1))
    plant.reset(np.ones(COUNT, dtype=bool), pose, rng.uniform(-0.4, 0.4, (COUNT, 6)))
    for told in commands:
        plant.step(told)
    return np.hstack([plant.pose, plant.velocity])  # in the simulator both are arrays of the host


def main() -> None:
    known = craft(Path(sys.argv[1]))
    commands = np.random.default_rng(6).uniform(-0.6, 0.6, (STEPS, COUNT, len(known.thruster)))
    found = {}
    still = None
    for name, water in waters(known).items():
        there = flown(GpuPlant(known, water, count=COUNT, period=PERIOD, timestep=0.008), commands)
        here = flown(
            StudentPlant(known, water, count=COUNT, physics=Physics(0.001, "rk4"), period=PERIOD), commands
        )
        still = there if still is None else still
        found[name] = {
            "apart": float(np.abs(there - here).max()),
            "of_the_network": float(np.abs(there - still).max()),
        }
    refused = []
    for water, period in ((lambda one: residual(one), PERIOD), (waters(known)["physfeat"], 0.03)):
        try:
            GpuPlant(known, water, count=1, period=period)
        except UsageError as error:
            refused.append(str(error))
    heavier = msgspec.structs.replace(
        known, rigid_body=msgspec.structs.replace(known.rigid_body, mass=1.1 * known.rigid_body.mass)
    )
    plant = GpuPlant(known, waters(known)["physfeat"], count=COUNT, period=PERIOD)
    plant.change({1: heavier})
    flown(plant, commands[:1])
    kept = plant.snapshot()
    plant.step(commands[1])
    ahead = plant.snapshot()
    plant.restore(kept)
    plant.step(commands[1])
    again = plant.snapshot()
    print(
        json.dumps(
            {
                "flights": found,
                "refused": refused,
                "back": all(np.array_equal(ahead[name], again[name]) for name in ahead),
                "remembers": float(np.abs(ahead["control"]).max()),
            }
        )
    )


if __name__ == "__main__":
    main()
