"""Kinematic tests with rare, noisy fixes of the position and several gaps."""

from __future__ import annotations

import numpy as np
import polars as pl
import synthetic

from hydro.core.columns import POSE, VELOCITY
from hydro.core.preprocessing.sensor_tests import kinematic_tests, shown
from hydro.core.recording.arrays import recording

DT, SECONDS, FIX, SESSIONS = 0.1, 25.0, 0.3, 6


def cruise(rng: np.random.Generator, session: int) -> pl.DataFrame:
    """A craft of varying speed and course; its position is interpolated between noisy fixes each second."""
    t = np.arange(0.0, SECONDS, DT)
    u = 1.1 + 0.35 * np.sin(0.4 * t + rng.uniform(0.0, 6.0))
    r = 0.15 * np.sin(0.25 * t + rng.uniform(0.0, 6.0))
    psi = np.cumsum(r) * DT
    x, y = (np.cumsum(DT * u * way) for way in (np.cos(psi), np.sin(psi)))
    fixes = np.arange(0.0, SECONDS + 1.0)
    x, y = (np.interp(t, fixes, np.interp(fixes, t, p) + rng.normal(0.0, FIX, len(fixes))) for p in (x, y))
    still = np.zeros_like(t)
    motion = np.stack([x, y, still, still, still, psi, u, still, still, still, still, r], axis=1)
    motion += rng.normal(size=motion.shape) * [0, 0, 0.01, *[0.001] * 3, *[0.005] * 3, *[0.001] * 3]
    table = pl.DataFrame(motion, schema=[*POSE, *VELOCITY])
    commands = [pl.lit(0.0).alias(f"cmd_{i + 1}") for i in range(8)]
    return table.with_columns(pl.Series("t", t), *commands, session=pl.lit(f"s{session}"))


def kinematics(away: float):
    """Return the kinematic tests of six sessions whose first position is `away` metres too far east."""
    rng = np.random.default_rng(0)
    sessions = [cruise(rng, session) for session in range(SESSIONS)]
    first = pl.int_range(pl.len()) == 0
    moved = [one.with_columns(y=pl.col("y") + away * first.cast(pl.Float64)) for one in sessions]
    return kinematic_tests(recording(synthetic.vehicle(), pl.concat(moved)))


def test_the_error_of_the_first_position_after_a_gap_is_no_error_of_the_dvl():
    right, wrong = kinematics(0.0), kinematics(3.0)
    assert [name for name, one in wrong.items() if shown(one)] == []
    for name, axis in (("sensor_misalignment", 2), ("sensor_bias", 0), ("sensor_bias", 1)):
        one, other = right[name], wrong[name]
        assert abs(one.estimate[axis] - other.estimate[axis]) < 0.5 * one.standard_error[axis], name
        assert other.standard_error[axis] < 1.3 * one.standard_error[axis], name
