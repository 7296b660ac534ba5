"""Output error with scipy: a full Fossen model fitted to short predictions names the changed parameters.

`scipy.optimize.least_squares` fits all parameters together in the benchmark's own simulator: added mass,
linear and quadratic damping on six axes, current, buoyancy and its centre, a gain per thruster, lag and
delay.  The fit
starts from the file's values with a wide prior, since a common scale of all forces and inertias is free.
Predictions start from the smoothed motion.  The named group is the one whose parameters moved most in
standard errors; none if none moved by four.  Jategaonkar: Flight Vehicle System Identification, 2nd ed., AIAA
2015, ch. 4.

    python -m benchmarks.rivals.output_error --studies 30 -o rivals.parquet
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from numba import njit
from scipy.optimize import least_squares

from benchmarks.hidden_effects.build import build
from benchmarks.hidden_effects.plant import BODY, Array, Plant, onward, resting, settled
from benchmarks.rivals.contest import Answer, Held, main, weighed
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.recording.arrays import Recording, noise, recording, smoothed
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import quaternion_from_euler

SHOTS, SECONDS = 24, 4.0
"""Number of fitted predictions, spread over the log, and their length [s]."""
EVERY = 5  # step between compared rows
EVALUATIONS = 12  # of the residuals and their derivatives
MOVED = 4.0
"""Minimum change of a named group, in standard errors."""


@dataclass(frozen=True)
class Group:
    """Parameters of one effect, as changes from the file's values.

    Attributes:
        name: Name of the effect.
        scales: Typical size of each parameter.
        low: Lower bound of the change, in scales.
    """

    name: str
    scales: Array
    low: float = -np.inf


def parameters(vehicle: Vehicle) -> list[Group]:
    """Return the fitted parameters, as changes from the file's values."""
    mass, moment = vehicle.rigid_body.mass, float(np.trace(np.array(vehicle.rigid_body.inertia)) / 3)
    sizes = np.repeat([mass, moment], 3)
    return [
        Group("added_mass", 0.3 * sizes),
        Group("linear_damping", 0.3 * sizes),
        Group("quadratic_damping", 0.5 * sizes),
        Group("ocean_current", np.array([0.3, 0.3, 0.05])),
        Group("net_buoyancy", np.array([0.02 * 9.81 * mass])),
        Group("buoyancy_offset", np.full(3, 0.01)),
        Group("thruster_gain", np.full(len(vehicle.thruster), 0.2)),
        Group("thruster_lag", np.array([0.1])),
        Group("command_delay", np.array([0.1]), low=0.0),
    ]


def changed(plant: Plant, groups: list[Group], x: Array) -> Plant:
    """Return the plant with the changes x of the groups' parameters, in scales."""
    parts = np.split(x, np.cumsum([group.scales.size for group in groups])[:-1])
    d = {group.name: part * group.scales for group, part in zip(groups, parts, strict=True)}
    added = plant.added + np.diag(d["added_mass"])
    weights, chains = plant.weights.copy(), plant.chains.copy()
    weights[-1, 1:] += d["buoyancy_offset"]
    chains[:, 2] = np.maximum(chains[:, 2] + d["thruster_lag"], 1e-3)
    return plant._replace(
        added=added,
        inverse=np.linalg.inv(plant.rigid + added),
        linear=plant.linear + np.diag(d["linear_damping"]),
        quadratic=plant.quadratic + d["quadratic_damping"],
        current=plant.current + d["ocean_current"],
        lifted=plant.lifted + np.array([d["net_buoyancy"][0], *d["buoyancy_offset"]]),
        weights=weights,
        gains=plant.gains + d["thruster_gain"],
        chains=chains,
        delay=max(plant.delay + float(d["command_delay"][0]), 0.0),
    )


@njit(cache=True)
def predict(plant: Plant, first: Array, at: Array, commands: Array, length: int, dt: float) -> Array:
    """Return the states (S, length, 13) of predictions from `first` (S, 13) at rows `at` of one log."""
    count = plant.gains.size
    out = np.full((at.size, length, BODY), np.nan)
    for i in range(at.size):
        y = resting(plant, first[i])
        whole = int(plant.delay / dt)
        for k in range(max(at[i] - 100, 0), at[i]):  # two seconds of the rotors' past
            target = settled(plant, commands[max(k - whole, 0)])
            for j in range(count):
                y[BODY + j] += (target[j] - y[BODY + j]) * (1.0 - np.exp(-dt / plant.chains[j, 2]))
        for k in range(length):
            if not np.abs(y).max() < 1e6:
                break
            out[i, k] = y[:BODY]
            y = onward(plant, y, commands, at[i] + k, dt)
    return out


def beginnings(record: Recording, eta: Array, nu: Array, at: Array) -> Array:
    """Return the states of the body (S, 13) in the smoothed motion."""
    return np.hstack([eta[at, :3], quaternion_from_euler(*eta[at, 3:].T), nu[at]])


def answer(given: Vehicle, measured: pl.DataFrame) -> Answer:
    """Fit all groups of parameters to the log, and name the group that moved most."""
    record, plant, groups = recording(given, measured), build(given), parameters(given)
    eta, nu = smoothed(record)
    length = round(SECONDS / record.dt)
    room = np.concatenate([np.arange(a, b - length, length) for a, b in record.segments])
    at = room[np.unique(np.linspace(0, room.size - 1, SHOTS).astype(int))]
    first, rows = beginnings(record, eta, nu, at), at[:, None] + np.arange(0, length, EVERY)
    sigma = noise(record)

    def residual(x: Array) -> Array:
        states = predict(changed(plant, groups, x), first, at, record.commands, length, record.dt)[:, ::EVERY]
        off = np.concatenate(
            [
                (states[..., :3] - record.eta[rows, :3]) / sigma[:3],
                (states[..., 7:] - record.nu[rows]) / sigma[6:],
            ],
            axis=-1,
        )
        return np.append(np.clip(np.nan_to_num(off, nan=1e4), -1e4, 1e4), x)  # a scale is its standard error

    low = np.concatenate([np.full(group.scales.size, group.low) for group in groups])
    start = np.where(np.isfinite(low), 1e-3, 0.0)
    # About 1, since scipy scales its first trust region and its differences with the initial value.
    found = least_squares(
        lambda about: residual(about - 1.0),
        1.0 + start,
        bounds=(1.0 + low, np.inf),
        diff_step=1e-4,
        max_nfev=EVALUATIONS,
    )
    x = found.x - 1.0
    spread = np.linalg.pinv(found.jac.T @ found.jac) * (2.0 * found.cost / found.fun.size)
    moved = (x - start) / np.sqrt(np.maximum(np.diag(spread), 1e-12))
    parts = np.split(moved, np.cumsum([group.scales.size for group in groups])[:-1])
    sizes = [float(np.sqrt(np.mean(part**2))) for part in parts]
    best = int(np.argmax(sizes))
    fitted = changed(plant, groups, x)
    return Answer(
        groups[best].name if sizes[best] >= MOVED else "",
        lambda errors, _: error(fitted, errors),
        lambda held: predicted(fitted, held),
    )


def error(plant: Plant, errors: Ahead) -> float:
    """Return the prediction error 5 s ahead on the held-out session."""
    held = Held.of(errors, pl.DataFrame())
    return weighed(errors, held.starts, predicted(plant, held))


def predicted(plant: Plant, held: Held) -> Array:
    """Return the velocities of all predictions, (S, L, 6)."""
    record = held.record
    first = beginnings(record, held.eta, held.nu, held.starts)
    states: Array = predict(plant, first, held.starts, record.commands, held.length, record.dt)
    return states[..., 7:]


if __name__ == "__main__":
    main("output error", answer, __doc__ or "")
