"""Some of the planted mistakes, on one vehicle: what the benchmark names may not be missed again."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from benchmarks import planted_mistakes as planted
from hydro.core.columns import MOTION
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle

ROWS = 4500
"""Ninety seconds."""
QUICK = (
    "velocity is FLU",
    "attitude is in degrees",
    "yaw rate reversed",
    "clock in milliseconds",
    "velocity stamped late",
    "thrusters from the other end",
    "thruster 2 reversed",
)


@pytest.fixture(scope="module")
def flown() -> tuple[Vehicle, pl.DataFrame]:
    return planted.flown("bluerov2_heavy", ROWS)


def test_a_log_without_mistakes_is_not_warned_of(flown: tuple[Vehicle, pl.DataFrame]) -> None:
    vehicle, raw = flown
    assert planted.said(vehicle, *planted.log_of(raw)) == []


@pytest.mark.parametrize("name", QUICK)
def test_a_mistake_is_named(name: str, flown: tuple[Vehicle, pl.DataFrame]) -> None:
    vehicle, raw = flown
    ((_, named, lines),) = planted.outcomes(vehicle, raw, [name])
    assert named, lines


def test_heave_positive_up_is_not_read_as_other_axes_with_sway_reversed() -> None:
    """Both explain the motion; reversing one column is the smaller mistake."""
    ((_, named, lines),) = planted.outcomes(*planted.flown("remus100", 6000), ["heave is up"])
    assert named, lines


def test_a_dead_thruster_is_none_in_reverse(flown: tuple[Vehicle, pl.DataFrame]) -> None:
    vehicle, raw = flown
    still = raw.cast({pl.Float32: pl.Float64}).with_columns(pl.col("cmd_2") * 0.0)
    moved = simulate(vehicle, still).select(MOTION).to_numpy()
    noisy = disturb(moved, PROFILES["ordinary"], np.random.default_rng(1))
    logged = raw.with_columns(**dict(zip(MOTION, noisy.T, strict=True)))
    assert not [line for line in planted.said(vehicle, *planted.log_of(logged)) if "drives" in line]


def test_there_are_thirteen() -> None:
    assert len(planted.MISTAKES) == 13
    assert set(QUICK) < set(planted.MISTAKES)
