"""Sinks of a vehicle with thrusters at rest, the shortest recording that shows a weight."""

from __future__ import annotations

import numpy as np
import polars as pl

from hydro.core.columns import POSE, VELOCITY

SPEED = 0.113
"""Speed of the sinks [m/s]."""


def sunk(seed: int, *, attitude: bool) -> pl.DataFrame:
    """Three sinks of 9 s, thrusters off, trimmed by 5 degrees; depth at 3 Hz, attitude at 10 Hz."""
    rng, parts = np.random.default_rng(seed), list[pl.DataFrame]()
    for number in range(3):
        t = np.arange(90) * 0.1
        z = 0.12 + SPEED * t + 0.002 * rng.standard_normal(len(t))
        angles = np.array([0.0, 0.09, 0.0]) + 0.001 * rng.standard_normal((len(t), 3))
        shown = np.where(np.arange(len(t)) % 3 == 0, z, np.nan)
        parts.append(
            pl.DataFrame({"session": [f"s{number}"] * len(t), "t": t, "z": shown})
            .with_columns(pl.lit(None, pl.Float64).alias(name) for name in ("x", "y", *VELOCITY))
            .with_columns(
                pl.Series(name, column if attitude else np.full(len(t), np.nan))
                for name, column in zip(POSE[3:], angles.T, strict=True)
            )
            .with_columns(pl.lit(0.0).alias(f"cmd_{i + 1}") for i in range(8))
        )
    return pl.concat(parts).with_columns(pl.col("z", *POSE[3:]).fill_nan(None))
