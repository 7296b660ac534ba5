"""A dive of a BlueROV2 that is not as its vehicle file says, and what its sensors would have told of it.

The vehicle is `vehicles/bluerov2_heavy.toml` with `HIDDEN` beside it: something in the propeller of thruster
3, and a current.  A pilot flies it for two minutes, by wrenches that the autopilot's mixer makes into
pulses twenty times a second.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl

from hydro.core.columns import MOTION
from hydro.core.effects import validate
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import allocate, configuration_matrix, thruster_table, thrusts
from hydro.io import vehicle as vehicles

HERE = Path(__file__).parent
VEHICLE = HERE / "vehicles" / "bluerov2_heavy.toml"
HIDDEN: tuple[dict[str, Any], ...] = (
    {"name": "thruster_gain", "g": [0.0, 0.0, -0.35, 0.0, 0.0, 0.0, 0.0, 0.0]},
    {"name": "ocean_current", "v_N": 0.12, "v_E": -0.08, "v_D": 0.0},
)
"""Thruster 3 at 65 %, and 0.14 m/s of current."""
SEED = 2026
RATE, SECONDS = 100, 120.0
"""Rows of the truth per second, and how long the dive takes [s]."""
STICKS, SWAY = np.array([30.0, 26.0, 22.0, 0.0, 0.0, 2.2]), (0.04, 0.35)
"""Wrench of the pilot's demands [N, N m], and between which frequencies they lie [Hz]."""
MIXED = 20
"""Times per second that the mixer sets its outputs."""
DEPTH = 8.0
STOPPED = (77.0, 80.5)
"""When the logger stood still [s]."""
NO_BOTTOM = (41.0, 45.0)
"""When the Doppler log did not see the bottom [s]; it also loses single pings."""
LOST_PINGS = 0.04
DVL_LATE = 0.15
"""From the ping to the stamp of its driver [s]."""
NOISE = {"position": 0.02, "depth": 0.01, "attitude": 0.001, "velocity": 0.01, "rates": 0.002}
"""Standard deviations [m, m, rad, m/s, rad/s]."""


@dataclass(frozen=True)
class Samples:
    """What one sensor took.

    Attributes:
        t: Times of its samples [s], (n,).
        values: Its values, (n, k).
        valid: Whether they are any good, (n,).
    """

    t: np.ndarray
    values: np.ndarray
    valid: np.ndarray

    def __iter__(self) -> Iterator[tuple[float, np.ndarray, bool]]:
        """Time, values and validity of each sample."""
        for t, values, valid in zip(self.t, self.values, self.valid, strict=True):
            yield float(t), values, bool(valid)

    def first(self, seconds: float) -> Samples:
        """The beginning."""
        early = self.t < seconds
        return Samples(self.t[early], self.values[early], self.valid[early])


@dataclass(frozen=True)
class Dive:
    """A dive and what was taken of it.

    Attributes:
        truth: Raw table of the motion as it was, RATE rows a second.
        pose: x y z phi theta psi, ten times a second [NED].
        imu: phi theta psi p q r, fifty times.
        dvl: u v w, five times, of the body origin [FRD].
        pulses: Pulse widths of the eight thrusters [us], MIXED times.
    """

    truth: pl.DataFrame
    pose: Samples
    imu: Samples
    dvl: Samples
    pulses: Samples

    def first(self, seconds: float) -> Dive:
        """The beginning of it."""
        parts = (self.pose, self.imu, self.dvl, self.pulses)
        return Dive(self.truth.filter(pl.col("t") < seconds), *(part.first(seconds) for part in parts))


def dive() -> Dive:
    """The dive, the same every time."""
    known, _ = vehicles.read(VEHICLE)
    rng = np.random.default_rng(SEED)
    t = np.arange(round(SECONDS * RATE)) / RATE
    pulses = np.repeat(_pulses(known, rng), RATE // MIXED, axis=0)
    truth = _flown(known, t, pulses)
    motion = truth.select(MOTION).to_numpy()
    place, turn, velocity, spin = (motion[:, k : k + 3] for k in (0, 3, 6, 9))
    at = np.array([NOISE["position"], NOISE["position"], NOISE["depth"]])
    return Dive(
        truth,
        _taken(t, 10, [(place, at), (turn, NOISE["attitude"])], rng),
        _taken(t, 50, [(turn, NOISE["attitude"]), (spin, NOISE["rates"])], rng),
        _without_bottom(_taken(t, 5, [(velocity, NOISE["velocity"])], rng), rng),
        _taken(t, MIXED, [(pulses, 0.0)], rng),
    )


def _pulses(known: Vehicle, rng: np.random.Generator) -> np.ndarray:
    """What the mixer sends to the thrusters [us], (n, 8): whole, by the inverse of their curves."""
    t = np.arange(round(SECONDS * MIXED)) / MIXED
    frequency = rng.uniform(*SWAY, (8, 6))
    waves = np.sin(2.0 * np.pi * (frequency * t[:, None, None] + rng.uniform(0.0, 1.0, (8, 6))))
    sticks = np.clip(waves.sum(axis=1) / 2.5, -1.0, 1.0) * np.minimum(t / 2.0, 1.0)[:, None]
    wanted = allocate(configuration_matrix(known), STICKS * sticks)
    widths, table = np.arange(1100.0, 1901.0), thruster_table(known)
    ramp = np.repeat((widths - 1500.0)[:, None] / 400.0, len(table), axis=1)
    slowly = 10.0 * np.arange(len(widths))
    pushed = thrusts(table, ramp, slowly, np.array([[0, len(widths)]]))
    pushed = np.roll(pushed, -1, axis=0)  # a command is felt at the next row
    pushed[-1] = 2.0 * pushed[-2] - pushed[-3]
    return np.round(
        np.stack([np.interp(wanted[:, i], pushed[:, i], widths) for i in range(len(table))], axis=1)
    )


def _flown(known: Vehicle, t: np.ndarray, pulses: np.ndarray) -> pl.DataFrame:
    """The motion of the vehicle as it is, from rest at a depth."""
    true = msgspec.structs.replace(known, effect=(*known.effect, *HIDDEN))
    validate(true)
    columns = {f"cmd_{i + 1}": (column - 1500.0) / 400.0 for i, column in enumerate(pulses.T)}
    moved = simulate(true, pl.DataFrame({"session": "dive", "t": t, **columns}))
    return moved.with_columns(pl.col("z") + DEPTH)


def _taken(
    t: np.ndarray, rate: int, parts: list[tuple[np.ndarray, Any]], rng: np.random.Generator
) -> Samples:
    """Every so many rows of what a sensor sees, with its noise, while the logger runs."""
    rows = np.arange(0, len(t), RATE // rate)
    rows = rows[(t[rows] < STOPPED[0]) | (t[rows] > STOPPED[1])]
    values = [seen[rows] + noise * rng.standard_normal((len(rows), seen.shape[1])) for seen, noise in parts]
    return Samples(t[rows], np.concatenate(values, axis=1), np.ones(len(rows), bool))


def _without_bottom(pings: Samples, rng: np.random.Generator) -> Samples:
    """Pings of which some found no bottom: their velocity is 0."""
    lost = (pings.t > NO_BOTTOM[0]) & (pings.t < NO_BOTTOM[1])
    lost |= rng.uniform(size=len(pings.t)) < LOST_PINGS
    return Samples(pings.t, np.where(lost[:, None], 0.0, pings.values), ~lost)
