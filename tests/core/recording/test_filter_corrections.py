"""Positions that a filter predicts and corrects: only the rows right after its corrections are samples."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from recordings import damped, log, moved, noisy

from hydro.core.recording.arrays import recording
from hydro.core.recording.filter_corrections import filter_corrections
from hydro.core.recording.sensor_faults import without_bad_readings

DT, EVERY, NOISE = 0.004, 23, 0.05


def filtered(true: np.ndarray, rng: np.random.Generator, every: int = EVERY) -> np.ndarray:
    """What a filter writes that supposes a constant speed, and gets a noisy sample every so many rows."""
    out, place, speed = np.empty_like(true), true[0], 0.0
    for row, now in enumerate(true):
        place += DT * speed
        if row % every == 0:
            off = now + NOISE * rng.standard_normal() - place
            place, speed = place + 0.5 * off, speed + 0.3 * off
        out[row] = place
    return out


@pytest.fixture(scope="module")
def flight() -> pl.DataFrame:
    """A vehicle under slow sines, logged at 250 Hz."""
    raw = moved(damped(), rows=2000)
    t = np.arange(round(40.0 / DT)) * DT
    columns = {
        name: np.interp(t, raw["t"], raw[name]) for name in raw.columns if name not in ("session", "t")
    }
    return pl.DataFrame({"session": ["a"] * len(t), "t": t, **columns})


def test_only_the_rows_right_after_corrections_of_a_depth_are_kept(flight):
    depth = filtered(flight["z"].to_numpy(), np.random.default_rng(0))
    raw = flight.with_columns(z=pl.Series(depth))
    kept = filter_corrections(recording(damped(), raw))["z"]
    rows = np.flatnonzero(kept)
    assert not (rows % EVERY).any()
    assert rows.size > 0.9 * raw.height / EVERY
    log = without_bad_readings(damped(), raw)
    assert log.raw["z"].null_count() == raw.height - rows.size
    assert log.raw.drop("z").equals(raw.drop("z"))
    assert "z moves in steps, 1" in log.faults[0].message


@pytest.mark.parametrize("seed", range(4))
def test_noise_of_a_sensor_is_no_correction(seed):
    for raw in (noisy(moved(damped()), seed), log(seed=seed)):
        assert not filter_corrections(recording(damped(), raw))


def test_depths_that_are_held_rounded_or_wrong_for_a_row_are_no_corrections(flight):
    z, rng = flight["z"].to_numpy(), np.random.default_rng(1)
    outliers = z.copy()
    outliers[::EVERY] += rng.choice([-1.0, 1.0], len(z[::EVERY]))
    for other in (np.repeat(z[::EVERY], EVERY)[: len(z)], np.round(z, 2), outliers):
        assert not filter_corrections(recording(damped(), flight.with_columns(z=pl.Series(other))))


def test_a_few_steps_of_a_position_that_is_found_anew_are_left_to_others(flight):
    z = flight["z"].to_numpy() + 0.5 * (np.arange(flight.height) // 1000)
    assert not filter_corrections(recording(damped(), flight.with_columns(z=pl.Series(z))))


@pytest.mark.parametrize("unit", [0.002, 0.0035, 0.01])
def test_a_quick_heading_that_is_rounded_is_no_filter(unit):
    """It changes in every row, by one unit more or less: a unit is no step."""
    t = np.arange(8000) * 0.02
    turn = 1.6 * np.sin(0.3 * t) + 0.5 * np.sin(1.1 * t) + np.where(t > 80.0, 0.9 * np.sin(3.0 * t), 0.0)
    raw = moved(damped(), rows=8000).with_columns(psi=pl.Series(np.round(turn / unit) * unit))
    assert "psi" not in filter_corrections(recording(damped(), raw))
