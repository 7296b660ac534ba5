"""Diagnoses of 40 recordings that can show nothing of a vehicle, and the number that name an effect.

    python -m benchmarks.unready

Motionless in the water, on a bench, rocking at the surface, and commanded but never armed: ten of each, with
random noise, sample rate, sensors, attitude, drift of the heading and bias of the gyro.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

import hydro
from benchmarks.kept_tables import markdown
from hydro.core.columns import POSE, VELOCITY
from hydro.core.errors import DataError

VEHICLE = Path(__file__).resolve().parents[1] / "datasets" / "vehicles" / "bluerov2_heavy.toml"
KINDS = ("motionless", "bench", "surface", "unarmed")
SENSORS = ((), ("x", "y", "u", "v", "w"), ("x", "y", "z", "u", "v", "w"))
"""Channels that the log lacks: none, those of a positioning system and a DVL, or depth as well."""
CHANNELS = (*POSE, *VELOCITY)
Array = NDArray[np.float64]


def recording(kind: str, seed: int) -> pl.DataFrame:
    """Return the raw table of a vehicle at rest, or of motion that its thrusters did not cause."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    dt, seconds = float(rng.choice([0.2, 0.1, 0.05, 0.02])), float(rng.uniform(40.0, 120.0))
    rows = round(seconds / dt)
    t = np.arange(rows) * dt
    motion: dict[str, Array] = {name: np.zeros(rows) for name in CHANNELS}
    depth = 0.0 if kind in ("bench", "surface") else float(rng.uniform(0.8, 6.0))
    motion["z"] += depth
    for name in POSE[3:]:
        motion[name] += rng.uniform(-0.15, 0.15)
    motion["psi"] += rng.uniform(-1e-4, 1e-4) * t  # drift of a heading without a compass
    if kind == "surface":
        _rock(motion, t, rng)
    scale = np.repeat([0.01, 0.001, 0.005, 0.002], 3) * rng.uniform(0.3, 2.0)
    for name, size in zip(CHANNELS, scale, strict=True):
        motion[name] = motion[name] + size * rng.standard_normal(rows)
    for name in VELOCITY[3:]:
        motion[name] = motion[name] + rng.normal(0.0, 0.003)
    table = pl.DataFrame({"session": ["a"] * rows, "t": t, **motion, **_commands(kind, t, rng)})
    lacking = () if kind == "surface" and seed % 3 == 2 else SENSORS[seed % 3]
    return table.with_columns(pl.lit(None, pl.Float64).alias(name) for name in lacking)


def _rock(motion: dict[str, Array], t: Array, rng: np.random.Generator) -> None:
    """Let waves of 2 to 5 s rock a floating vehicle by some centimetres and degrees."""
    for position, velocity, size in (("z", "w", 0.06), ("phi", "p", 0.08), ("theta", "q", 0.08)):
        for _ in range(3):
            omega, phase = 2.0 * np.pi / rng.uniform(2.0, 5.0), rng.uniform(0.0, 2.0 * np.pi)
            share = size * rng.uniform(0.2, 0.6)
            motion[position] += share * np.sin(omega * t + phase)
            motion[velocity] += share * omega * np.cos(omega * t + phase)


def _commands(kind: str, t: Array, rng: np.random.Generator) -> dict[str, Array]:
    """Return commands of eight thrusters: of a pilot where the vehicle is unarmed, else neutral or nearly."""
    columns = {}
    for i in range(8):
        wave = np.sin(2.0 * np.pi * rng.uniform(0.05, 0.5) * t + rng.uniform(0.0, 6.0))
        busy = kind == "unarmed" or (kind == "surface" and i % 2)
        columns[f"cmd_{i + 1}"] = 0.4 * wave if busy else np.full(len(t), rng.choice([0.0, 0.004]))
    return columns


def told(kind: str, seed: int) -> tuple[str, bool]:
    """Return the output of a diagnosis of a recording, and whether it names an effect."""
    try:
        found = hydro.diagnose(hydro.vehicle(VEHICLE), recording(kind, seed))
    except DataError as refusal:
        return str(refusal), False
    named = found.filter((pl.col("effect") != "") & (pl.col("verdict") != "not_excited"))
    return ", ".join(found["verdict"]), not named.is_empty()


def main() -> None:
    rows = []
    for kind in KINDS:
        begun, named, silent = time.process_time(), 0, 0
        for seed in range(10):
            words, stated = told(kind, seed)
            named += stated
            silent += "nothing can be concluded" in words
            print(f"{kind} {seed}: {words}", flush=True)
        spent = (time.process_time() - begun) / 10
        rows.append(
            {
                "recording": kind,
                "effect named": f"{named} of 10",
                "said that nothing can be told": f"{silent} of 10",
                "cpu, s": f"{spent:.1f}",
            }
        )
    print(markdown(rows))


if __name__ == "__main__":
    main()
