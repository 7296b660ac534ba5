"""Some of the planted mistakes, on one vehicle: what the benchmark names may not be missed again."""

from __future__ import annotations

import polars as pl
import pytest

from benchmarks import planted_mistakes as planted
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


def test_there_are_twelve_that_must_be_named_and_one_more() -> None:
    assert len(planted.MISTAKES) == 13
    assert set(QUICK) < set(planted.MISTAKES)
