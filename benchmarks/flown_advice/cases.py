"""Recordings whose manoeuvre cannot identify the hidden effect: drawn from a seed alone, without feedback.

One manoeuvre is repeated in four sessions.  Motion ahead on one heading cannot separate a current, a tether,
weight and a bias of the DVL.  A circle at one speed cannot separate kinds of drag and lift.  Thrusters with
equal commands cannot separate gains, curves and losses.  The vehicle is the benchmark's own simulator, with
true damping.  The hidden effect causes a tenth of the error under a rich excitation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from numba import njit

from benchmarks.hidden_effects import vehicles
from benchmarks.hidden_effects.build import build
from benchmarks.hidden_effects.cases import Case, strong, weaker
from benchmarks.hidden_effects.flights import DT, angles, logged, table
from benchmarks.hidden_effects.plant import BODY, Plant, onward, resting
from hydro.core.columns import Array
from hydro.core.effects import validate
from hydro.core.errors import DataError
from hydro.core.experiment.library import library
from hydro.core.simulation.excitation import Session, demands
from hydro.core.vehicle.description import Vehicle

HEADING, SPEED, STEP = "one heading", "one speed", "thrusters in step"
FAMILIES: dict[str, tuple[str, ...]] = {
    HEADING: ("ocean_current", "tether", "sensor_bias", "net_buoyancy", "buoyancy_offset"),
    SPEED: ("body_lift", "crossflow_drag", "cross_axis_drag", "coupled_damping", "added_mass_coriolis"),
    STEP: ("thruster_gain", "thruster_inflow", "thruster_asymmetry", "thruster_lag", "sensor_scale"),
}
"""Hidden effects of each manoeuvre."""
STEADY = {HEADING: ("surge levels", 0.6), SPEED: ("circles", 0.1), STEP: ("surge levels", 0.6)}
"""Repeated manoeuvre of the library, and the part of it that is held at one speed."""
NOISE = 6.0
"""Noise relative to the ordinary level."""
DEPTH = 15.0
SESSIONS = 4
ATTEMPTS, WEAKER = 50, 4


def draw(seed: int) -> tuple[Case, str]:
    """Draw the hidden effect of a seed, its vehicle, and the manoeuvres that do not identify the effect.

    Raises:
        DataError: No vehicle can have the effect.
    """
    rng, family = np.random.default_rng([seed, 41]), list(FAMILIES)[seed % len(FAMILIES)]
    names = FAMILIES[family]
    name = names[seed // len(FAMILIES) % len(names)]
    for _ in range(ATTEMPTS):
        preset = str(rng.choice(vehicles.PRESETS))
        vehicle = vehicles.preset(preset)
        hidden = (strong(name, rng, vehicle),)
        try:
            validate(vehicles.joined(vehicle, hidden))
        except DataError:
            continue
        return Case("flown", seed, preset, "independent", NOISE, DEPTH, hidden, {}, (name,), name), family
    raise DataError(f"no vehicle can have {name}")


def repeated(file: Vehicle, family: str, seconds: float) -> list[Array]:
    """Return commands (N, n) of the sessions of an ambiguous recording.

    Args:
        file: Vehicle file.
        family: Kind of manoeuvre that all sessions repeat.
        seconds: Length of the recording [s].
    """
    name, at = STEADY[family]
    (flown,) = (one for one in library(file, seconds / SESSIONS) if one.name == name)
    steady = flown.commands[int(at * len(flown.commands))]
    if family == STEP:
        return [flown.commands] * SESSIONS
    return [np.repeat(steady[None], len(flown.commands), axis=0)] * SESSIONS


def randomly(file: Vehicle, seconds: float, seed: int) -> list[Array]:
    """Return commands (N, n) of random walks on all axes, for comparison with an advised flight."""
    plant = build(file)
    share, limits = np.linalg.pinv(plant.thrusts.T), plant.limits.max(axis=1)
    greatest = np.abs(plant.thrusts.T) @ limits
    out = []
    for number in range(SESSIONS):
        rows = round(seconds / SESSIONS / DT)
        demand = 0.5 * demands(Session("x", "walk", rows, number), seed, DT) * greatest
        level = np.clip(demand @ share.T / limits, -1.0, 1.0)
        out.append(np.sign(level) * np.abs(level) ** (1.0 / plant.chains[:, 0]))
    return out


@njit(cache=True)
def _follow(plant: Plant, commands: Array, first: Array, dt: float) -> Array:
    """Return the states (N, 13) under commands (N, n), NaN after divergence."""
    states, y = np.full((commands.shape[0], BODY), np.nan), resting(plant, first)
    for k in range(commands.shape[0]):
        if not np.abs(y).max() < 1e6:
            break
        states[k] = y[:BODY]
        y = onward(plant, y, commands, k, dt)
    return states


@dataclass(frozen=True)
class Sea:
    """Vehicle with a hidden effect, in the benchmark's own simulator."""

    case: Case
    actual: Vehicle

    def fly(self, name: str, sessions: list[Array], start: Array) -> pl.DataFrame:
        """Return the raw table of sessions, each from rest at a pose (6,), with noise.

        Raises:
            DataError: The motion diverges.
        """
        plant, tables = build(self.actual, self.case.hidden), []
        for number, commands in enumerate(sessions):
            rng = np.random.default_rng([self.case.seed, number, sum(map(ord, name))])
            first = np.zeros(BODY)
            first[:3], first[3], first[6] = start[:3], np.cos(0.5 * start[5]), np.sin(0.5 * start[5])
            states = _follow(plant, np.ascontiguousarray(commands), first, DT)
            if not np.isfinite(states).all():
                raise DataError("the motion knows no bounds")
            motion = np.hstack([states[:, :3], angles(states[:, 3:7]), logged(states, self.case.hidden)])
            tables.append(table(f"{name}{number}", motion, commands, self.case.noise, rng))
        return pl.concat(tables)


def first_recording(
    case: Case, given: Vehicle, actual: Vehicle, family: str, seconds: float
) -> tuple[Sea, pl.DataFrame]:
    """Record the ambiguous manoeuvre, halving the hidden effect while the motion diverges.

    Args:
        case: Hidden effect.
        given: Vehicle file.
        actual: Vehicle with its true damping.
        family: Kind of manoeuvre.
        seconds: Length of the recording [s].

    Returns:
        The vehicle with the hidden effect as flown, and the raw table.

    Raises:
        DataError: The motion diverges even with the weakest effect.
    """
    start = np.array([0.0, 0.0, DEPTH, 0.0, 0.0, 0.0])
    for left in range(WEAKER, -1, -1):
        sea = Sea(case, actual)
        try:
            return sea, sea.fly("first", repeated(given, family, seconds), start)
        except DataError:
            if not left:
                raise
            case = weaker(case)
    raise AssertionError
