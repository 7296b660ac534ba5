"""Measured motion and its predictions by vehicle files, restarted at regular intervals, for plots.

Over minutes any prediction drifts away from the recording.  Predictions of 20 s show which of two models
moves like the vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import polars as pl

from hydro.core.columns import POSE, VELOCITY, Array, Rows, command_column
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import corrected_first, predict, prepare
from hydro.core.recording.arrays import Recording, recording, smoothed
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.simulation.bands import spread, table
from hydro.core.simulation.dynamics import BODY
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import body_states, euler_from_quaternion

MEASURED = "measured"
RESTART_INTERVAL = 20.0
"""Time between restarts [s]."""
SHOWN_SECONDS = 120.0
"""Length of the part of a session that is shown, from its first row [s]."""
MOST_SESSIONS = 12
"""Maximum number of sessions that are shown, the first of a recording."""
FEW_DRAWS = 40
"""Number of vehicles drawn from the covariance for a band."""
SHOWN_RATE = 10.0
"""Minimum rate of the rows in a plot [Hz], fast enough for a vehicle's motion."""


def restarted(vehicles: Mapping[str, Vehicle], raw: pl.DataFrame) -> pl.DataFrame:
    """Return predictions of a recording by several vehicles, restarted regularly from the measured motion.

    Args:
        vehicles: Vehicles by the names of their variants.
        raw: Raw table of the measured motion and commands.

    Returns:
        A table in float32: `session`, `variant` (`measured` and the keys of `vehicles`), `t`, pose in
        NED [m, rad] and velocity in the body frame [m/s, rad/s], and the commands `cmd_1` ... `cmd_n` of
        `measured`, null for other variants.  A variant lacks the rows in which its motion diverges.

    Raises:
        DataError: The recording does not fit a vehicle.
    """
    shown = _heads(raw)
    record = recording(next(iter(vehicles.values())), shown)
    motions = {MEASURED: np.hstack([record.eta, record.nu])}
    motions |= {name: _predicted(vehicle, recording(vehicle, shown)) for name, vehicle in vehicles.items()}
    kept = _thinned(record)
    commands = [command_column(i) for i in range(record.commands.shape[1])]
    told = shown.select(pl.col(commands).cast(pl.Float32).gather(kept))
    table = pl.concat(
        pl.DataFrame(motion[kept].astype(np.float32), schema=[*POSE, *VELOCITY]).select(
            shown["session"].gather(kept),
            pl.lit(name).alias("variant"),
            pl.Series("t", record.t[kept]),
            pl.all(),
            *(told if name == MEASURED else told.clear(len(kept))),
        )
        for name, motion in motions.items()
    )
    return table.filter(pl.all_horizontal(pl.col(*POSE, *VELOCITY).is_finite()))


def restarted_bands(
    vehicle: Vehicle, estimates: Estimates, raw: pl.DataFrame, *, draws: int = FEW_DRAWS, seed: int = 0
) -> pl.DataFrame:
    """Return the 95 % bands of restarted predictions, due to the covariance of a vehicle's estimates.

    Args:
        vehicle: Vehicle.
        estimates: Estimated values of the vehicle.
        raw: Raw table of the measured motion and commands.
        draws: Number of vehicles to draw.
        seed: Seed of the draws.

    Returns:
        The bands table of `simulation.bands` in float32, with the rows of `restarted`, except those in which
        the motion diverges.

    Raises:
        DataError: The recording does not fit the vehicle.
    """
    shown = _heads(raw)
    record = recording(vehicle, shown)
    kept = _thinned(record)

    def predicted(one: Vehicle) -> Array:
        return _predicted(one, record)[kept]

    low, high = spread(vehicle, estimates, predicted, draws=draws, seed=seed)
    rows = pl.DataFrame({"session": shown["session"].gather(kept), "t": record.t[kept]})
    made = table(rows, predicted(vehicle), low, high)
    numbers = pl.exclude("session", "t")
    return made.with_columns(numbers.cast(pl.Float32)).filter(pl.all_horizontal(numbers.is_finite()))


def _heads(raw: pl.DataFrame) -> pl.DataFrame:
    """Return the first SHOWN_SECONDS of the first MOST_SESSIONS sessions."""
    since = pl.col("t") - pl.col("t").first().over("session")
    first = raw["session"].unique(maintain_order=True).head(MOST_SESSIONS).implode()
    return raw.filter(pl.col("session").is_in(first)).filter(since <= SHOWN_SECONDS)


def _thinned(record: Recording) -> Rows:
    """Return evenly spaced rows of each segment, from its first row on, at SHOWN_RATE or faster."""
    every = max(int(1.0 / (SHOWN_RATE * record.dt) + 1e-9), 1)
    return np.concatenate([np.arange(a, b, every, dtype=np.int64) for a, b in record.segments])


def _predicted(vehicle: Vehicle, record: Recording) -> Array:
    """Return pose and velocity as a vehicle would log them, (N, 12); NaN where its motion diverges."""
    model, length = candidate(vehicle), max(round(RESTART_INTERVAL / record.dt), 1)
    eta, nu = smoothed(record)
    calm = body_states(eta, nu)
    out = np.empty((record.rows, 12))
    for number, (begin, end) in enumerate(record.segments):
        for start in range(begin, end, length):
            rows = slice(start, min(start + length, end))
            shot = Shots(
                record=record,
                starts=np.array([start]),
                segment=np.array([number]),
                length=rows.stop - rows.start,
                lead=0,
                first=calm[start : start + 1],
                measured=np.empty((1, 0, BODY)),
                sigma=np.ones(CHANNELS),
                eta=eta,
                nu=nu,
            )
            shot = corrected_first(shot, model)
            out[rows] = _angles(predict(prepare(model, shot), shot)[0])
    return out


def _angles(motion: Array) -> Array:
    """Convert position, quaternion and velocity (K, 13) to pose and velocity (K, 12); keep NaN."""
    out = np.full((len(motion), 12), np.nan)
    fine = np.isfinite(motion).all(axis=1)
    pose, quaternion, nu = np.split(motion[fine], [3, 7], axis=1)
    out[fine] = np.hstack([pose, euler_from_quaternion(quaternion), nu])
    return out
