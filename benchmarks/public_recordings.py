"""Compare a vehicle file, least squares, a network and hydro on a public recording that you have downloaded.

    python -m benchmarks.public_recordings dive.bag --map map.toml --vehicle vehicle.toml

The last quarter of the sessions, or of the time of a single session, is held out.  Each method predicts 5 s
of it again and again from the measured motion.  docs/public-recordings.md says where recordings are, and
under which licence.  No recording is bundled.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import polars as pl

import hydro
from benchmarks.challenge.baselines import BASELINES, held_of
from benchmarks.challenge.layout import AHEAD, LEAD, Public, blinded, windows
from benchmarks.kept_tables import Row, markdown
from benchmarks.rivals.contest import Held
from hydro.core.columns import VELOCITY
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.recording.arrays import recording
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as vehicles

METHODS = ("file as given", "least squares", "network", "hydro")
HELD_OUT = 0.25
"""Share of sessions, or of the time of a single one, that is held out."""
MOST = 200
"""Greatest number of predictions."""


def divided(raw: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Divide a raw table into a part to fit and a part to hold out.

    Raises:
        SystemExit: There is too little to hold out a prediction.
    """
    names = raw["session"].unique(maintain_order=True)
    count = round(HELD_OUT * len(names))
    if count:
        later = pl.col("session").is_in(names[-count:].implode())
    else:
        span = raw["t"][-1] - raw["t"][0]
        if HELD_OUT * span < LEAD + AHEAD:
            raise SystemExit(f"{span:.0f} s are too short: {(LEAD + AHEAD) / HELD_OUT:.0f} s are needed")
        later = pl.col("t") > raw["t"][-1] - HELD_OUT * span
    return raw.filter(~later), raw.filter(later)


def measured(vehicle: Vehicle, text: str, raw: pl.DataFrame, chosen: list[str]) -> list[Row]:
    """Return the errors of each method on the held-out part, one row per method."""
    fit, held_out = divided(raw)
    record = recording(vehicle, held_out)
    motion = Motion.of(record)
    there = held_out.with_columns(pl.DataFrame(record.nu, schema=list(VELOCITY)))
    whole = pl.concat(windows(there, np.hstack([motion.eta, motion.nu]), record.dt, MOST))
    public = Public("recording", text, fit, None, blinded(whole))
    held = held_of(vehicle, public.held_out)
    rows = []
    for name in chosen:
        begun = time.process_time()
        effects, velocities = BASELINES[name](vehicle, public, held)
        spent = time.process_time() - begun
        errors = rms(whole, held, velocities)
        rows.append(
            {
                "method": name,
                **{
                    f"{axis} [m/s]" if i < 3 else f"{axis} [rad/s]": f"{errors[i]:.3g}"
                    for i, axis in enumerate(VELOCITY)
                },
                "names": ", ".join(f"{one['name']} ({one.get('confidence', 1.0):.0%})" for one in effects)
                or "-",
                "processor time [s]": f"{spent:.0f}",
            }
        )
    return rows


def rms(whole: pl.DataFrame, held: Held, velocities: np.ndarray) -> np.ndarray:
    """Return the root mean square error of each axis over all predictions, (6,) [m/s, rad/s].

    Args:
        whole: Raw table of the held-out part.
        held: Held-out part with the starts of predictions.
        velocities: Predicted velocities (S, L, 6).
    """
    logged = whole.select(VELOCITY).to_numpy().astype(float)
    rows = held.starts[:, None] + np.arange(held.length)
    off = np.clip(np.nan_to_num(velocities - logged[rows], nan=np.inf), -100.0, 100.0)
    return np.asarray(np.sqrt(np.mean(off**2, axis=(0, 1))))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log", help="a log that `hydro import` reads")
    parser.add_argument("--map", type=Path, help="map of the log")
    parser.add_argument("--vehicle", type=Path, required=True, help="vehicle file")
    parser.add_argument("--method", action="append", choices=METHODS, help="all by default")
    given = parser.parse_args()
    raw, _ = hydro.import_log(given.log, given.map) if given.map else (hydro.read(given.log), None)
    vehicle, text = vehicles.read(given.vehicle)
    print(markdown(measured(vehicle, text, raw, given.method or list(METHODS))))


if __name__ == "__main__":
    main()
