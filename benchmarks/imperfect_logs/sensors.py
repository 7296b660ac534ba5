"""Corruption of a clean log by other sensors and loggers.

Each function takes a raw table and a generator of random numbers and returns the table corrupted in one way,
session by session.  `dvl` are u, v, w; the rates p, q, r come from a gyroscope.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.signal import lfilter

from hydro.core.columns import POSE, VELOCITY
from hydro.core.vehicle.frames import rotation

Array = NDArray[np.float64]
Spoil = Callable[[pl.DataFrame, np.random.Generator], pl.DataFrame]
DVL = VELOCITY[:3]

HEAVY = 0.02  # m/s, standard deviation of Student-t(3) noise
EVERY = 0.2  # s between the readings of a log at 5 Hz
LATE = (0.1, 0.3)  # s by which they are late
LAG = (0.1, 0.4)  # s, of a filter
WANDER, WANDERING = 0.01, 1.0  # m/s and s: size and correlation time of a filter's error
RESOLUTION = {"u": 0.02, "x": 0.05, "phi": np.deg2rad(0.2), "p": np.deg2rad(0.2)}
INVALID = 0.05  # share of the DVL's readings
REPEATED = 0.05  # share of the rows


def by_session(raw: pl.DataFrame, change: Callable[[pl.DataFrame], pl.DataFrame]) -> pl.DataFrame:
    """Return the table with `change` applied to each session separately."""
    return pl.concat([change(part) for part in raw.partition_by("session", maintain_order=True)])


def replaced(raw: pl.DataFrame, names: tuple[str, ...], values: Array) -> pl.DataFrame:
    """Return the table with the values (N, len(names)) in the named columns."""
    return raw.with_columns(pl.Series(name, column) for name, column in zip(names, values.T, strict=True))


def heavy_tailed(raw: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    """Add Student-t(3) noise to the DVL, on top of the noise of the log."""
    noise = HEAVY / np.sqrt(3.0) * rng.standard_t(3, (raw.height, 3))  # the variance of t(3) is 3
    return replaced(raw, DVL, raw.select(DVL).to_numpy() + noise)


def _readings(part: pl.DataFrame, late: float, phase: float) -> tuple[Array, Array]:
    """Return times (K,) and values (K, 3) of K late DVL readings at 5 Hz.

    Args:
        part: Raw table of a session.
        late: Delay of the readings [s].
        phase: Time of the first reading [s].
    """
    t = part["t"].to_numpy()
    ticks = np.arange(t[0] + phase - EVERY, t[-1] + 2.0 * EVERY, EVERY)
    values = part.select(DVL).to_numpy()
    said = np.column_stack([np.interp(ticks - late, t, column) for column in values.T])
    return ticks, said


def held(raw: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    """Replace the DVL by readings at 5 Hz, late by 0.1 to 0.3 s, each held until the next."""
    late = float(rng.uniform(*LATE))

    def change(part: pl.DataFrame) -> pl.DataFrame:
        ticks, said = _readings(part, late, float(rng.uniform(0.0, EVERY)))
        return replaced(part, DVL, said[np.searchsorted(ticks, part["t"].to_numpy(), side="right") - 1])

    return by_session(raw, change)


def interpolated(raw: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    """Replace the DVL by readings at 5 Hz, late by 0.1 to 0.3 s, with linear interpolation between them."""
    late = float(rng.uniform(*LATE))

    def change(part: pl.DataFrame) -> pl.DataFrame:
        ticks, said = _readings(part, late, float(rng.uniform(0.0, EVERY)))
        lines = [np.interp(part["t"].to_numpy(), ticks, column) for column in said.T]
        return replaced(part, DVL, np.column_stack(lines))

    return by_session(raw, change)


def filtered(raw: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    """Filter the DVL as a navigation filter does: first-order lag of 0.1 to 0.4 s, and a slow error."""
    lag = float(rng.uniform(*LAG))

    def change(part: pl.DataFrame) -> pl.DataFrame:
        values, dt = part.select(DVL).to_numpy(), float(np.median(np.diff(part["t"].to_numpy())))
        keep, stay = np.exp(-dt / lag), np.exp(-dt / WANDERING)
        slow = lfilter([1.0 - keep], [1.0, -keep], values, axis=0, zi=keep * values[:1])[0]
        white = WANDER * rng.standard_normal((part.height, 3))
        first = white[:1] * stay
        wander = lfilter([np.sqrt(1.0 - stay**2)], [1.0, -stay], white, axis=0, zi=first)[0]
        return replaced(part, DVL, slow + wander)

    return by_session(raw, change)


def quantised(raw: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    """Round all measurements: to 2 cm/s, 5 cm, 0.2 degrees and 0.2 degrees per second."""
    steps = np.repeat([RESOLUTION[name] for name in ("x", "phi", "u", "p")], 3)
    values = raw.select(*POSE, *VELOCITY).to_numpy()
    return replaced(raw, (*POSE, *VELOCITY), steps * np.round(values / steps))


def invalid(raw: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    """Replace one in twenty DVL readings, without bottom lock, by zeros."""
    kept = rng.random(raw.height) >= INVALID
    return replaced(raw, DVL, raw.select(DVL).to_numpy() * kept[:, None])


def repeated(raw: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    """Repeat one in twenty rows, except for its time."""

    def change(part: pl.DataFrame) -> pl.DataFrame:
        again = rng.random(part.height) < REPEATED
        again[0] = False
        source = np.maximum.accumulate(np.where(again, 0, np.arange(part.height)))
        return part[source].with_columns(part["t"])

    return by_session(raw, change)


def dead_reckoned(raw: pl.DataFrame, rng: np.random.Generator) -> pl.DataFrame:
    """Replace the horizontal position by the integral of DVL and attitude; depth is still measured."""

    def change(part: pl.DataFrame) -> pl.DataFrame:
        t, x = part["t"].to_numpy(), part.select("x", "y").to_numpy()
        R = rotation(*part.select("phi", "theta", "psi").to_numpy().T)
        along = np.einsum("kij,kj->ki", R, part.select(DVL).to_numpy())[:, :2]
        steps = 0.5 * np.diff(t)[:, None] * (along[1:] + along[:-1])
        return replaced(part, ("x", "y"), x[:1] + np.vstack([np.zeros((1, 2)), steps.cumsum(axis=0)]))

    return by_session(raw, change)


SPOILT: dict[str, Spoil] = {
    "heavy-tailed": heavy_tailed,
    "held at 5 Hz, late": held,
    "interpolated from 5 Hz, late": interpolated,
    "filtered": filtered,
    "quantised": quantised,
    "invalid readings": invalid,
    "repeated rows": repeated,
    "dead-reckoned": dead_reckoned,
}
"""Corruptions of a clean log, by name."""
