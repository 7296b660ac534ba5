"""Open-loop predictions of recorded motion by every kind of model, from one list of starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import VELOCITY, Array, Mask, Rows
from hydro.core.evaluation.yardsticks import Yardstick, _wrench
from hydro.core.recording.arrays import recording
from hydro.core.recording.segments import sample_time, segments
from hydro.core.vehicle.description import Vehicle
from hydro.sim import replay as simulation

AHEAD = 5.0
"""Length of a prediction [s], as everywhere in this project's comparisons."""
SPACE = 0.5
"""Time between the end of a prediction and the next start [s].  A replay takes it for a gap of the log, after
which the rotors turn as commanded."""
MOST_ERROR = 10.0
"""Bound on an error [m/s, rad/s], which a divergent prediction has: several times the fastest motion."""


@dataclass(frozen=True)
class Windows:
    """Predictions of one length on one recording.

    Attributes:
        raw: Raw table with complete motion.
        truth: Measured velocity of its rows, (N, 6).
        seen: Which of these values were measured, (N, 6).
        rows: Rows of each prediction, the start first, (S, K).
    """

    raw: pl.DataFrame
    truth: Array
    seen: Mask
    rows: Rows

    @classmethod
    def of(cls, raw: pl.DataFrame, truth: Array, seen: Mask, ahead: float | None = AHEAD) -> Windows:
        """Place predictions one after the other.

        Args:
            raw: Raw table.
            truth: Measured velocity of its rows, (N, 6).
            seen: Which of these values were measured, (N, 6).
            ahead: Length of a prediction [s]; None for the whole of a recording of one session.
        """
        if ahead is None:
            return cls(raw, truth, seen, np.arange(raw.height)[None])
        dt = sample_time(raw)
        length, space = round(ahead / dt) + 1, max(2, round(SPACE / dt))
        starts = [np.arange(a, b - length + 1, length + space) for a, b in segments(raw)]
        return cls(raw, truth, seen, np.concatenate(starts)[:, None] + np.arange(length))

    def errors(self, predicted: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return the sums of squared errors of each prediction and axis, (S, 6), and the compared samples.

        Args:
            predicted: Velocities, (S, K, 6), NaN after a divergence.
        """
        rows = self.rows[:, 1:]
        off = np.nan_to_num(predicted[:, 1:] - self.truth[rows], nan=MOST_ERROR)
        squares = np.clip(off, -MOST_ERROR, MOST_ERROR) ** 2
        return (squares * self.seen[rows]).sum(axis=1), self.seen[rows].sum(axis=1)


def standing(windows: Windows) -> Array:
    """Predict zero velocity, (S, K, 6)."""
    return np.zeros((*windows.rows.shape, 6))


def by_least_squares(vehicle: Vehicle, train: pl.DataFrame, windows: Windows) -> Array:
    """Predict by damped axes that least squares fits to the training recording, (S, K, 6)."""
    fitted = Yardstick.of(vehicle, train).of_others
    record = recording(vehicle, windows.raw)
    starts = windows.rows[:, 0]
    tau = _wrench(vehicle, record)
    return fitted._by_least_squares(record, starts, windows.rows, record.nu[starts], tau)


def in_mujoco(vehicle: Vehicle, variant: simulation.Variant, windows: Windows) -> Array:
    """Replay the commands in MuJoCo with a variant of the water, (S, K, 6), NaN after a divergence."""
    part = windows.raw[windows.rows.ravel()]
    series, _ = simulation.replay(vehicle, part, [variant])
    flown = series.filter(pl.col("variant") == variant.name).select("session", "t", *VELOCITY)
    keys = part.select("session", pl.col("t").cast(pl.Float64))
    found = keys.join(flown, on=["session", "t"], how="left", maintain_order="left")
    return found.select(VELOCITY).to_numpy().astype(float).reshape(*windows.rows.shape, 6)
