"""Baseline that learns accelerations by a small network, and names no effect."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import polars as pl
import torch

from benchmarks.challenge.layout import Public
from benchmarks.rivals.contest import Held
from benchmarks.rivals.sindy import VELOCITY, turned
from hydro.core.distillation.labels import labels
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation
from hydro.core.vehicle.thrusters import configuration_matrix

HIDDEN, STEPS, RATE = 48, 400, 5e-3
"""Width of two hidden layers, full-batch steps of Adam and their rate: a few seconds of training."""
DECAY = 1e-4
"""Weight decay, which matters with this little data."""
EVERY, EDGE = 3, 10
"""Step between the rows that are learnt, and rows left out at the ends of a session."""


def of_network(vehicle: Vehicle, public: Public, held: Held) -> tuple[list[dict[str, Any]], np.ndarray]:
    """Train a network on the log, and predict with the network alone; name no effect."""
    parts = labels(vehicle, public.log).partition_by("session", maintain_order=True)
    table = pl.concat([part[EDGE:-EDGE].gather_every(EVERY) for part in parts])
    nu = table.select([f"{name}_s" for name in VELOCITY]).to_numpy().astype(float)
    R = rotation(*table.select("phi", "theta", "psi").to_numpy().astype(float).T)
    inputs = features(nu, R, wrenches(vehicle, table))
    outputs = table.select([f"{name}_dot" for name in VELOCITY]).to_numpy().astype(float)
    accelerations = trained(inputs, outputs)
    return [], predicted(accelerations, wrenches(vehicle, labels(vehicle, held.raw)), held)


def features(nu: np.ndarray, R: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Return the inputs of the network, (N, 21): velocity, attitude as a matrix, and thrust."""
    return np.hstack([nu, R.reshape(-1, 9), wrench])


def wrenches(vehicle: Vehicle, table: pl.DataFrame) -> np.ndarray:
    """Return the wrench of the file's thrusters in every row, (N, 6) [N, N m]."""
    thrusts = table.select([f"f_{i + 1}" for i in range(len(vehicle.thruster))]).to_numpy().astype(float)
    return thrusts @ configuration_matrix(vehicle).T


def trained(inputs: np.ndarray, outputs: np.ndarray) -> Any:
    """Return a function from inputs (N, k) to outputs, a network fitted to the given pairs."""
    torch.manual_seed(0)
    middle, size = inputs.mean(axis=0), inputs.std(axis=0) + 1e-6
    offset, scale = outputs.mean(axis=0), outputs.std(axis=0) + 1e-9
    x, y = (
        torch.tensor(one, dtype=torch.float32)
        for one in ((inputs - middle) / size, (outputs - offset) / scale)
    )
    wide = [inputs.shape[1], HIDDEN, HIDDEN]
    layers: list[torch.nn.Module] = []
    for before, after in itertools.pairwise(wide):
        layers += [torch.nn.Linear(before, after), torch.nn.Tanh()]
    network = torch.nn.Sequential(*layers, torch.nn.Linear(HIDDEN, outputs.shape[1]))
    descent = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
    for _ in range(STEPS):
        descent.zero_grad()
        loss = ((network(x) - y) ** 2).mean()
        loss.backward()
        descent.step()

    def of(these: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            scaled = torch.tensor((these - middle) / size, dtype=torch.float32)
            return np.asarray(network(scaled).numpy(), float) * scale + offset

    return of


def predicted(accelerations: Any, wrench: np.ndarray, held: Held) -> np.ndarray:
    """Return the velocities (S, L, 6) of S predictions of L rows, integrated by Euler's method.

    Args:
        accelerations: Function from the inputs of the network to accelerations.
        wrench: Wrench of the thrusters in every row (N, 6) [N, N m].
        held: Held-out windows.
    """
    dt, starts = held.record.dt, held.starts
    nu, R = held.nu[starts].copy(), rotation(*held.eta[starts, 3:].T)
    out = np.empty((starts.size, held.length, 6))
    for k in range(held.length):
        out[:, k] = nu
        change = accelerations(features(nu, R, wrench[starts + k]))
        R = turned(R, nu[:, 3:] * dt)
        nu = np.clip(nu + dt * change, -1e2, 1e2)
    return out
