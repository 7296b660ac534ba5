"""Residual network: the file's model plus a network that learns the accelerations that the model lacks.

The labels are the unexplained forces of the log, `hydro labels --subtract effects`.  The network is that of
the challenge.  Its inputs are velocity, the direction of gravity and thrust; a heading that it could learn by
heart is not among them.  It names nothing.

    python -m benchmarks.rivals.residual_network --studies 30 -o rivals.parquet
"""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.challenge.network import EDGE, EVERY, trained, wrenches
from benchmarks.hidden_effects.build import build
from benchmarks.hidden_effects.plant import Array, Plant, onward, resting, settled
from benchmarks.rivals.contest import Answer, Held, main, weighed
from benchmarks.rivals.output_error import beginnings
from benchmarks.rivals.sindy import VELOCITY, WRENCH
from hydro.core.distillation.labels import labels
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.simulation.dynamics import BODY
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation, rotation_from_quaternion

PAST = 100
"""Rows before a prediction over which the rotors follow the commands: two seconds at 50 Hz."""


def answer(given: Vehicle, measured: pl.DataFrame) -> Answer:
    """Train the network on the log; predict with the file's model and the network."""
    plant = build(given)
    parts = labels(given, measured, subtract="effects").partition_by("session", maintain_order=True)
    table = pl.concat([part[EDGE:-EDGE].gather_every(EVERY) for part in parts])
    nu = table.select([f"{name}_s" for name in VELOCITY]).to_numpy().astype(float)
    R = rotation(*table.select("phi", "theta", "psi").to_numpy().astype(float).T)
    missing = table.select(WRENCH).to_numpy().astype(float) @ plant.inverse.T
    network = trained(inputs(nu, R, wrenches(given, table)), missing)

    def predict(held: Held) -> Array:
        return predicted(plant, network, wrenches(given, labels(given, held.raw)), held)

    def error(errors: Ahead, raw: pl.DataFrame) -> float:
        held = Held.of(errors, raw)
        return weighed(errors, held.starts, predict(held))

    return Answer("", error, predict)


def inputs(nu: Array, R: Array, wrench: Array) -> Array:
    """Return the inputs of the network, (N, 15): velocity, the world's down in body axes, and thrust."""
    return np.hstack([nu, R[:, 2], wrench])


def predicted(plant: Plant, network: Any, wrench: Array, held: Held) -> Array:
    """Return the velocities (S, L, 6) of all predictions; the network acts once per row."""
    record, starts = held.record, held.starts
    first = beginnings(record, held.eta, held.nu, starts)
    states = np.array([resting(plant, one) for one in first])
    chains = np.array([chain[2] for chain in plant.chains])
    begins = record.segments[np.searchsorted(record.segments[:, 1], starts, side="right"), 0]
    for state, start, begin in zip(states, starts, begins, strict=True):
        for k in range(max(start - PAST, begin), start):
            rotor = state[BODY : BODY + chains.size]
            rotor += (settled(plant, record.commands[k]) - rotor) * (1.0 - np.exp(-record.dt / chains))
    out = np.empty((starts.size, held.length, 6))
    for k in range(held.length):
        out[:, k] = states[:, 7:BODY]
        R = rotation_from_quaternion(states[:, 3:7])
        lacking = network(inputs(states[:, 7:BODY], R, wrench[starts + k]))
        for i, start in enumerate(starts):
            states[i] = onward(plant, states[i], record.commands, start + k, record.dt)
        states[:, 7:BODY] = np.clip(states[:, 7:BODY] + record.dt * lacking, -1e2, 1e2)
    return out


if __name__ == "__main__":
    main("residual network", answer, __doc__ or "")
