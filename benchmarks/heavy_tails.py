"""Count the channels of moving recordings whose noise is called heavy-tailed, at four sample rates.

    python -m benchmarks.heavy_tails --recordings 200

A BlueROV2 Heavy moves under sines or under steps of random length on all six axes.  Every recording is read
twice, with Gaussian noise and with Student's t noise of three degrees of freedom.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from benchmarks.kept_tables import markdown
from benchmarks.shares import interval
from hydro.core.columns import POSE, VELOCITY
from hydro.core.recording.sensor_faults import without_faults
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as vehicles

ROOT = Path(__file__).resolve().parents[1]
FINE = 0.02
"""Sample time of the simulated motion [s]; the recordings take every n-th row of it."""
SECONDS = {2: 150.0, 5: 150.0, 10: 150.0, 50: 60.0}
"""Length of a recording at each rate [Hz]: at 2 Hz the shortest one that the test looks at is 100 s."""
HELD = (None, (0.3, 1.5), (0.5, 3.0), (1.0, 5.0), (3.0, 12.0))
"""Shortest and longest time that a command is held [s]; None for sines of 0.05 to 0.4 Hz."""
NOISE = np.repeat([0.01, 0.002, 0.01, 0.002], 3)
"""Scale of the noise of each channel [m, rad, m/s, rad/s]."""
CHANNELS = (*POSE, *VELOCITY)
Array = NDArray[np.float64]


def commands(vehicle: Vehicle, seed: int, seconds: float) -> pl.DataFrame:
    """Return commands that move all six axes, by the seed with sines or steps."""
    rng, rows = np.random.default_rng([seed, 0]), round(seconds / FINE)
    t, axes, held = np.arange(rows) * FINE, np.zeros((rows, 6)), HELD[seed % len(HELD)]
    for axis in range(6):
        if held is None:
            wave = 2.0 * np.pi * rng.uniform(0.05, 0.4) * t + rng.uniform(0.0, 2.0 * np.pi)
            axes[:, axis] = 0.5 * np.sin(wave)
            continue
        at = 0
        while at < rows:
            count = max(int(rng.uniform(*held) / FINE), 1)
            axes[at : at + count, axis] = rng.choice([-0.5, -0.25, 0.0, 0.0, 0.25, 0.5])
            at += count
    axes[:, 3:5] *= 0.1
    wrench = np.array([[*one.direction, *np.cross(one.position, one.direction)] for one in vehicle.thruster])
    shares = np.linalg.pinv(wrench.T / np.abs(wrench).max(axis=0)[:, None])
    each = np.clip(axes @ (shares / np.abs(shares).max()).T, -1.0, 1.0)
    columns = {f"cmd_{i + 1}": each[:, i] for i in range(each.shape[1])}
    return pl.DataFrame({"session": ["a"] * rows, "t": t, **columns})


def recorded(vehicle: Vehicle, seed: int, rate: int, *, student: bool) -> pl.DataFrame:
    """Return a recording with Gaussian or Student's t noise on every channel."""
    moved = simulate(vehicle, commands(vehicle, seed, SECONDS[rate]))[:: round(1.0 / (rate * FINE))]
    rng = np.random.default_rng([seed, 1])
    shape = (moved.height, len(CHANNELS))
    error = rng.standard_t(3.0, shape) if student else rng.standard_normal(shape)
    values: Array = moved.select(CHANNELS).to_numpy().astype(float) + NOISE * error
    values[:, 3:6] = np.angle(np.exp(1j * values[:, 3:6]))
    return moved.with_columns(pl.Series(name, values[:, i]) for i, name in enumerate(CHANNELS))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    chosen = parser.parse_args()
    vehicle, _ = vehicles.read(ROOT / "datasets" / "vehicles" / "bluerov2_heavy.toml")
    rows, each = [], chosen.recordings // len(SECONDS)
    for number, rate in enumerate(SECONDS):
        begun, called, altered = time.process_time(), {False: 0, True: 0}, 0
        first = chosen.first_seed + number * each
        for seed in range(first, first + each):
            for student in (False, True):
                raw = recorded(vehicle, seed, rate, student=student)
                cleaned = without_faults(vehicle, raw)
                called[student] += len(cleaned.tails)
                if not student:
                    altered += len({name for fault in cleaned.faults for name in fault.columns})
        count = each * len(CHANNELS)
        low, high = interval(called[False], count)
        rows.append(
            {
                "rate": f"{rate} Hz",
                "channels": str(count),
                "Gauss: called heavy-tailed": f"{called[False]} ({low:.1%} to {high:.1%})",
                "Gauss: called faulty": str(altered),
                "t(3): called heavy-tailed": str(called[True]),
            }
        )
        print(rows[-1], f"{time.process_time() - begun:.0f} s", flush=True)
    print(markdown(rows))


if __name__ == "__main__":
    main()
